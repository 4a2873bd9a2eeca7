"""Whether a camera file fits an image: sentences for the annotator, and K rescaled where that is what is wrong.

Needs ``cv2``, as the camera file's reader does.
"""

from dataclasses import dataclass

import numpy as np

from .intrinsics_file import CameraFile
from .pinhole import PinholeCamera

OFF_CENTRE = 0.1
"""Part of the image's width or height that a principal point may lie off its centre; real lenses: 0.07 and less."""

NARROWEST, WIDEST = 40.0, 0.4
"""Focal lengths relative to the image's longer side that are told: fields of view of 1.4 and of 103 degrees."""

UNEQUAL = 0.05
"""Relative difference of fx and fy that is told: real sensors have square pixels to a hundredth."""


@dataclass(frozen=True)
class CameraFit:
    """How a camera file and an image go together.

    Attributes
    ----------
    camera
        K as it stands, for the image's size.
    rescaled
        K brought to the image's size, if the file's has the same shape and another number of pixels; else ``None``.
    told
        What does not fit, in whole sentences; empty if all is well.
    """

    camera: PinholeCamera
    rescaled: PinholeCamera | None
    messages: tuple[str, ...]


def fit_of(file: CameraFile, size_wh: tuple[int, int]) -> CameraFit:
    """Compare a camera file with the image, of (width, height) ``size_wh``, that it is to be used for."""
    messages, rescaled = [], None
    if file.size is not None and file.size != size_wh:
        same_shape = _same_shape(file.size, size_wh)
        if same_shape:
            rescaled = file.camera(file.size).resized(*size_wh)
        messages.append(_size_sentence(file.size, size_wh, same_shape))
    camera = PinholeCamera(*size_wh, file.fx, file.fy, file.cx, file.cy)
    sentences = _normalised_sentence(camera) or [*_centre_sentence(camera), *_focal_sentence(camera)]
    if rescaled is not None:
        # one cause, one sentence: what is odd about K for this size may be well once it is rescaled
        sentences = _normalised_sentence(rescaled) or [*_centre_sentence(rescaled), *_focal_sentence(rescaled)]
    return CameraFit(camera, rescaled, (*messages, *sentences, *_aspect_sentence(camera)))


def _same_shape(one: tuple[int, int], other: tuple[int, int]) -> bool:
    """Whether two sizes have one aspect ratio, up to the rounding of the smaller one to whole pixels."""
    small, large = sorted((one, other))
    return abs(large[0] * small[1] - large[1] * small[0]) <= max(large)


def _size_sentence(file: tuple[int, int], image: tuple[int, int], same_shape: bool) -> str:
    sizes = f"K is for images of {file[0]}x{file[1]} px, this image has {image[0]}x{image[1]}"
    if same_shape:
        return f"{sizes}: it was resized; rescale K by {image[0] / file[0]:.4g}"
    if file == image[::-1]:
        return f"{sizes}: one of them is turned by 90 degrees, or width and height are exchanged in the camera file"
    return f"{sizes}, of another shape: it was cropped or is from another camera; give the K of this image"


def _normalised_sentence(camera: PinholeCamera) -> list[str]:
    if 0 < camera.cx <= 1 and 0 < camera.cy <= 1 and max(camera.size_wh) > 8:
        return [
            f"the principal point ({camera.cx:g}, {camera.cy:g}) lies in the image's corner: K seems to be given "
            "relative to the image's size; multiply its first row by the width and its second by the height, in pixels"
        ]
    return []


def _centre_sentence(camera: PinholeCamera) -> list[str]:
    off = np.array([camera.cx, camera.cy]) - [(camera.width - 1) / 2, (camera.height - 1) / 2]
    if (np.abs(off) <= OFF_CENTRE * np.array(camera.size_wh)).all():
        return []
    centred = 2 * camera.cx + 1, 2 * camera.cy + 1
    guess = f"; it is the centre of an image of {centred[0]:.0f}x{centred[1]:.0f} px" if min(centred) > 0 else ""
    return [
        f"the principal point ({camera.cx:.1f}, {camera.cy:.1f}) lies ({off[0]:+.0f}, {off[1]:+.0f}) px off the centre "
        f"of this image{guess}: is K for another size, or was the image cropped?"
    ]


def _focal_sentence(camera: PinholeCamera) -> list[str]:
    ratio = min(camera.fx, camera.fy) / max(camera.size_wh)
    if WIDEST <= ratio <= NARROWEST:
        return []
    angle_deg = float(np.degrees(2 * np.arctan(0.5 / ratio)))
    cause = (
        "a focal length in millimetres must be divided by the size of a pixel" if ratio < WIDEST else "check its unit"
    )
    return [
        f"a focal length of {min(camera.fx, camera.fy):g} px sees {angle_deg:.3g} degrees across this image, "
        f"which is unusual; K needs pixels: {cause}"
    ]


def _aspect_sentence(camera: PinholeCamera) -> list[str]:
    if abs(camera.fx - camera.fy) <= UNEQUAL * max(camera.fx, camera.fy):
        return []
    difference = abs(camera.fx / camera.fy - 1)
    return [
        f"fx = {camera.fx:g} and fy = {camera.fy:g} differ by {difference:.0%}, and pixels of cameras are square: "
        "was the image stretched, or is one of them a slip?"
    ]
