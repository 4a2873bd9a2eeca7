"""Pose files: one pose as ``.npy`` (Vision6D's format), text or JSON, or a list of poses as ``.npy`` or JSON.

All are ``cam_from_mesh``, in the frame of the user's mesh file: see :mod:`oneframe.transforms`.
"""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np

from ..errors import InputError
from ..files.content import LARGEST_FILE, LARGEST_TEXT, decoded, read_content
from ..files.numbers import npy_array, number_rows
from ..files.tables import parsed_json
from ..transforms import checked_rigid

POSE_KEY = "cam_from_mesh"
LARGEST_LIST = 128 << 20
"""Bytes of an array of poses: a million of them."""

FORMER_POSE_KEY = "cam_from_model"
"""The name of :data:`POSE_KEY` in files of version 0.1; readers accept it."""


def pose_key(table: Mapping[str, object], where: str) -> str:
    """Find the key of the pose in a table; ``where`` begins the message, such as ``"case.toml: [pose] "``.

    Raises
    ------
    InputError
        There is no such key, or there are two.
    """
    found = [key for key in (POSE_KEY, FORMER_POSE_KEY) if key in table]
    if not found:
        raise InputError(f"{where}expected the key {POSE_KEY}, found {', '.join(list(table)[:20]) or 'none'}")
    if len(found) > 1:
        raise InputError(f"{where}expected either {POSE_KEY} or its old name {FORMER_POSE_KEY}, found both; remove one")
    return found[0]


def read_pose(path: Path, *, mm_per_unit: float = 1.0) -> tuple[np.ndarray, str | None]:
    """Read ``cam_from_mesh``: from the mesh file's frame to a camera with OpenCV axes, as Vision6D saves it.

    Parameters
    ----------
    path
        ``.npy`` with a 4x4 array, a text of 16 numbers row by row, or JSON: 4 rows of 4 numbers, or a dictionary with
        one such entry.
    mm_per_unit
        Factor from the unit of the translation (that of the mesh) to millimetres.

    Returns
    -------
    ``(4, 4)`` float64, mm, and a message if the rotation had to be corrected, else ``None``.

    Raises
    ------
    InputError
        The file is missing or has another format, or the pose is not rigid (see
        :func:`oneframe.transforms.checked_rigid`).
    """
    path = Path(path)
    data = read_content(path, "a file with a pose", most=LARGEST_FILE)
    cam_from_mesh, message = checked_rigid(_matrix(data, path.name), path.name)
    cam_from_mesh[:3, 3] *= mm_per_unit
    return cam_from_mesh, message


def _matrix(data: bytes, name: str) -> object:
    if data.startswith(b"\x93NUMPY"):
        array = npy_array(data, name)
        return array.reshape(4, 4) if array.size == 16 else array
    text = decoded(data) if len(data) <= LARGEST_TEXT else None
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
    found = {
        key: value
        for key, value in parsed_json(text, name).items()
        if isinstance(value, list) and len(value) == 4 and all(isinstance(row, list) and len(row) == 4 for row in value)
    }
    for key in (POSE_KEY, FORMER_POSE_KEY):
        if key in found:
            return found[key]
    if len(found) != 1:
        names = ", ".join(map(repr, list(found)[:20])) or "none"
        raise InputError(
            f"{name}: expected one entry of 4 rows of 4 numbers, found {names}; keep only one pose in the file"
        )
    return next(iter(found.values()))


def read_poses(
    path: Path | str, *, mesh_from_model: np.ndarray, mm_per_unit: float = 1.0
) -> tuple[np.ndarray, list[str]]:
    """Read explicit poses from a ``.npy`` or ``.json`` file. Pickled objects are refused and never loaded.

    A ``.npy`` file holds a real array ``(N, 4, 4)``, or ``(4, 4)`` for one pose; a ``.json`` file the same as nested
    lists, or a list of objects with the key ``cam_from_mesh``.

    Parameters
    ----------
    path
        The file.
    mesh_from_model
        ``(4, 4)`` rigid, mm.
    mm_per_unit
        Factor from the unit of the translations to millimetres, e.g. 1000 if the poses are in metres.

    Returns
    -------
    ``(N, 4, 4)`` rigid ``cam_from_model``, mm, and messages for the user.

    Raises
    ------
    InputError
        Another extension; a file that is missing, unreadable or corrupt; not poses, or none; a pose that is not rigid
        (see :func:`oneframe.transforms.checked_rigid`; the message names its index from 0); a useless ``mm_per_unit``.
    """
    path = Path(path)
    if not (mm_per_unit > 0 and np.isfinite(mm_per_unit)):
        raise InputError(f"{path.name}: expected a positive number of mm per unit of the poses, found {mm_per_unit:g}")
    if path.suffix.lower() not in _LISTED:
        raise InputError(f"{path}: expected poses in a .npy or .json file, found extension {path.suffix!r}")
    content = read_content(
        path, "a list of poses", most=LARGEST_FILE if path.suffix.lower() == ".json" else LARGEST_LIST
    )
    entries = _LISTED[path.suffix.lower()](content, path.name)
    if not entries:
        raise InputError(f"{path.name}: expected poses, found an empty list")
    cams_from_model = np.empty((len(entries), 4, 4))
    corrected: list[str] = []
    for index, matrix in enumerate(entries):
        pose, message = checked_rigid(matrix, f"{path.name}: pose {index} (counted from 0)")
        pose[:3, 3] *= mm_per_unit
        cams_from_model[index] = pose @ mesh_from_model
        corrected += [message] if message else []
    messages = corrected[:1]
    if len(corrected) > 1:
        messages.append(f"{path.name}: the rotations of {len(corrected) - 1} other poses were corrected too")
    return cams_from_model, messages


