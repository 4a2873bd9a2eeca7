"""The tables with the poses of all views: ``poses.csv``, and ``transforms.json`` for NeRF.

Sources of the latter: Nerfstudio's data conventions; Instant NGP's docs/nerf_dataset_tips.md and src/nerf_loader.cu.
"""

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from ..camera.pinhole import PinholeCamera
from ..files.tables import write_csv, write_json
from ..transforms import CAM_FROM_OPENGL_CAM, inverse_rigid
from .layout import ViewPaths
from .view_record import read_record

POSE_COLUMNS = (*(f"r{row}{column}" for row in range(3) for column in range(3)), "tx_mm", "ty_mm", "tz_mm")
"""Columns of a pose in CSV tables."""


def pose_cells(cam_from_model: np.ndarray) -> list[str]:
    """A pose (4x4, mm) as cells of :data:`POSE_COLUMNS`, to the last bit."""
    return [repr(float(value)) for value in (*cam_from_model[:3, :3].ravel(), *cam_from_model[:3, 3])]


NGP_FILL = 0.9
"""The part of Instant NGP's unit cube that the surface's box spans."""


def write_poses(
    root: Path,
    views: Iterable[int],
    camera: PinholeCamera,
    mesh_from_model: np.ndarray,
    *,
    bounds: np.ndarray,
    depth_scale: float,
) -> None:
    """Write ``poses.csv`` and ``transforms.json`` for all views.

    Parameters
    ----------
    mesh_from_model
        4x4, mm.
    bounds
        ``(2, 3)`` corners of the surface's box in the model frame, mm.
    depth_scale
        Millimetres per unit of the depth images, as in ``camera.json``.

    Raises
    ------
    RunError
        A record is missing or damaged.
    """
    model_from_mesh = inverse_rigid(mesh_from_model)
    rows, nerf_frames = [], []
    for index in views:
        paths = ViewPaths(root, index)
        record = read_record(paths)
        cam_from_model = record.cam_from_model
        cam_from_mesh = cam_from_model @ model_from_mesh
        from_mesh = [repr(float(value)) for value in cam_from_mesh[:3, 3]]
        rows.append([index, paths.relative("rgb"), *pose_cells(cam_from_model), *from_mesh])
        model_from_opengl_cam = inverse_rigid(cam_from_model) @ CAM_FROM_OPENGL_CAM
        frame = {
            "file_path": paths.relative("rgb"),
            "depth_file_path": paths.relative("depth"),
            "mask_path": paths.relative("mask"),
            "transform_matrix": model_from_opengl_cam.tolist(),
        }
        if record.depth_scale == depth_scale:
            # Instant NGP's name; it has one scale for all images, and takes those without depth
            frame["depth_path"] = frame["depth_file_path"]
        nerf_frames.append(frame)
    header = ("index", "image", *POSE_COLUMNS, "mesh_tx_mm", "mesh_ty_mm", "mesh_tz_mm")
    write_csv(root / "poses.csv", header, rows)
    head = _nerf_intrinsics(camera) | _instant_ngp_scene(bounds, depth_scale)
    write_json(root / "transforms.json", head | {"frames": nerf_frames}, indent=None)


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
