"""Image files as code values: a PNG by OpenCV; all else, or all without OpenCV, by a registered decoder.

A PNG says the same to every program. A JPEG, which programs read differently by a code value, is always read by the
same one, so that a view does not depend on who made it: by Blender, whose room registers its decoder.
"""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from ..errors import InputError
from .image_check import LARGEST_FRAME, PNG_SIGNATURE, check_image_file

if TYPE_CHECKING:
    # every command registers a decoder, and its --help must not wait for numpy
    import numpy as np

Decoder = Callable[[bytes, str], "np.ndarray"]
"""From the bytes of a checked image file, and what begins messages, to ``(H, W, C)`` float32 code values 0..1."""

_MOST_LABELS, _LEAST_IN_USE = 32, 0.25
"""With so many values, 16 bits hold a mask or labels; with more below the second, 8 bits or a sensor's codes."""

_BYTE_ROUNDING = 0.01

_registered: list[Decoder] = []


def register_decoder(decoder: Decoder) -> None:
    """Let ``decoder`` read what is no PNG."""
    _registered[:] = [decoder]


def read_image(path: Path, where: str = "") -> "tuple[np.ndarray, np.ndarray]":
    """Read an image file as code values between 0 and 1.

    Returns
    -------
    ``(H, W, 3)`` float32 RGB, 8-bit values divided by 255 and 16-bit ones by 65535 (grey is repeated), top row first;
    ``(H, W)`` bool, False where the file's alpha is 0: pixels without image, such as outside a circular field of view.
    """
    import numpy as np

    where = where or str(path)
    data = check_image_file(path, where, most_pixels=LARGEST_FRAME)
    values = _png(data)
    if values is None:
        if not _registered:
            raise InputError(
                f"{where}: expected a PNG, as only Blender reads other images here; import oneframe.blender"
            )
        values = _registered[0](data, where)
    channels = values.shape[2]
    colours = values[..., :3] if channels >= 3 else np.repeat(values[..., :1], 3, axis=2)
    valid = values[..., 3] > 0 if channels == 4 else np.ones(values.shape[:2], dtype=bool)
    brightest = float(colours.max())
    is_deep = brightest < _LEAST_IN_USE and (np.abs(colours * 255 - np.rint(colours * 255)) > _BYTE_ROUNDING).any()
    if is_deep and len(np.unique(colours)) > _MOST_LABELS:
        raise InputError(
            f"{where}: expected 16 bits that are in use, the brightest is {brightest * 65535:.0f} of 65535, as of "
            "8 to 14 bits stored in 16; stretch them to the full range, and save it as PNG"
        )
    return np.ascontiguousarray(colours), np.ascontiguousarray(valid)


def _png(data: bytes) -> "np.ndarray | None":
    """``(H, W, C)`` float32 of a PNG; ``None`` of another file, or without OpenCV."""
    if not data.startswith(PNG_SIGNATURE):
        return None
    import numpy as np

    try:
        import cv2
    except ModuleNotFoundError:
        return None
    image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    if image is None:
        return None
    image = image.reshape(*image.shape[:2], -1)
    image = image[..., [2, 1, 0, 3][: image.shape[2]]] if image.shape[2] > 1 else image
    # a product, as Blender's, not a quotient: they differ in the last bit
    return image.astype(np.float32) * (np.float32(1) / np.float32(255 if image.dtype == np.uint8 else 65535))
