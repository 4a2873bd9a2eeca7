"""The files of the BOP format: models, ``camera.json``, and the tables of each scene, from the records of its views.

Source: thodan/bop_toolkit, docs/bop_datasets_format.md. Rotations are row-major, translations and depths millimetres,
``m2c`` is ``cam_from_model`` for the mesh in ``models/``. The origin of that mesh is the mean of its vertices, not the
centre of its box as in BOP's own datasets; ``models_info.json`` holds where that centre is.
"""

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path

import numpy as np

from ...camera.pinhole import PinholeCamera
from ...files.content import create_folder, write_bytes_atomically, written_file
from ...files.tables import write_json
from ...surface.decimation import reduced_mesh
from ...surface.mesh import TriangleMesh, diameter
from ...surface.mesh_writer import write_ply
from ..layout import OBJECT_ID, TARGETS, ViewPaths
from ..run.resume_record import Box, ViewRecord
from .coco import coco_table

EVAL_VERTICES = 10_000
"""Most vertices of the model in ``models_eval/``: about as many as in BOP's, as errors of poses visit every vertex."""
LEAST_VISIBLE = 0.1
"""BOP tests on objects of at least this visible fraction."""


def bounding_box(mask: np.ndarray) -> Box:
    """The box of an ``(H, W)`` bool mask as in BOP: (x, y, x_max - x, y_max - y); all -1 for an empty mask."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    if not len(rows):
        return -1, -1, -1, -1
    x, y = int(columns[0]), int(rows[0])
    return x, y, int(columns[-1]) - x, int(rows[-1]) - y


def write_models(root: Path, mesh: TriangleMesh, colours: np.ndarray) -> None:
    """Write the surface in the model frame and its ``models_info.json``: whole, and reduced for errors of poses.

    Parameters
    ----------
    mesh
        In the model frame, mm.
    colours
        ``(V, 3)`` uint8, for ``models/``; ``models_eval/`` has none.
    """
    low, high = mesh.bounds
    info: dict[str, object] = {"diameter": diameter(mesh.vertices)}
    info |= {f"min_{axis}": float(value) for axis, value in zip("xyz", low, strict=True)}
    info |= {f"size_{axis}": float(value) for axis, value in zip("xyz", high - low, strict=True)}
    # BOP's readers know no such key and leave it alone
    info["box_centre_mm"] = ((low + high) / 2).tolist()
    reduced = reduced_mesh(mesh, EVAL_VERTICES)
    for name, model, rgb in (("models", mesh, colours), ("models_eval", reduced, None)):
        folder = root / name
        create_folder(folder)
        write_ply(folder / f"obj_{OBJECT_ID:06d}.ply", model, colours=rgb, normals=model.vertex_normals)
        write_json(folder / "models_info.json", {str(OBJECT_ID): info})


def write_camera(root: Path, camera: PinholeCamera, depth_scale: float) -> None:
    """Write ``camera.json``; the pixel origin is the centre of the top-left pixel."""
    write_json(
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


def write_scene(root: Path, records: Sequence[ViewRecord], camera: PinholeCamera, object_name: str) -> None:
    """Write the four JSON tables of one scene from the records of all its views.

    ``object_name`` is the name of COCO's category.
    """
    paths = [ViewPaths(root, record.index) for record in records]
    scene_camera, scene_gt, scene_gt_info = {}, {}, {}
    for path, record in zip(paths, records, strict=True):
        key = str(path.image_id)
        scene_camera[key], scene_gt[key], scene_gt_info[key] = scene_entries(record, camera.k.ravel().tolist())
    folder = paths[0].scene
    create_folder(folder)
    _write_rows(folder / "scene_camera.json", scene_camera)
    _write_rows(folder / "scene_gt.json", scene_gt)
    _write_rows(folder / "scene_gt_info.json", scene_gt_info)
    write_json(folder / "scene_gt_coco.json", coco_table(paths, records, camera, object_name), indent=None)


def scene_entries(
    record: ViewRecord, k: Sequence[float]
) -> tuple[dict[str, object], list[dict[str, object]], list[dict[str, object]]]:
    """The entries of a view in ``scene_camera.json``, ``scene_gt.json`` and ``scene_gt_info.json``.

    ``k`` are its intrinsics row by row, in px.
    """
    camera = {
        "cam_K": list(k),
        "depth_scale": record.depth_scale,
        # the model frame is the world: one object that never moves
        "cam_R_w2c": record.cam_r_m2c,
        "cam_t_w2c": record.cam_t_m2c,
    }
    truth = {"cam_R_m2c": record.cam_r_m2c, "cam_t_m2c": record.cam_t_m2c, "obj_id": OBJECT_ID}
    return camera, [truth], [asdict(record.gt_info)]


def is_test_target(record: ViewRecord) -> bool:
    """Whether BOP would test on a view: it shows enough of the surface."""
    return record.gt_info.visib_fract >= LEAST_VISIBLE


def write_test_targets(root: Path, views: Iterable[int]) -> None:
    """Write ``test_targets_bop19.json`` with these views (see :func:`is_test_target`), as BOP chooses them.

    Source: thodan/bop_toolkit, scripts/enumerate_test_targets.py.
    """
    with written_file(root / TARGETS) as file:
        separator = "[\n"
        for paths in (ViewPaths(root, index) for index in views):
            target = {"im_id": paths.image_id, "inst_count": 1, "obj_id": OBJECT_ID, "scene_id": paths.scene_id}
            file.write(f"{separator}  {json.dumps(target)}".encode())
            separator = ",\n"
        file.write(b"[\n\n]\n" if separator == "[\n" else b"\n]\n")


def _write_rows(path: Path, content: Mapping[str, object]) -> None:
    """Write a dictionary with one entry per line, as BOP's own files have it."""
    rows = ",\n".join(f"  {json.dumps(key)}: {json.dumps(value)}" for key, value in content.items())
    write_bytes_atomically(path, f"{{\n{rows}\n}}\n".encode())
