"""Files of a view as arrays, at OpenCV's speed: for reading and for checking a dataset. Needs cv2."""

import cv2
import numpy as np

from ..errors import InputError
from ..files.numbers import npy_array
from ..images.image_check import image_size

Shape = tuple[int, int]
"""Height and width in px."""


def decoded_rgb(data: bytes, shape: Shape, where: str) -> np.ndarray:
    """The ``(H, W, 3)`` uint8 image of a PNG or JPEG file, RGB.

    Raises
    ------
    InputError
        Damaged, or of another size.
    """
    return _checked(_decoded(data, cv2.IMREAD_COLOR_RGB, shape, where), (*shape, 3), np.uint8, where)


def decoded_grey(data: bytes, dtype: type, shape: Shape, where: str) -> np.ndarray:
    """The ``(H, W)`` image of a PNG file with one channel: masks are uint8, 0 or 255, and depths uint16.

    Raises
    ------
    InputError
        Damaged, or of another size or type.
    """
    return _checked(_decoded(data, cv2.IMREAD_UNCHANGED, shape, where), shape, dtype, where)


def decoded_depth(data: bytes, depth_scale: float, shape: Shape, where: str) -> np.ndarray:
    """The ``(H, W)`` float32 depth in mm of a 16-bit PNG file with so many mm a unit.

    Raises
    ------
    InputError
        As :func:`decoded_grey`.
    """
    units = decoded_grey(data, np.uint16, shape, where)
    return np.multiply(units, np.float32(depth_scale), dtype=np.float32)


def decoded_array(data: bytes, shape: Shape, where: str) -> np.ndarray:
    """The ``(H, W)`` float32 array of an ``.npy`` file.

    Raises
    ------
    InputError
        Damaged, or of another size or type.
    """
    # a copy can be written to, as the other arrays
    return _checked(npy_array(data, where), shape, np.float32, where).copy()


def _decoded(data: bytes, flags: int, shape: Shape, where: str) -> np.ndarray | None:
    try:
        width, height = image_size(data)
    except ValueError:
        raise damaged(where) from None
    # before memory is taken for any size that a header claims
    if (height, width) != shape:
        raise damaged(where)
    return cv2.imdecode(np.frombuffer(data, np.uint8), flags)


def _checked(array: np.ndarray | None, shape: tuple[int, ...], dtype: type, where: str) -> np.ndarray:
    if array is None or array.shape != shape or array.dtype != dtype:
        raise damaged(where)
    return array


def damaged(where: str) -> InputError:
    """The error for a file of a view that is none."""
    return InputError(
        f"{where}: expected a file of a view as oneframe writes it, found a damaged one or one of another size; check "
        "the folder (oneframe check, or oneframe pack --verify)"
    )
