"""The tables of all views, for CSV and NeRF readers, against the poses of the records.

The conversions here are independent (inverse matrices by elimination, axes and pixel origin as plain numbers), so that
they reveal a mistake in the code that writes the tables.
"""

import csv
import io
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...surface.mesh import TriangleMesh
from ..layout import OBJECT_ID, ViewPaths
from .comparison import finite_number, is_close, require_equal, require_pose
from .files import DamagedFile, check_rotation, numbers, opened, read_list, read_object, require_keys, shortened
from .findings import Findings
from .records import Description

KIND = "tables that disagree"
ROW_BYTES, FRAME_BYTES = 1024, 2048
"""More than a view takes in a CSV table or in ``transforms.json``."""
POSE_COLUMNS = [*(f"r{i}{j}" for i in range(3) for j in range(3)), "tx_mm", "ty_mm", "tz_mm"]
LEAST_VISIBLE = 0.1
"""Visible fraction from which BOP's toolkit chooses views as targets."""
SINGLE = 1e-6
"""Relative error of what is computed from the model, whose coordinates are stored in single precision."""


@dataclass(frozen=True)
class ViewPose:
    """What the tables of all views need from a record: ``(4, 4)`` pose in mm, mm per unit of depth, 0..1."""

    cam_from_model: np.ndarray
    depth_scale: float
    visib_fract: float


Views = Mapping[int, ViewPose]


def check_camera_file(root: Path, description: Description, views: Views, findings: Findings) -> float | None:
    """Compare ``camera.json`` with ``dataset.json``; returns its depth scale, at most the finest of a view."""
    where, camera = "camera.json", description.camera
    finest = min((view.depth_scale for view in views.values()), default=np.inf)
    try:
        content = read_object(root, where)
        names = ("fx", "fy", "cx", "cy", "width", "height")
        require_keys(content, {*names, "depth_scale"}, where)
        scale = float(numbers(content, "depth_scale", (), where))
        require_equal(content, {name: getattr(camera, name) for name in names} | {"depth_scale": scale}, where)
        if not 0 < scale <= finest:
            raise DamagedFile(f"{where}: depth_scale is {scale:g}, a view has {finest:g}")
    except DamagedFile as damage:
        findings.add(KIND, damage)
        return None
    return scale


def check_pose_table(root: Path, views: Views, description: Description, findings: Findings) -> None:
    """Compare ``poses.csv`` with the records: poses from the model frame and from that of the mesh file."""
    where = "poses.csv"
    header = ["index", "image", *POSE_COLUMNS, "mesh_tx_mm", "mesh_ty_mm", "mesh_tz_mm"]
    model_from_mesh = np.linalg.inv(description.mesh_from_model)
    count = 0
    try:
        for count, row in enumerate(_rows(root, where, header, len(views)), start=1):
            index, here = count - 1, f"{where}: row {count - 1}"
            paths = ViewPaths(root, index)
            if row[:2] != [str(index), paths.relative("rgb")]:
                raise DamagedFile(f"{here}: expected view {index} and its image, found {shortened(row[:2])}")
            if index not in views:
                continue
            cam_from_model = views[index].cam_from_model
            require_pose(_pose(row[2:14], here), cam_from_model, here, paths.relative("frame"))
            found = [finite_number(cell, here) for cell in row[14:]]
            expected = (cam_from_model @ model_from_mesh)[:3, 3]
            if not is_close(found, expected, float(np.abs(model_from_mesh[:3, 3]).max())):
                raise DamagedFile(f"{here}: mesh_t is {found}, {paths.relative('frame')} gives {expected.tolist()}")
        if count != description.count:
            raise DamagedFile(f"{where}: expected {description.count} rows, found {count}")
    except DamagedFile as damage:
        findings.add(KIND, damage)


def check_nerf_file(
    root: Path,
    views: Views,
    description: Description,
    mesh: TriangleMesh | None,
    depth_scale: float | None,
    findings: Findings,
) -> None:
    """Compare ``transforms.json`` with the records: model_from_cam with OpenGL axes, pixel origin at the corner.

    Parameters
    ----------
    mesh, depth_scale
        The model, and the scale in ``camera.json``, if they are known.
    """
    where, camera = "transforms.json", description.camera
    try:
        content = read_object(root, where, FRAME_BYTES * (len(views) + 4))
        exact = {
            "camera_model": "PINHOLE", "w": camera.width, "h": camera.height, "fl_x": camera.fx, "fl_y": camera.fy,
            "aabb_scale": 1,
        }  # fmt: skip
        computed = ("cx", "cy", "camera_angle_x", "camera_angle_y", "scale", "offset", "integer_depth_scale")
        require_keys(content, {*exact, *computed, "frames"}, where)
        require_equal({name: content[name] for name in exact}, exact, where)
        half = [np.tan(numbers(content, f"camera_angle_{axis}", (), where) / 2) for axis in "xy"]
        derived = {
            "cx": (numbers(content, "cx", (), where) - 0.5, camera.cx),
            "cy": (numbers(content, "cy", (), where) - 0.5, camera.cy),
            "camera_angle_x": (half[0] * camera.fx, camera.width / 2),
            "camera_angle_y": (half[1] * camera.fy, camera.height / 2),
        }
        for name, (found, expected) in derived.items():
            if not is_close(found, expected, camera.width):
                raise DamagedFile(f"{where}: {name} is {content[name]!r}, which does not fit dataset.json")
        unit = float(numbers(content, "integer_depth_scale", (), where))
        if depth_scale is not None and unit != depth_scale:
            raise DamagedFile(f"{where}: integer_depth_scale is {unit:g}, camera.json has {depth_scale:g}")
        _check_cube(content, mesh, where)
        frames = content["frames"]
        if not isinstance(frames, list) or len(frames) != description.count:
            found_frames = len(frames) if isinstance(frames, list) else shortened(frames)
            raise DamagedFile(f"{where}: expected {description.count} frames, found {found_frames}")
        for index, view in views.items():
            _check_frame(frames[index], view, ViewPaths(root, index), unit, f"{where}: frame {index}")
    except np.linalg.LinAlgError:
        findings.add(KIND, f"{where}: expected rigid transforms, found a singular matrix")
    except DamagedFile as damage:
        findings.add(KIND, damage)


