"""The tables with the poses of all views: ``poses.csv``, and ``transforms.json`` for NeRF.

Sources of the latter: Nerfstudio's data conventions; Instant NGP's docs/nerf_dataset_tips.md and src/nerf_loader.cu.
"""

import json
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from ...camera.pinhole import PinholeCamera
from ...files.writing import written_file
from ...transforms import CAM_FROM_OPENGL_CAM, inverse_rigid
from ..layout import MODEL_FILES, ViewPaths
from ..run.resume_record import ViewRecord

POSE_COLUMNS = (*(f"r{row}{column}" for row in range(3) for column in range(3)), "tx_mm", "ty_mm", "tz_mm")
"""Columns of a pose in CSV tables."""
POSE_TABLE_COLUMNS = ("index", "image", *POSE_COLUMNS, "mesh_tx_mm", "mesh_ty_mm", "mesh_tz_mm")
"""Of ``poses.csv``."""
NGP_FILL = 0.9
"""The part of Instant NGP's unit cube that the surface's box spans."""


def pose_cells(cam_from_model: np.ndarray) -> list[str]:
    """A pose (4x4, mm) as cells of :data:`POSE_COLUMNS`, to the last bit."""
    return [repr(float(value)) for value in (*cam_from_model[:3, :3].ravel(), *cam_from_model[:3, 3])]


def write_poses(
    root: Path,
    records: Iterable[ViewRecord],
    camera: PinholeCamera,
    mesh_from_model: np.ndarray,
    *,
    bounds: np.ndarray,
    depth_scale: float,
) -> None:
    """Write ``poses.csv`` and ``transforms.json`` for all views; no more than one record is held in memory.

    Parameters
    ----------
    mesh_from_model
        4x4, mm.
    bounds
        ``(2, 3)`` corners of the surface's box in the model frame, mm.
    depth_scale
        Millimetres per unit of the depth images, as in ``camera.json``.
    """
    model_from_mesh = inverse_rigid(mesh_from_model)
    with written_file(root / "poses.csv") as poses, written_file(root / "transforms.json") as nerf:
        poses.write(_csv_line(POSE_TABLE_COLUMNS))
        # splats start from the model's coloured points
        head = _nerf_intrinsics(camera) | _instant_ngp_scene(bounds, depth_scale) | {"ply_file_path": MODEL_FILES[0]}
        nerf.write(f'{json.dumps(head)[:-1]}, "frames": ['.encode())
        separator = ""
        for record in records:
            name, cam_from_model = ViewPaths(root, record.index).relative("rgb"), record.cam_from_model
            from_mesh = [repr(float(value)) for value in (cam_from_model @ model_from_mesh)[:3, 3]]
            poses.write(_csv_line([record.index, name, *pose_cells(cam_from_model), *from_mesh]))
            nerf.write((separator + json.dumps(_nerf_frame(root, record, depth_scale))).encode())
            separator = ", "
        nerf.write(b"]}\n")


def _csv_line(cells: Iterable[object]) -> bytes:
    return (",".join(map(str, cells)) + "\n").encode()


def _nerf_frame(root: Path, record: ViewRecord, depth_scale: float) -> dict[str, object]:
    paths = ViewPaths(root, record.index)
    frame: dict[str, object] = {
        "file_path": paths.relative("rgb"),
        "depth_file_path": paths.relative("depth"),
        # of what is in the picture
        "mask_path": paths.relative("mask_visib" if paths.relative("mask_occluder") in record.files else "mask"),
        "transform_matrix": (inverse_rigid(record.cam_from_model) @ CAM_FROM_OPENGL_CAM).tolist(),
    }
    if record.depth_scale == depth_scale:
        # Instant NGP's name; it has one scale for all images, and takes those without depth
        frame["depth_path"] = frame["depth_file_path"]
    return frame


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


def _instant_ngp_scene(bounds: np.ndarray, depth_scale: float) -> dict[str, object]:
    """Keys of Instant NGP alone: point * scale + offset puts the surface in its unit cube; depths become mm."""
    scale = NGP_FILL / float((bounds[1] - bounds[0]).max())
    return {
        "aabb_scale": 1,
        "scale": scale,
        "offset": (0.5 - scale * bounds.mean(axis=0)).tolist(),
        "integer_depth_scale": depth_scale,
    }
