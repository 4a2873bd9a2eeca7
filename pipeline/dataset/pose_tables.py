"""The tables with the poses of all views: ``poses.csv``, and ``transforms.json`` for NeRF.

Source of the latter: Instant NGP, docs/nerf_dataset_tips.md, and Nerfstudio's data conventions.
"""

import json
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from ..camera.pinhole import PinholeCamera
from ..files.content import written_file
from ..transforms import CAM_FROM_OPENGL_CAM, inverse_rigid
from .layout import ViewPaths
from .view_record import ViewRecord

POSE_COLUMNS = (*(f"r{row}{column}" for row in range(3) for column in range(3)), "tx_mm", "ty_mm", "tz_mm")
"""Columns of a pose in CSV tables."""


def pose_cells(cam_from_model: np.ndarray) -> list[str]:
    """A pose (4x4, mm) as cells of :data:`POSE_COLUMNS`, to the last bit."""
    return [repr(float(value)) for value in (*cam_from_model[:3, :3].ravel(), *cam_from_model[:3, 3])]


def write_poses(
    root: Path, records: Iterable[ViewRecord], camera: PinholeCamera, mesh_from_model: np.ndarray
) -> None:
    """Write ``poses.csv`` and ``transforms.json`` for all views; no more than one record is held in memory."""
    model_from_mesh = inverse_rigid(mesh_from_model)
    with written_file(root / "poses.csv") as poses, written_file(root / "transforms.json") as nerf:
        header = ("index", "image", *POSE_COLUMNS, "mesh_tx_mm", "mesh_ty_mm", "mesh_tz_mm")
        poses.write(_csv_line(header))
        nerf.write(f'{json.dumps(_nerf_intrinsics(camera))[:-1]}, "frames": ['.encode())
        separator = ""
        for record in records:
            paths, cam_from_model = ViewPaths(root, record.index), record.cam_from_model
            from_mesh = [repr(float(value)) for value in (cam_from_model @ model_from_mesh)[:3, 3]]
            poses.write(_csv_line([record.index, paths.relative("rgb"), *pose_cells(cam_from_model), *from_mesh]))
            nerf.write((separator + json.dumps(_nerf_frame(paths, cam_from_model))).encode())
            separator = ", "
        nerf.write(b"]}\n")


def _csv_line(cells: Iterable[object]) -> bytes:
    return (",".join(map(str, cells)) + "\n").encode()


def _nerf_frame(paths: ViewPaths, cam_from_model: np.ndarray) -> dict[str, object]:
    return {
        "file_path": paths.relative("rgb"),
        "depth_file_path": paths.relative("depth"),
        "mask_path": paths.relative("mask"),
        "transform_matrix": (inverse_rigid(cam_from_model) @ CAM_FROM_OPENGL_CAM).tolist(),
    }


def _nerf_intrinsics(camera: PinholeCamera) -> dict[str, object]:
    return {
        "camera_model": "PINHOLE",
        "w": camera.width,
        "h": camera.height,
        "fl_x": camera.fx,
        "fl_y": camera.fy,
        # NeRF tools put (0, 0) at the corner of the top-left pixel
        "cx": camera.cx + 0.5,
        "cy": camera.cy + 0.5,
        "camera_angle_x": 2 * float(np.arctan(camera.width / (2 * camera.fx))),
        "camera_angle_y": 2 * float(np.arctan(camera.height / (2 * camera.fy))),
    }