def _array_entries(data: bytes, name: str) -> Sequence[object]:
    array = npy_array(data, name)
    if array.shape[-2:] != (4, 4) or array.ndim not in (2, 3):
        raise InputError(f"{name}: expected shape (N, 4, 4) or (4, 4), found {array.shape}")
    return list(array.reshape(-1, 4, 4))


def _json_entries(data: bytes, name: str) -> list[object]:
    # whole numbers as float too: one of 400 digits becomes infinity, and the error then names the pose
    found = parsed_json(data, name, parse_int=float)
    if isinstance(found, dict) or (_is_list(found) and _is_list(found[0]) and not _is_list(found[0][0])):
        found = [found]
    if not isinstance(found, list):
        raise InputError(f"{name}: expected a list of poses, found {type(found).__name__}")
    return [_json_entry(entry, f"{name}: pose {index} (counted from 0)") for index, entry in enumerate(found)]


def _json_entry(entry: object, where: str) -> object:
    if not isinstance(entry, dict):
        return entry
    return entry[pose_key(entry, f"{where}: ")]


def _is_list(value: object) -> bool:
    return isinstance(value, list) and len(value) > 0


_LISTED: dict[str, Callable[[bytes, str], Sequence[object]]] = {".npy": _array_entries, ".json": _json_entries}


def read_frame_poses(
    path: Path | str, frames: int, *, mesh_from_model: np.ndarray, mm_per_unit: float = 1.0
) -> tuple[list[np.ndarray | None], list[str]]:
    """Read a pose for each frame of a video from a ``.npy`` or ``.json`` file.

    A ``.npy`` file holds ``(N, 4, 4)``, with NaN for frames without a pose; a ``.json`` file a list of poses, or of
    objects with the key ``cam_from_mesh``, with ``null`` for frames without. If the objects have the key ``frame``, a
    whole number from 0, frames that no object names have no pose.

    Parameters
    ----------
    path
        The file.
    frames
        How many the video has.
    mesh_from_model, mm_per_unit
        As for :func:`read_poses`.

    Returns
    -------
    For each frame the rigid ``cam_from_model`` (4x4, mm) or ``None``; and messages for the user.

    Raises
    ------
    InputError
        As for :func:`read_poses`; or the number of poses is not that of the frames, a frame is named twice or does not
        exist, or no frame has a pose.
    """
    path = Path(path)
    if path.suffix.lower() not in _LISTED:
        raise InputError(f"{path}: expected poses in a .npy or .json file, found extension {path.suffix!r}")
    is_json = path.suffix.lower() == ".json"
    content = read_content(path, "a list of poses", most=LARGEST_FILE if is_json else LARGEST_LIST)
    found = (
        _frame_entries(content, path.name, frames) if is_json else dict(enumerate(_array_entries(content, path.name)))
    )
    if found.keys() - range(frames) or (len(found) != frames and not is_json):
        raise _other_number(path.name, len(found), frames)
    poses: list[np.ndarray | None] = [None] * frames
    messages: list[str] = []
    for number, matrix in found.items():
        if matrix is None or (isinstance(matrix, np.ndarray) and np.isnan(matrix).all()):
            continue
        pose, message = checked_rigid(matrix, f"{path.name}: pose of frame {number} (counted from 0)")
        pose[:3, 3] *= mm_per_unit
        poses[number] = pose @ mesh_from_model
        messages += [message] if message else []
    if all(pose is None for pose in poses):
        raise InputError(f"{path.name}: expected a pose for some of the {frames} frames, found none")
    if len(messages) > 1:
        others = f"{path.name}: the rotations of {len(messages) - 1} other poses were corrected too"
        messages = [messages[0], others]
    return poses, messages


def _frame_entries(data: bytes, name: str, frames: int) -> dict[int, object]:
    """Frame -> its entry."""
    found = parsed_json(data, name, parse_int=float)
    if not isinstance(found, list):
        raise InputError(f"{name}: expected a list of poses, one a frame, found {type(found).__name__}")
    keyed = [isinstance(entry, dict) and "frame" in entry for entry in found]
    if not any(keyed):
        if len(found) != frames:
            raise _other_number(name, len(found), frames)
        return {
            number: None if entry is None else _json_entry(entry, f"{name}: pose of frame {number} (counted from 0)")
            for number, entry in enumerate(found)
        }
    entries: dict[int, object] = {}
    for index, entry in enumerate(found):
        where = f"{name}: entry {index} (counted from 0)"
        if not isinstance(entry, dict) or "frame" not in entry:
            raise InputError(f"{where}: expected the key frame, as other entries have it")
        number = entry["frame"]
        if not (isinstance(number, float) and number.is_integer() and 0 <= number < frames):
            raise InputError(f"{where}: expected frame = 0 to {frames - 1}, found {number!r}")
        if int(number) in entries:
            raise InputError(f"{where}: expected one pose for each frame, found another one for frame {number:.0f}")
        entries[int(number)] = _json_entry(entry, where)
    return entries


def _other_number(name: str, poses: int, frames: int) -> InputError:
    return InputError(
        f"{name}: expected a pose for each of the {frames} frames of the video, found {poses}; write null (JSON) or "
        "NaN (npy) for frames without a pose"
    )
