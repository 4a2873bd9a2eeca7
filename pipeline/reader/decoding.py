"""Files of a view as arrays, at OpenCV's speed."""

import io
import json
from typing import Any

import cv2
import numpy as np

from ..errors import InputError
from ..images.image_check import image_size
from ..packing.mask_runs import mask_columns

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


def decoded_depth(data: bytes, depth_scale: float, shape: Shape, where: str) -> np.ndarray:
    """The ``(H, W)`` float32 depth in mm of a 16-bit PNG file with so many mm a unit.

    Raises
    ------
    InputError
        Damaged, or of another size.
    """
    units = _checked(_decoded(data, cv2.IMREAD_UNCHANGED, shape, where), shape, np.uint16, where)
    return np.multiply(units, np.float32(depth_scale), dtype=np.float32)


def decoded_array(data: bytes, shape: Shape, where: str) -> np.ndarray:
    """The ``(H, W)`` float32 array of an ``.npy`` file.

    Raises
    ------
    InputError
        Damaged, or of another size or type.
    """
    stream = io.BytesIO(data)
    try:
        if np.lib.format.read_magic(stream) != (1, 0):
            raise ValueError
        found, by_columns, dtype = np.lib.format.read_array_header_1_0(stream)
        # np.load would first take memory for any size that the header claims
        if found != shape or by_columns or dtype != np.float32:
            raise ValueError
        # a copy can be written to, as the other arrays
        array = np.frombuffer(data, np.float32, offset=stream.tell()).reshape(shape).copy()
    except (ValueError, EOFError, OSError):
        raise _damaged(where) from None
    return array


def decoded_mask_image(data: bytes, shape: Shape, where: str) -> np.ndarray:
    """The ``(H, W)`` bool mask of an 8-bit PNG file.

    Raises
    ------
    InputError
        Damaged, or of another size.
    """
    return _checked(_decoded(data, cv2.IMREAD_UNCHANGED, shape, where), shape, np.uint8, where) != 0


def decoded_run_lengths(data: bytes, shape: Shape, where: str) -> np.ndarray:
    """The ``(H, W)`` bool mask of the first object in a file of run lengths, as BOP writes it.

    Raises
    ------
    InputError
        Damaged, or of another size.
    """
    # OpenCV transposes in blocks
    return cv2.transpose(mask_columns(data, shape, where)).view(bool)


def parsed(data: bytes, where: str) -> Any:
    """The JSON value of a file.

    Raises
    ------
    InputError
        No JSON.
    """
    try:
        return json.loads(data)
    except (ValueError, RecursionError):
        raise _damaged(where) from None


def _decoded(data: bytes, flags: int, shape: Shape, where: str) -> np.ndarray | None:
    try:
        width, height = image_size(data)
    except ValueError:
        raise _damaged(where) from None
    # before memory is taken for any size that a header claims
    if (height, width) != shape:
        raise _damaged(where)
    return cv2.imdecode(np.frombuffer(data, np.uint8), flags)


def _checked(array: np.ndarray | None, shape: tuple[int, ...], dtype: type, where: str) -> np.ndarray:
    if array is None or array.shape != shape or array.dtype != dtype:
        raise _damaged(where)
    return array


def _damaged(where: str) -> InputError:
    return InputError(
        f"{where}: expected a file of a view as oneframe writes it, found a damaged one or one of another size; check "
        "the folder (oneframe check, or oneframe pack --verify)"
    )
