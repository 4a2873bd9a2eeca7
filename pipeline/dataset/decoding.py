"""Files of a view as arrays, at OpenCV's speed: for reading and for checking a dataset. Needs cv2."""

import cv2
import numpy as np

from ..errors import InputError
from ..files.numbers import npy_array
from ..images.image_check import image_size
from .truths import Form

Shape = tuple[int, int]
"""Height and width in px."""


def decoded(data: bytes, form: Form, shape: Shape, where: str) -> np.ndarray:
    """The array of a view of this height and width in a file; colours are RGB, also from a JPEG file."""
    if form.ending == ".npy":
        # a copy can be written to, as the other arrays
        array = npy_array(data, where).copy()
    else:
        try:
            width, height = image_size(data)
        except ValueError:
            raise _damaged(where) from None
        # before memory is taken for any size that a header claims
        if (height, width) != shape:
            raise _damaged(where)
        flags = cv2.IMREAD_UNCHANGED if form.channels == 1 else cv2.IMREAD_COLOR_RGB | cv2.IMREAD_ANYDEPTH
        array = cv2.imdecode(np.frombuffer(data, np.uint8), flags)
    if array is None or array.shape != form.shape(shape) or array.dtype != form.dtype:
        raise _damaged(where)
    return array


def depth_mm(units: np.ndarray, depth_scale: float) -> np.ndarray:
    """``(H, W)`` float32 depth in mm of a depth image with so many mm a unit."""
    return np.multiply(units, np.float32(depth_scale), dtype=np.float32)


def _damaged(where: str) -> InputError:
    """The error for a file of a view that is none."""
    return InputError(
        f"{where}: expected a file of a view as oneframe writes it, found a damaged one or one of another size; check "
        "the folder (oneframe check, or oneframe pack --verify)"
    )
