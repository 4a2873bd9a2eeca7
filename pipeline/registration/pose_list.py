"""The poses of registered frames as files: a list in JSON, and BOP's table of estimates."""

import csv
import io
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..alignment.pose_uncertainty import PoseUncertainty
from ..files.content import write_bytes_atomically
from ..files.outputs import writing
from ..transforms import checked_rigid, inverse_rigid
from .register import RegisteredFrame
from .verdict import ACCEPTED, Verdict

POSES, ESTIMATES = "poses.json", "bop_estimates.csv"


def pose_entry(
    name: str, number: int, found: RegisteredFrame, mesh_from_model: np.ndarray, mm_per_unit: float
) -> dict[str, object]:
    """A frame's entry: ``cam_from_mesh`` in the units of the mesh, ``null`` where it is refused."""
    entry: dict[str, object] = {"image": name} if name else {}
    entry |= {"frame": number, "state": found.verdict.state, "probability": round(found.verdict.probability, 4)}
    entry |= {"reason": found.verdict.reason, "cam_from_mesh": None}
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
        found[int(entry["frame"])] = RegisteredFrame(verdict, pose, uncertainty)
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
    with writing(folder / POSES):
        write_bytes_atomically(folder / POSES, encoded_list(entries))
    with writing(folder / ESTIMATES):
        write_bytes_atomically(folder / ESTIMATES, _estimates(entries, mm_per_unit).encode())


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
