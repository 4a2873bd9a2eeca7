"""Pose files: one pose as ``.npy`` (Vision6D's format), text or JSON, or a list of poses as ``.npy`` or JSON.

All are ``cam_from_mesh``, in the frame of the user's mesh file: see :mod:`oneframe.transforms`.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import InputError
from ..files.content import LARGEST_FILE, LARGEST_TEXT, decoded, read_content
from ..files.numbers import npy_array, number_rows
from ..files.tables import parsed_json
from ..transforms import checked_rigid

POSE_KEY = "cam_from_mesh"
LARGEST_LIST = 128 << 20
"""Bytes of an array of poses: a million of them."""

OTHER_CONVENTION = (
    "cam_from_mesh maps the mesh to OpenCV axes (z forward): invert the matrix if it is mesh_from_cam, negate its 2nd "
    "and 3rd row if its axes are OpenGL's, and give mesh and translation in the same unit"
)
"""What to do about poses that show nothing."""


def read_pose(path: Path, *, mm_per_unit: float = 1.0) -> tuple[np.ndarray, str | None]:
    """Read ``cam_from_mesh``: from the mesh file's frame to a camera with OpenCV axes, as Vision6D saves it.

    Parameters
    ----------
    path
        ``.npy`` with a 4x4 array, a text of 16 numbers row by row, or JSON: 4 rows of 4 numbers, alone or under the key
        ``cam_from_mesh``.
    mm_per_unit
        Factor from the unit of the translation (that of the mesh) to millimetres.

    Returns
    -------
    ``(4, 4)`` float64, mm, and a message if the rotation had to be corrected, else ``None``.
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
        raise InputError(f"{name}: expected 4 rows of 4 numbers, with decimal points, found {found}")
    return numbers.reshape(4, 4)


def _entry(text: str, name: str) -> object:
    """The pose of a JSON dictionary; under another name a matrix may go the other way, or have other axes."""
    table = parsed_json(text, name)
    found = table.get(POSE_KEY)
    if found is None:
        names = ", ".join(map(repr, list(table)[:20])) or "none"
        raise InputError(
            f"{name}: expected the key {POSE_KEY}, found {names}; write {POSE_KEY}, from the mesh file's frame to a "
            "camera with x right, y down, z forward: a camera-to-world matrix is its inverse, and OpenGL's axes (NeRF, "
            "Blender) point y up and z back"
        )
    return found


def read_poses(
    path: Path | str, *, mesh_from_model: np.ndarray, mm_per_unit: float = 1.0
) -> tuple[np.ndarray, list[str]]:
    """Read explicit poses from a ``.npy`` or ``.json`` file. Pickled objects are refused and never loaded.

    A ``.npy`` file holds a real array ``(N, 4, 4)``, or ``(4, 4)`` for one pose; a ``.json`` file the same as nested
    lists, or a list of objects with the key ``cam_from_mesh``. Objects in which it is ``null`` are left out, with a
    message.

    ``mesh_from_model`` is ``(4, 4)`` rigid, mm; ``mm_per_unit`` the factor from the unit of the translations to
    millimetres, e.g. 1000 if the poses are in metres.

    Returns
    -------
    ``(N, 4, 4)`` rigid ``cam_from_model``, mm, and messages for the user.
    """
    path = Path(path)
    entries = _listed(path)
    if not entries:
        raise InputError(f"{path.name}: expected poses, found an empty list")
    given = {number: entry for number, entry in enumerate(entries) if not is_without_pose(entry)}
    if not given:
        raise InputError(f"{path.name}: expected poses, found {len(entries)} entries without one")
    found, messages = _converted(given, f"{path.name}: pose", mesh_from_model, mm_per_unit)
    if left_out := len(entries) - len(given):
        messages.append(f"{path.name}: {left_out} of {len(entries)} entries have no pose and are left out")
    return np.stack([*found.values()]), messages


def is_without_pose(entry: object) -> bool:
    """Whether an object of a list says that there is no pose, as of a frame that was not registered."""
    return isinstance(entry, dict) and entry.get(POSE_KEY, entry) is None


