"""The tables of all views, for CSV and NeRF readers, against the poses of the records.

The conversions here are independent (inverse matrices by elimination, axes and pixel origin as plain numbers), so that
they reveal a mistake in the code that writes the tables.
"""

import csv
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...errors import InputError
from ...files.content import reading
from ...surface.mesh import TriangleMesh
from ..dataset_file import Description
from ..layout import OBJECT_ID, VIDEO_FILES, ViewPaths
from .comparison import RELATIVE, read_table, require_equal, require_pose, shortened
from .findings import Findings

POSE_COLUMNS = [*(f"r{i}{j}" for i in range(3) for j in range(3)), "tx_mm", "ty_mm", "tz_mm"]
LEAST_VISIBLE = 0.1
"""Visible fraction from which BOP's toolkit chooses views as targets."""
SINGLE = 1e-6
"""Relative error of what is computed from the model, whose coordinates are stored in single precision."""
FRAMES_PER_SECOND = 24


@dataclass(frozen=True)
class ViewPose:
    """What the tables of all views need from a record: ``(4, 4)`` pose in mm, mm per unit of depth, 0..1."""

    cam_from_model: np.ndarray
    depth_scale: float
    visib_fract: float


Views = Mapping[int, ViewPose]


def check_pose_tables(
    root: Path, views: Views, description: Description, mesh: TriangleMesh | None, findings: Findings
) -> None:
    """Compare the tables that exist with the records of all views; ``mesh`` is the model, if it is known."""
    checks = {
        "camera.json": lambda: _check_camera_file(root, description, views),
        "poses.csv": lambda: _check_pose_table(root, views, description),
        "transforms.json": lambda: _check_nerf_file(root, views, description, mesh),
        "test_targets_bop19.json": lambda: _check_targets(root, views),
    }
    for name, check in checks.items():
        if (root / name).is_file():
            with findings.collecting("tables that disagree"):
                check()


def _check_camera_file(root: Path, description: Description, views: Views) -> None:
    """Compare ``camera.json`` with ``dataset.json``; its scale of depths is at most the finest of a view."""
    where, camera = "camera.json", description.camera
    found = read_table(root, where)
    scale = found.get("depth_scale") if isinstance(found, dict) else None
    names = ("fx", "fy", "cx", "cy", "width", "height")
    require_equal(found, {name: getattr(camera, name) for name in names} | {"depth_scale": scale}, where)
    finest = min(view.depth_scale for view in views.values())
    if not isinstance(scale, int | float) or not 0 < scale <= finest:
        raise InputError(f"{where}: depth_scale is {scale}, a view has {finest:g}")


def _check_pose_table(root: Path, views: Views, description: Description) -> None:
    """Compare ``poses.csv`` with the records: poses from the model frame and from that of the mesh file."""
    where = "poses.csv"
    header = ["index", "image", *POSE_COLUMNS, "mesh_tx_mm", "mesh_ty_mm", "mesh_tz_mm"]
    model_from_mesh = np.linalg.inv(description.mesh_from_model)
    count = 0
    for count, row in enumerate(_rows(root, where, header), start=1):
        index, here = count - 1, f"{where}: row {count - 1}"
        paths = ViewPaths(root, index)
        if row[:2] != [str(index), paths.relative("rgb")] or index not in views:
            raise InputError(f"{here}: expected view {index} and its image, found {shortened(row[:2])}")
        cam_from_model = views[index].cam_from_model
        require_pose(_pose(row[2:14], here), cam_from_model, here, paths.relative("frame"))
        expected = (cam_from_model @ model_from_mesh)[:3, 3].tolist()
        require_equal(_numbers(row[14:], here), expected, f"{here}: mesh_t", relative=RELATIVE)
    if count != len(views):
        raise InputError(f"{where}: expected {len(views)} rows, found {count}")


