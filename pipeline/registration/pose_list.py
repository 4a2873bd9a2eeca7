"""Lists of photographs with poses, in JSON: of registered frames, beside BOP's table of estimates; and read."""

import csv
import io
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..alignment.pose_uncertainty import PoseUncertainty
from ..camera.distortion import checked_distortion
from ..case.case_file import Case
from ..case.frame import UnreadFrame
from ..errors import InputError
from ..files.content import read_content
from ..files.outputs import write_output
from ..files.tables import parsed_json
from ..poses.pose_file import POSE_KEY, is_without_pose, read_poses
from ..transforms import checked_rigid, inverse_rigid
from .register import RegisteredFrame
from .verdict import ACCEPTED, Verdict

POSES, ESTIMATES = "poses.json", "bop_estimates.csv"
DISTORTION, CHANGED = "distortion", "changed"
"""Keys of an entry: in a list of photographs; of frames in which a film no longer shows what the case's frame shows."""


def pose_entry(
    name: str, number: int, found: RegisteredFrame, mesh_from_model: np.ndarray, mm_per_unit: float
) -> dict[str, object]:
    """A frame's entry: ``cam_from_mesh`` in the units of the mesh, ``null`` where it is refused."""
    entry: dict[str, object] = {"image": name} if name else {}
    entry |= {"frame": number, "state": found.verdict.state, "probability": round(found.verdict.probability, 4)}
    entry |= {"reason": found.verdict.reason, "cam_from_mesh": None}
    entry |= {CHANGED: True} if found.changed else {}
    if found.cam_from_model is None or found.uncertainty is None:
        return entry
    pose = found.cam_from_model @ inverse_rigid(mesh_from_model)
    pose[:3, 3] /= mm_per_unit
    return entry | {"cam_from_mesh": pose.tolist(), **found.uncertainty.entry(mesh_from_model)}


def found_of(entries: Sequence[Any], mesh_from_model: np.ndarray, mm_per_unit: float) -> dict[int, RegisteredFrame]:
    """Number of a frame -> what its entry says of it, without the fit: the inverse of :func:`pose_entry`.

    Raises
    ------
    KeyError, TypeError, ValueError
        An entry is not one of these.
    """
    found = {}
    for entry in entries:
        verdict = Verdict(str(entry["state"]), float(entry["probability"]), str(entry["reason"]))
        pose = uncertainty = None
        if entry["cam_from_mesh"] is not None:
            cam_from_mesh, _ = checked_rigid(entry["cam_from_mesh"], "cam_from_mesh")
            cam_from_mesh[:3, 3] *= mm_per_unit
            pose = cam_from_mesh @ mesh_from_model
            uncertainty = PoseUncertainty.of_entry(entry, pose, mesh_from_model)
        found[int(entry["frame"])] = RegisteredFrame(verdict, pose, uncertainty, changed=bool(entry.get(CHANGED)))
    return found


def encoded_list(entries: Sequence[Mapping[str, object]]) -> bytes:
    """The JSON of a list."""
    text = json.dumps(list(entries), indent=1, allow_nan=False, ensure_ascii=False) + "\n"
    # names of files that are no Unicode as JSON's escapes, with which Python finds them again
    return text.encode(errors="backslashreplace")


def write_poses(folder: Path, entries: Sequence[dict[str, object]], mm_per_unit: float) -> None:
    """Write both files.

    Raises
    ------
    RunError
        They cannot be written.
    """
    write_output(folder / POSES, encoded_list(entries))
    write_output(folder / ESTIMATES, _estimates(entries, mm_per_unit).encode())


def _estimates(entries: Sequence[dict[str, object]], mm_per_unit: float) -> str:
    """BOP's estimates (Hodaň et al. 2018): the accepted poses, in mm, with their probability as the score."""
    table = io.StringIO()
    writer = csv.writer(table, lineterminator="\n")
    writer.writerow(("scene_id", "im_id", "obj_id", "score", "R", "t", "time"))
    for entry in entries:
        if entry["cam_from_mesh"] is None or entry["state"] != ACCEPTED:
            continue
        pose = np.array(entry["cam_from_mesh"])
        rotation, position = (
            " ".join(f"{value:.9g}" for value in values.ravel()) for values in (pose[:3, :3], mm_per_unit * pose[:3, 3])
        )
        writer.writerow((1, entry["frame"], 1, entry["probability"], rotation, position, -1))
    return table.getvalue()


def read_photographs(path: Path, case: Case) -> tuple[list[UnreadFrame], list[str]]:
    """Read a JSON list of ``{"image": file, "cam_from_mesh": 4x4}``, poses as in the case file, or ``null``: left out.

    Photographs as the lens took them have its ``"distortion"`` in their entry, as in the case file.

    Returns
    -------
    The photographs, of the case's camera; and messages about what was corrected.

    Raises
    ------
    InputError
        As :func:`.read_poses`, an entry names no image, or its distortion is none.
    """
    poses, messages = read_poses(path, mesh_from_model=np.eye(4), mm_per_unit=case.mm_per_unit)
    entries: Any = parsed_json(read_content(path, "a list of photographs"), path.name)
    entries = [entry for entry in entries if not is_without_pose(entry)]
    images: list[Any] = [entry.get("image") if isinstance(entry, dict) else None for entry in entries]
    for number, image in enumerate(images):
        if not isinstance(image, str) or not image:
            raise InputError(
                f'{path.name}: entry {number}: expected {{"image": file, "{POSE_KEY}": ...}}, found image {image!r}'
            )
    lenses = [
        checked_distortion(entry[DISTORTION], case.camera, f"{path.name}: entry {number}: {DISTORTION}")
        if DISTORTION in entry
        else None
        for number, entry in enumerate(entries)
    ]
    return [
        UnreadFrame(path.parent / image, case.camera, lens, pose)
        for image, lens, pose in zip(images, lenses, poses, strict=True)
    ], messages
