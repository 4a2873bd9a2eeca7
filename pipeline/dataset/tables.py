"""The tables of a dataset, made from the records of its finished views: BOP, COCO, NeRF and plain CSV.

BOP: thodan/bop_toolkit, docs/bop_datasets_format.md. Rotations are row-major, translations and depths millimetres,
``m2c`` is ``cam_from_model`` for the mesh in ``models/``.
"""

import csv
import io
import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np

from ..camera.pinhole import PinholeCamera
from ..files.content import write_bytes_atomically
from ..surface.mesh import TriangleMesh, diameter
from ..surface.mesh_writer import write_ply
from ..transforms import CAM_FROM_OPENGL_CAM, inverse_rigid, rigid
from .layout import OBJECT_ID, ViewPaths
from .view import read_record

HIDDEN_BELOW = 0.1
"""COCO annotations with a smaller visible fraction are marked ``ignore``, as bop_toolkit does."""


POSE_COLUMNS = (*(f"r{row}{column}" for row in range(3) for column in range(3)), "tx_mm", "ty_mm", "tz_mm")
"""Of the CSV tables that hold poses."""


def pose_cells(cam_from_model: np.ndarray) -> list[str]:
    """A pose (4x4, mm) as cells of :data:`POSE_COLUMNS`, to the last bit."""
    return [repr(float(value)) for value in (*cam_from_model[:3, :3].ravel(), *cam_from_model[:3, 3])]


def write_models(root: Path, mesh: TriangleMesh, colours: np.ndarray) -> None:
    """``models/``: the surface in the model frame with ``(V, 3)`` uint8 colours, and ``models_info.json``."""
    folder = root / "models"
    folder.mkdir(exist_ok=True)
    write_ply(folder / f"obj_{OBJECT_ID:06d}.ply", mesh, colours=colours, normals=mesh.vertex_normals)
    low, high = mesh.bounds
    info: dict[str, float] = {"diameter": diameter(mesh.vertices)}
    info |= {f"min_{axis}": float(value) for axis, value in zip("xyz", low, strict=True)}
    info |= {f"size_{axis}": float(value) for axis, value in zip("xyz", high - low, strict=True)}
    _write_json(folder / "models_info.json", {str(OBJECT_ID): info})


def write_camera(root: Path, camera: PinholeCamera, depth_scale: float) -> None:
    """``camera.json``; the pixel origin is the centre of the top-left pixel."""
    _write_json(
        root / "camera.json",
        {
            "fx": camera.fx,
            "fy": camera.fy,
            "cx": camera.cx,
            "cy": camera.cy,
            "width": camera.width,
            "height": camera.height,
            "depth_scale": depth_scale,
        },
    )


def write_scene(root: Path, frames: range, camera: PinholeCamera) -> None:
    """The four JSON tables of one BOP scene from the records of its views."""
    paths = [ViewPaths(root, index) for index in frames]
    records = [read_record(path) for path in paths]
    scene_camera, scene_gt, scene_gt_info = {}, {}, {}
    for path, record in zip(paths, records, strict=True):
        key = str(path.image_id)
        scene_camera[key] = {
            "cam_K": camera.k.ravel().tolist(),
            "depth_scale": record["depth_scale"],
            # the model frame is the world: one object, never moved
            "cam_R_w2c": record["cam_R_m2c"],
            "cam_t_w2c": record["cam_t_m2c"],
        }
        scene_gt[key] = [{"cam_R_m2c": record["cam_R_m2c"], "cam_t_m2c": record["cam_t_m2c"], "obj_id": OBJECT_ID}]
        scene_gt_info[key] = [record["gt_info"]]
    folder = paths[0].scene
    _write_rows(folder / "scene_camera.json", scene_camera)
    _write_rows(folder / "scene_gt.json", scene_gt)
    _write_rows(folder / "scene_gt_info.json", scene_gt_info)
    _write_json(folder / "scene_gt_coco.json", _coco(paths, records, camera), indent=None)


def _coco(paths: Sequence[ViewPaths], records: Sequence[dict], camera: PinholeCamera) -> dict:
    images, annotations = [], []
    for number, (path, record) in enumerate(zip(paths, records, strict=True)):
        info = record["gt_info"]
        images.append(
            {
                "id": path.image_id,
                "file_name": path.file("rgb").relative_to(path.scene).as_posix(),
                "width": camera.width,
                "height": camera.height,
            }
        )
        annotations.append(
            {
                "id": number + 1,
                "image_id": path.image_id,
                "category_id": OBJECT_ID,
                "iscrowd": 0,
                "area": info["px_count_visib"],
                "bbox": info["bbox_obj"],
                "segmentation": {"counts": record["rle_counts"], "size": [camera.height, camera.width]},
                "width": camera.width,
                "height": camera.height,
                "ignore": info["visib_fract"] < HIDDEN_BELOW,
            }
        )
    category = {"id": OBJECT_ID, "name": str(OBJECT_ID), "supercategory": "surface"}
    return {"info": {}, "licenses": [], "categories": [category], "images": images, "annotations": annotations}


def record_pose(record: dict) -> np.ndarray:
    """``cam_from_model`` (4x4, mm) of a view's record."""
    return rigid(np.reshape(record["cam_R_m2c"], (3, 3)), np.array(record["cam_t_m2c"]))


def write_poses(root: Path, frames: Iterable[int], camera: PinholeCamera, mesh_from_model: np.ndarray) -> None:
    """``poses.csv`` and ``transforms.json`` for all views."""
    model_from_mesh = inverse_rigid(mesh_from_model)
    lines = io.StringIO(newline="")
    table = csv.writer(lines, lineterminator="\n")
    table.writerow(["index", "image", *POSE_COLUMNS, "given_tx_mm", "given_ty_mm", "given_tz_mm"])
    nerf_frames = []
    for index in frames:
        paths = ViewPaths(root, index)
        cam_from_model = record_pose(read_record(paths))
        cam_from_mesh = cam_from_model @ model_from_mesh
        given = [repr(float(value)) for value in cam_from_mesh[:3, 3]]
        table.writerow([index, paths.relative("rgb"), *pose_cells(cam_from_model), *given])
        model_from_opengl_cam = inverse_rigid(cam_from_model) @ CAM_FROM_OPENGL_CAM
        nerf_frames.append(
            {
                "file_path": paths.relative("rgb"),
                "depth_file_path": paths.relative("depth"),
                "mask_path": paths.relative("mask"),
                "transform_matrix": model_from_opengl_cam.tolist(),
            }
        )
    write_bytes_atomically(root / "poses.csv", lines.getvalue().encode())
    intrinsics = {
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
    _write_json(root / "transforms.json", intrinsics | {"frames": nerf_frames}, indent=None)


def _write_json(path: Path, content: object, indent: int | None = 2) -> None:
    write_bytes_atomically(path, (json.dumps(content, indent=indent) + "\n").encode())


def _write_rows(path: Path, content: Mapping[str, object]) -> None:
    """A dictionary with one entry a line, as BOP's own files are written."""
    rows = ",\n".join(f"  {json.dumps(key)}: {json.dumps(value)}" for key, value in content.items())
    write_bytes_atomically(path, f"{{\n{rows}\n}}\n".encode())