def _listed(path: Path) -> list[Any]:
    """The poses in a file, unchecked: arrays of ``.npy``, or what JSON holds."""
    suffix = path.suffix.lower()
    if suffix not in (".npy", ".json"):
        raise InputError(f"{path}: expected poses in a .npy or .json file, found extension {path.suffix!r}")
    data = read_content(path, "a list of poses", most=LARGEST_FILE if suffix == ".json" else LARGEST_LIST)
    if suffix == ".npy":
        array = npy_array(data, path.name)
        if array.shape[-2:] != (4, 4) or array.ndim not in (2, 3):
            raise InputError(f"{path.name}: expected shape (N, 4, 4) or (4, 4), found {array.shape}")
        return list(array.reshape(-1, 4, 4))
    # whole numbers as float too: one of 400 digits becomes infinity, and the error then names the pose
    found: Any = parsed_json(data, path.name, parse_int=float)
    if isinstance(found, dict) or (_is_list(found) and _is_list(found[0]) and not _is_list(found[0][0])):
        found = [found]
    if not isinstance(found, list):
        raise InputError(f"{path.name}: expected a list of poses, found {type(found).__name__}")
    return found


def _is_list(value: object) -> bool:
    return isinstance(value, list) and len(value) > 0


def _converted(
    entries: Mapping[int, Any], what: str, mesh_from_model: np.ndarray, mm_per_unit: float
) -> tuple[dict[int, np.ndarray], list[str]]:
    """``cam_from_model`` (4x4, mm) of each entry by its number, and messages; ``what`` begins those of one."""
    poses: dict[int, np.ndarray] = {}
    corrected = []
    for number, entry in entries.items():
        where = f"{what} {number} (counted from 0)"
        if isinstance(entry, dict) and POSE_KEY not in entry:
            raise InputError(f"{where}: expected the key {POSE_KEY}, found {', '.join(list(entry)[:20]) or 'none'}")
        matrix = entry[POSE_KEY] if isinstance(entry, dict) else entry
        pose, message = checked_rigid(matrix, where)
        pose[:3, 3] *= mm_per_unit
        poses[number] = pose @ mesh_from_model
        corrected += [message] if message else []
    if len(corrected) > 1:
        name = what.partition(":")[0]
        return poses, [corrected[0], f"{name}: the rotations of {len(corrected) - 1} other poses were corrected too"]
    return poses, corrected


def read_frame_poses(
    path: Path | str, frames: int, *, mesh_from_model: np.ndarray, mm_per_unit: float = 1.0
) -> tuple[list[np.ndarray | None], list[str]]:
    """Read a pose for each frame of a video from a ``.npy`` or ``.json`` file.

    A ``.npy`` file holds ``(N, 4, 4)``, with NaN for frames without a pose; a ``.json`` file a list of poses, or of
    objects with the key ``cam_from_mesh``, with ``null`` for frames, or for the ``cam_from_mesh`` of frames, without.
    If the objects have the key ``frame``, a whole number from 0, frames that no object names have no pose.

    ``frames`` is how many the video has; the rest is as for :func:`read_poses`.

    Returns
    -------
    For each frame the rigid ``cam_from_model`` (4x4, mm) or ``None``; and messages for the user.
    """
    path = Path(path)
    entries = _by_frame(_listed(path), path.name, frames)
    given = {number: entry for number, entry in entries.items() if not _is_empty(entry)}
    if not given:
        raise InputError(f"{path.name}: expected a pose for some of the {frames} frames, found none")
    found, messages = _converted(given, f"{path.name}: pose of frame", mesh_from_model, mm_per_unit)
    return [found.get(number) for number in range(frames)], messages


def _is_empty(entry: Any) -> bool:
    """Whether an entry says that a frame has no pose."""
    if isinstance(entry, dict) and POSE_KEY in entry:
        entry = entry[POSE_KEY]
    return entry is None or (isinstance(entry, np.ndarray) and bool(np.isnan(entry).all()))


def _by_frame(found: list[Any], name: str, frames: int) -> dict[int, Any]:
    """Frame -> its entry."""
    if not any(isinstance(entry, dict) and "frame" in entry for entry in found):
        if len(found) != frames:
            raise InputError(
                f"{name}: expected a pose for each of the {frames} frames of the video, found {len(found)}; write null "
                "(JSON) or NaN (npy) for frames without a pose"
            )
        return dict(enumerate(found))
    entries: dict[int, Any] = {}
    for index, entry in enumerate(found):
        where = f"{name}: entry {index} (counted from 0)"
        if not isinstance(entry, dict) or "frame" not in entry:
            raise InputError(f"{where}: expected the key frame, as other entries have it")
        if entry.get("image"):
            raise InputError(f"{where}: expected a frame of the video, found an image of a folder; register the video")
        number = entry["frame"]
        if not (isinstance(number, float) and number.is_integer() and 0 <= number < frames):
            raise InputError(f"{where}: expected frame = 0 to {frames - 1}, found {number!r}")
        if int(number) in entries:
            raise InputError(f"{where}: expected one pose for each frame, found another one for frame {number:.0f}")
        entries[int(number)] = entry
    return entries
