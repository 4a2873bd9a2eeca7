"""Image files as code values: a PNG by OpenCV; all else, or all without OpenCV, by a registered decoder.

A PNG says the same to every program. What programs read differently, JPEG by a code value and TIFF by much, is always
read by the same one, so that a view does not depend on who made it: by Blender, whose room registers its decoder.
"""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from ..errors import InputError
from .image_check import LARGEST_FRAME, PNG_SIGNATURE, check_image_file, may_have_alpha

if TYPE_CHECKING:
    # every command registers a decoder, and its --help must not wait for numpy
    import numpy as np

Decoder = Callable[[bytes, str], "np.ndarray"]
"""From the bytes of a checked image file, and what begins messages, to ``(H, W, C)`` float32 code values 0..1."""

_NOT_PLAIN = b"tRNS", b"acTL"
"""Chunks of PNG, of a transparent colour and of an animation, that programs read differently."""

_BEYOND = 1e-3
"""By which floats may exceed 0 to 1: interpolation and rounding do."""

_registered: list[Decoder] = []


def register_decoder(decoder: Decoder) -> None:
    """Let ``decoder`` read what is no plain PNG."""
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
    has_alpha = may_have_alpha(data)
    values = _plain_png(data)
    if values is None:
        if not _registered:
            raise InputError(
                f"{where}: expected a plain PNG, as only Blender reads other images here; import oneframe.blender"
            )
        values = _registered[0](data, where)
        # of floats; NaN is not within it
        if not (values.min() >= -_BEYOND and values.max() <= 1 + _BEYOND):
            raise InputError(
                f"{where}: expected an image of values from 0 to 1, found {values.min():g} to {values.max():g}; save "
                "it as PNG of 8 or 16 bits"
            )
    channels = values.shape[2]
    colours = values[..., :3] if channels >= 3 else np.repeat(values[..., :1], 3, axis=2)
    valid = values[..., 3] > 0 if channels == 4 and has_alpha else np.ones(values.shape[:2], dtype=bool)
    return np.ascontiguousarray(colours), np.ascontiguousarray(valid)


def _plain_png(data: bytes) -> "np.ndarray | None":
    """``(H, W, C)`` float32 of a plain PNG; ``None`` of another file, or without OpenCV."""
    if not data.startswith(PNG_SIGNATURE) or any(chunk in data for chunk in _NOT_PLAIN):
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
