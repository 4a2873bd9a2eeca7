"""Photographs with known poses, to compare views with."""

from pathlib import Path

from ..case.case_file import Case
from ..case.posed_frame import UnreadFrame
from ..errors import InputError
from ..files.content import LARGEST_FILE, read_content
from ..files.tables import parsed_json
from ..poses.pose_file import pose_key
from ..transforms import checked_rigid

MOST_PHOTOGRAPHS = 10_000


def read_photographs(path: Path, case: Case) -> tuple[list[UnreadFrame], list[str]]:
    """Read a JSON list of ``{"image": file, "cam_from_mesh": 4x4}``, poses as in the case file.

    Returns
    -------
    The photographs, undistorted and of the case's camera; and messages about what was corrected.

    Raises
    ------
    InputError
        The file is missing or not such a list, it is empty or too long, an image is no file name, or a pose is not
        rigid.
    """
    entries = parsed_json(read_content(path, "a list of photographs", most=LARGEST_FILE), path.name)
    if not isinstance(entries, list) or not all(isinstance(e, dict) and "image" in e for e in entries):
        raise InputError(
            f'{path.name}: expected a list of {{"image": ..., "cam_from_mesh": ...}}, found something else'
        )
    if not 0 < len(entries) <= MOST_PHOTOGRAPHS:
        raise InputError(
            f"{path.name}: expected 1 to {MOST_PHOTOGRAPHS} photographs, found {len(entries)}; "
            + ("split it" if entries else "list some")
        )
    photographs, messages = [], []
    for number, entry in enumerate(entries):
        key = pose_key(entry, f"{path.name}: entry {number}: ")
        pose, message = checked_rigid(entry[key], f"{path.name}: entry {number}: {key}")
        pose[:3, 3] *= case.mm_per_unit
        if not isinstance(entry["image"], str) or not entry["image"]:
            raise InputError(f"{path.name}: entry {number}: image: expected a file name, found {entry['image']!r}")
        photographs.append(UnreadFrame(path.parent / entry["image"], case.camera, None, pose))
        messages += [] if message is None else [message]
    return photographs, messages
