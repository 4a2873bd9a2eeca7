"""``dataset.json`` against the case that the dataset was rendered from: files, camera, unit and pose."""

import hashlib
from pathlib import Path

import numpy as np

from ...case.case_file import Case
from ...errors import InputError
from ...files.content import reading
from ...poses.pose_file import read_poses
from .checksums import poses_hash
from .comparison import is_close
from .findings import Findings
from .records import Description

KIND = "inputs that differ from the case's"


def check_inputs(description: Description, case: Case, poses: Path | None, findings: Findings) -> None:
    """Compare the hashes in ``dataset.json`` with the case's files now, and the pose of the frame with the case's.

    Parameters
    ----------
    poses
        The file of the views' poses, if they were listed and the case does not name it.

    Raises
    ------
    InputError
        The file of the poses is not known.
    """
    content = description.content
    files = {name: path for name, path in case.input_files().items() if name != "case"}
    if "poses" in case.dataset:
        files["poses"] = case.path.parent / str(case.dataset["poses"])
    if poses is not None:
        files["poses"] = poses
    hashes = content["inputs_sha256"]
    if description.poses_hash is not None:
        if "poses" not in files:
            raise InputError("command line: the views have listed poses: expected their file, give it with --poses")
        _check_poses(description, files["poses"], findings)
    for name in sorted(hashes.keys() | (files.keys() - {"poses"})):
        if name not in files:
            findings.add(KIND, f"dataset.json: expected the inputs of {case.path}, which names no {name}")
            continue
        try:
            with reading(files[name], f"the {name} of the dataset"), files[name].open("rb") as stream:
                same = hashlib.file_digest(stream, "sha256").hexdigest() == hashes.get(name)
        except InputError as error:
            findings.add(KIND, error)
            continue
        if not same:
            findings.add(KIND, f"dataset.json: inputs_sha256: {files[name]} is not the {name} of the dataset")
    frame = content["frame"]
    cam_from_model = case.cam_from_mesh @ description.mesh_from_model
    if not is_close(frame["cam_from_model"], cam_from_model, float(np.abs(cam_from_model).max())):
        findings.add(KIND, f"dataset.json: frame: cam_from_model is not the pose in {case.path}")
    for name in ("width", "height", "fx", "fy", "cx", "cy"):
        if frame[name] != getattr(case.camera, name):
            expected = getattr(case.camera, name)
            findings.add(KIND, f"dataset.json: frame: {name} is {frame[name]}, {case.path} has {expected}")
    if content["mm_per_unit"] != case.mm_per_unit:
        findings.add(KIND, f"dataset.json: mm_per_unit is {content['mm_per_unit']}, {case.path} has {case.mm_per_unit}")


def _check_poses(description: Description, path: Path, findings: Findings) -> None:
    """Check that a list of poses begins with those of the views."""
    try:
        poses, _ = read_poses(
            path, mesh_from_model=description.mesh_from_model, mm_per_unit=description.content["mm_per_unit"]
        )
    except InputError as error:
        findings.add(KIND, error)
        return
    if len(poses) < description.count or poses_hash(poses[: description.count]) != description.poses_hash:
        findings.add(KIND, f"dataset.json: poses_sha256: {path} does not hold the poses of the dataset")
