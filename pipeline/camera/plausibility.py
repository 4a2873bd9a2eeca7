"""Whether a camera file fits an image: warnings for the user, and a rescaled K where the image was resized."""

from dataclasses import dataclass

import numpy as np

from .intrinsics_file import CameraFile
from .pinhole import PinholeCamera

MAX_OFFSET = 0.1
"""Largest offset of the principal point from the image's centre, relative to its size; real lenses: 0.07 and less."""

NARROWEST, WIDEST = 40.0, 0.4
"""Plausible focal lengths relative to the image's longer side: fields of view from 1.4° to 103°."""

MAX_ASPECT_DIFFERENCE = 0.05
"""Largest relative difference of fx and fy; real sensors have square pixels to within 1 %."""


@dataclass(frozen=True)
class CameraFit:
    """How well a camera file fits an image.

    Attributes
    ----------
    camera
        With the K of the file, unchanged, and the image's size.
    rescaled
        With K rescaled to the image's size, if the file has another size of the same proportions; else ``None``.
    messages
        What does not fit; empty if everything does.
    """

    camera: PinholeCamera
    rescaled: PinholeCamera | None
    messages: tuple[str, ...]


def fit_of(file: CameraFile, size_wh: tuple[int, int], pixel_aspect: float = 1.0) -> CameraFit:
    """Compare a camera file with the (width, height) of the image that it is used for.

    ``pixel_aspect`` is the width of a pixel over its height, as a film states it.
    """
    messages, rescaled = [], None
    if file.size is not None and file.size != size_wh:
        if any(_same_aspect(file.size, size) for size in (size_wh, shown_size(size_wh, pixel_aspect))):
            rescaled = file.camera(file.size).resized(*size_wh)
        messages.append(_size_message(file.size, size_wh, pixel_aspect, is_scaled=rescaled is not None))
    camera = PinholeCamera(*size_wh, file.fx, file.fy, file.cx, file.cy)
    # one message per cause: what is implausible about K may be due to the size alone
    return CameraFit(camera, rescaled, (*messages, *camera_doubts(rescaled or camera, pixel_aspect)))


def shown_size(size_wh: tuple[int, int], pixel_aspect: float) -> tuple[int, int]:
    """(width, height) of a film's frame as players show it, in square pixels."""
    return round(size_wh[0] * pixel_aspect), size_wh[1]


def camera_doubts(camera: PinholeCamera, pixel_aspect: float = 1.0) -> tuple[str, ...]:
    """What is implausible about a K, one message per cause; empty if nothing is."""
    return (*_centre_messages(camera), *_focal_messages(camera), *_aspect_messages(camera, pixel_aspect))


def _same_aspect(one: tuple[int, int], other: tuple[int, int]) -> bool:
    """Whether two sizes have the same aspect ratio, up to the rounding of the smaller one to whole pixels."""
    small, large = sorted((one, other))
    return abs(large[0] * small[1] - large[1] * small[0]) <= max(large)


def _size_message(file: tuple[int, int], image: tuple[int, int], pixel_aspect: float, *, is_scaled: bool) -> str:
    sizes = f"K is for images of {file[0]}x{file[1]} px, this image has {image[0]}x{image[1]}"
    if pixel_aspect != 1:
        width, height = shown_size(image, pixel_aspect)
        sizes += f", which players show as {width}x{height}, as its pixels are not square"
    if is_scaled:
        down = "" if pixel_aspect == 1 else f" across and {image[1] / file[1]:.4g} down"
        return f"{sizes}: if one is the other resized, not a part of it, rescale K by {image[0] / file[0]:.4g}{down}"
    if file == image[::-1]:
        return f"{sizes}: one of them is rotated by 90°, or width and height are swapped in the camera file"
    return f"{sizes}, another aspect ratio: it was cropped or is from another camera; give the K of this image"


def _centre_messages(camera: PinholeCamera) -> list[str]:
    offset_px = np.array([camera.cx, camera.cy]) - [(camera.width - 1) / 2, (camera.height - 1) / 2]
    if (np.abs(offset_px) <= MAX_OFFSET * np.array(camera.size_wh)).all():
        return []
    centred = 2 * camera.cx + 1, 2 * camera.cy + 1
    guess = f", but at the centre of an image of {centred[0]:.0f}x{centred[1]:.0f} px" if min(centred) > 0 else ""
    return [
        f"the principal point ({camera.cx:.1f}, {camera.cy:.1f}) lies ({offset_px[0]:+.0f}, {offset_px[1]:+.0f}) px "
        f"off the centre of this image{guess}; check whether K is for another size, or the image was cropped"
    ]


def _focal_messages(camera: PinholeCamera) -> list[str]:
    ratio = min(camera.fx, camera.fy) / max(camera.size_wh)
    if WIDEST <= ratio <= NARROWEST:
        return []
    angle_deg = float(np.degrees(2 * np.arctan(0.5 / ratio)))
    cause = "check its unit"
    if ratio < WIDEST:
        cause = "divide one in millimetres by the size of a pixel, multiply a part of the image's size by that size"
    return [
        f"a focal length of {min(camera.fx, camera.fy):g} px gives this image a field of view of {angle_deg:.3g}°, "
        f"which is unusual; K is in pixels: {cause}"
    ]


def _aspect_messages(camera: PinholeCamera, pixel_aspect: float) -> list[str]:
    difference = abs(camera.fx * pixel_aspect / camera.fy - 1)
    if difference <= MAX_ASPECT_DIFFERENCE:
        return []
    if pixel_aspect != 1:
        return [
            f"fx = {camera.fx:g} and fy = {camera.fy:g}, but the film states that its pixels are not square: "
            f"fx should be {1 / pixel_aspect:.4g} of fy; give the K of the pixels as they are stored"
        ]
    return [
        f"fx = {camera.fx:g} and fy = {camera.fy:g} differ by {difference:.0%}, which only pixels that are not square "
        "explain; check whether the image was stretched, or one of the numbers is wrong"
    ]