def _check_nerf_file(root: Path, views: Views, description: Description, mesh: TriangleMesh | None) -> None:
    """Compare ``transforms.json`` with the records: model_from_cam with OpenGL axes, pixel origin at the corner."""
    where, camera = "transforms.json", description.camera
    content = read_table(root, where)
    if not isinstance(content, dict) or not isinstance(content.get("frames"), list):
        raise InputError(f"{where}: expected an object with frames, found {shortened(content)}")
    frames = content.pop("frames")
    unit, scale, offset = (content.get(name) for name in ("integer_depth_scale", "scale", "offset"))
    expected = {
        "camera_model": "PINHOLE", "w": camera.width, "h": camera.height, "fl_x": camera.fx, "fl_y": camera.fy,
        "cx": camera.cx + 0.5, "cy": camera.cy + 0.5,
        "camera_angle_x": float(2 * np.arctan2(camera.width / 2, camera.fx)),
        "camera_angle_y": float(2 * np.arctan2(camera.height / 2, camera.fy)),
        "aabb_scale": 1, "scale": scale, "offset": offset, "integer_depth_scale": unit,
    }  # fmt: skip
    require_equal(content, expected, where, relative=RELATIVE)
    require_equal(unit, read_table(root, "camera.json").get("depth_scale"), f"{where}: integer_depth_scale")
    if mesh is not None:
        # Instant NGP's point * scale + offset: the model's box is centred in the unit cube and spans 90 % of it
        low, high = mesh.bounds
        factor = float(0.9 / (high - low).max())
        centred = {"scale": factor, "offset": (0.5 - factor * (low + high) / 2).tolist()}
        require_equal({"scale": scale, "offset": offset}, centred, where, relative=SINGLE)
    if len(frames) != len(views):
        raise InputError(f"{where}: expected {len(views)} frames, found {len(frames)}")
    for index, view in views.items():
        paths = ViewPaths(root, index)
        files = {"file_path": "rgb", "depth_file_path": "depth", "mask_path": "mask"}
        if view.depth_scale == unit:
            files["depth_path"] = "depth"
        model_from_cam = np.linalg.inv(view.cam_from_model) * [1, -1, -1, 1]
        frame = {name: paths.relative(kind) for name, kind in files.items()}
        frame["transform_matrix"] = model_from_cam.tolist()
        require_equal(frames[index], frame, f"{where}: frame {index}", relative=RELATIVE)


def _check_targets(root: Path, views: Views) -> None:
    """Compare ``test_targets_bop19.json`` with the records: every view that shows enough of the surface."""
    where = "test_targets_bop19.json"
    targets = [ViewPaths(root, index) for index in sorted(views) if views[index].visib_fract >= LEAST_VISIBLE]
    expected = [
        {"im_id": target.image_id, "inst_count": 1, "obj_id": OBJECT_ID, "scene_id": target.scene_id}
        for target in targets
    ]
    require_equal(read_table(root, where), expected, where)


def read_video_poses(root: Path) -> list[np.ndarray]:
    """The 4x4 poses of ``video/poses.csv``, mm.

    Raises
    ------
    InputError
        The file is damaged.
    """
    where, poses = VIDEO_FILES[1], []
    for number, row in enumerate(_rows(root, where, ["frame", "time_s", *POSE_COLUMNS])):
        here = f"{where}: row {number}"
        require_equal(_numbers(row[:2], here), [number, number / FRAMES_PER_SECOND], here, relative=RELATIVE)
        poses.append(_pose(row[2:], here))
        require_rotation(poses[-1], here)
    if not poses:
        raise InputError(f"{where}: expected the pose of each frame, found none")
    return poses


def require_rotation(pose: np.ndarray, where: str) -> None:
    """Check that the rotation of a 4x4 pose is orthonormal with determinant 1; InputError if not."""
    rotation = pose[:3, :3]
    off = float(np.abs(rotation @ rotation.T - np.eye(3)).max())
    if not off <= RELATIVE or np.linalg.det(rotation) < 0:
        determinant = np.linalg.det(rotation)
        raise InputError(
            f"{where}: expected a rotation, found a matrix off by {off:.2g} with determinant {determinant:.6g}"
        )


def _rows(root: Path, where: str, header: list[str]) -> Iterator[list[str]]:
    """The rows of a CSV table, one after the other, which must have these columns."""
    with (
        reading(root / where, "a table of the dataset", where),
        (root / where).open(encoding="utf-8", newline="") as file,
    ):
        try:
            for number, row in enumerate(csv.reader(file, strict=True)):
                if number and len(row) != len(header):
                    raise InputError(f"{where}: row {number - 1}: expected {len(header)} cells, found {len(row)}")
                if number:
                    yield row
                elif row != header:
                    raise InputError(f"{where}: expected the columns {', '.join(header)}, found {shortened(row)}")
        except (csv.Error, UnicodeDecodeError) as error:
            raise InputError(f"{where}: expected a CSV table, found a damaged file ({error})") from None


def _numbers(cells: list[str], where: str) -> list[float]:
    try:
        return [float(cell) for cell in cells]
    except ValueError as error:
        raise InputError(f"{where}: expected numbers, found another cell ({error})") from None


def _pose(cells: list[str], where: str) -> np.ndarray:
    values, pose = _numbers(cells, where), np.eye(4)
    pose[:3, :3], pose[:3, 3] = np.reshape(values[:9], (3, 3)), values[9:]
    return pose
