"""``dataset.json`` against the case that the dataset was rendered from: files, camera, unit and pose."""

import hashlib
from pathlib import Path

from ...case.case_file import Case
from ...errors import InputError
from ...files.content import reading
from ...poses.pose_file import read_poses
from ..dataset_file import Description
from ..description import described_frame
from ..identity import poses_hash
from .comparison import RELATIVE, require_equal
from .findings import Findings

KIND = "inputs that differ from the case's"


def check_inputs(description: Description, case: Case, poses: Path | None, findings: Findings) -> None:
    """Compare the hashes in ``dataset.json`` with the case's files now, and the pose of the frame with the case's.

    Parameters
    ----------
    poses
        The file of the views' poses, if they were listed and the case does not name it.
    """
    content = description.content
    files = {name: path for name, path in case.input_files().items() if name != "case"}
    if "poses" in case.dataset:
        files["poses"] = case.path.parent / str(case.dataset["poses"])
    if poses is not None:
        files["poses"] = poses
    if description.poses_hash is not None:
        if "poses" not in files:
            raise InputError("command line: the views have listed poses: expected their file, give it with --poses")
        with findings.collecting(KIND):
            _check_poses(description, files["poses"])
    hashes = content.get("inputs_sha256", {})
    for name in sorted(hashes.keys() | (files.keys() - {"poses"})):
        with findings.collecting(KIND):
            if name not in files:
                raise InputError(f"dataset.json: expected the inputs of {case.path}, which names no {name}")
            with reading(files[name], f"the {name} of the dataset"), files[name].open("rb") as stream:
                same = hashlib.file_digest(stream, "sha256").hexdigest() == hashes.get(name)
            if not same:
                raise InputError(f"dataset.json: inputs_sha256: {files[name]} is not the {name} of the dataset")
    camera = {name: getattr(case.camera, name) for name in ("width", "height", "fx", "fy", "cx", "cy")}
    pose = (case.cam_from_mesh @ description.mesh_from_model).tolist()
    frame = content.get("frame", {})
    with findings.collecting(KIND):
        found = {name: frame.get(name) for name in camera} | {"mm_per_unit": content.get("mm_per_unit")}
        require_equal(found, camera | {"mm_per_unit": case.mm_per_unit}, f"dataset.json and {case.path}")
    with findings.collecting(KIND):
        require_equal(frame.get("cam_from_model"), pose, "dataset.json: frame: cam_from_model", relative=RELATIVE)
    with findings.collecting(KIND):
        wanted = [described_frame(each, description.mesh_from_model) for each in case.frames]
        found, expected = (
            {str(number): each for number, each in enumerate(frames)} for frames in (content.get("frames", []), wanted)
        )
        require_equal(found, expected, f"dataset.json and {case.path}: frames", relative=RELATIVE)


def _check_poses(description: Description, path: Path) -> None:
    """Check that a list of poses begins with those of the views; InputError if not."""
    mm_per_unit = description.content["mm_per_unit"]
    poses, _ = read_poses(path, mesh_from_model=description.mesh_from_model, mm_per_unit=mm_per_unit)
    if description.camera_from_planned is not None:
        poses = description.camera_from_planned @ poses
    if len(poses) < description.count or poses_hash(poses[: description.count]) != description.poses_hash:
        raise InputError(f"dataset.json: poses_sha256: {path} does not hold the poses of the dataset")