def _check_cube(content: Mapping, mesh: TriangleMesh | None, where: str) -> None:
    """Instant NGP's point * scale + offset: the model's box is centred in the unit cube and spans 90 % of it."""
    scale, offset = float(numbers(content, "scale", (), where)), numbers(content, "offset", (3,), where)
    if mesh is None:
        return
    low, high = mesh.vertices.min(axis=0) * scale + offset, mesh.vertices.max(axis=0) * scale + offset
    if np.abs((low + high) / 2 - 0.5).max() > SINGLE or abs((high - low).max() - 0.9) > SINGLE:
        raise DamagedFile(f"{where}: scale and offset do not put the model in the middle of the unit cube")


def _check_frame(frame: object, view: ViewPose, paths: ViewPaths, depth_scale: float, where: str) -> None:
    if not isinstance(frame, dict):
        raise DamagedFile(f"{where}: expected an object, found {shortened(frame)}")
    files = {"file_path": "rgb", "depth_file_path": "depth", "mask_path": "mask"}
    if view.depth_scale == depth_scale:
        files["depth_path"] = "depth"
    others = {name: value for name, value in frame.items() if name != "transform_matrix"}
    require_equal(others, {name: paths.relative(kind) for name, kind in files.items()}, where)
    model_from_cam = numbers(frame, "transform_matrix", (4, 4), where) * [1, -1, -1, 1]
    require_equal(model_from_cam[3].tolist(), [0, 0, 0, 1], where)
    require_pose(np.linalg.inv(model_from_cam), view.cam_from_model, where, paths.relative("frame"))


def check_targets(root: Path, views: Views, description: Description, findings: Findings) -> None:
    """Compare ``test_targets_bop19.json`` with the records: every view that shows enough of the surface."""
    where = "test_targets_bop19.json"
    try:
        content = read_list(root, where, 256 * (len(views) + 16))
        if len(views) < description.count:
            return
        targets = [ViewPaths(root, index) for index in sorted(views) if views[index].visib_fract >= LEAST_VISIBLE]
        expected = [
            {"im_id": target.image_id, "inst_count": 1, "obj_id": OBJECT_ID, "scene_id": target.scene_id}
            for target in targets
        ]
        if len(content) != len(expected):
            raise DamagedFile(f"{where}: expected {len(expected)} targets, found {len(content)}")
        require_equal(content, expected, where)
    except DamagedFile as damage:
        findings.add(KIND, damage)


def read_video_poses(root: Path, findings: Findings) -> list[np.ndarray]:
    """The 4x4 poses of ``video/poses.csv``, mm, which must be rigid; none if the file is damaged."""
    where, poses = "video/poses.csv", []
    try:
        for number, row in enumerate(_rows(root, where, ["frame", "time_s", *POSE_COLUMNS], MOST_FRAMES)):
            here = f"{where}: row {number}"
            if row[0] != str(number) or not is_close(finite_number(row[1], here), number / FRAMES_PER_SECOND, 1.0):
                raise DamagedFile(f"{here}: expected frame {number} and its time, found {shortened(row[:2])}")
            pose = _pose(row[2:], here)
            check_rotation(pose[:3, :3], here)
            poses.append(pose)
        if not poses:
            raise DamagedFile(f"{where}: expected the pose of each frame, found none")
    except DamagedFile as damage:
        findings.add(KIND, damage)
        return []
    return poses


MOST_FRAMES, FRAMES_PER_SECOND = 100_000, 24


def _rows(root: Path, where: str, header: list[str], count: int) -> Iterator[list[str]]:
    """The rows of a CSV table, one after the other, which must have these columns; of a file for about ``count``."""
    with opened(root, where) as (stream, size):
        most = ROW_BYTES * (count + 4)
        if size > most:
            raise DamagedFile(f"{where}: expected at most {most} bytes, found {size}")
        try:
            for number, row in enumerate(csv.reader(io.TextIOWrapper(stream, "utf-8", newline=""), strict=True)):
                if number and len(row) != len(header):
                    raise DamagedFile(f"{where}: row {number - 1}: expected {len(header)} cells, found {len(row)}")
                if number:
                    yield row
                elif row != header:
                    raise DamagedFile(f"{where}: expected the columns {', '.join(header)}, found {shortened(row)}")
        except (csv.Error, UnicodeDecodeError) as error:
            raise DamagedFile(f"{where}: expected a CSV table, found a damaged file ({error})") from None


def _pose(cells: list[str], where: str) -> np.ndarray:
    values = [finite_number(cell, where) for cell in cells]
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = np.reshape(values[:9], (3, 3)), values[9:]
    return pose
