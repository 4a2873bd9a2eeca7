"""The files of the BOP format: models, ``camera.json``, and the tables of each scene, from the records of its views.

Source: thodan/bop_toolkit, docs/bop_datasets_format.md; for ``scene_gt_coco_modal.json`` its calc_gt_coco.py, and
cocodataset.org, "Data format". Rotations are row-major, translations and depths millimetres,
``m2c`` is ``cam_from_model`` for the mesh in ``models/``. The origin of that mesh is the mean of its vertices, not the
centre of its box as in BOP's own datasets; ``models_info.json`` holds where that centre is.
"""

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path

import numpy as np

from ...camera.pinhole import PinholeCamera
from ...files.tables import write_json
from ...files.writing import create_folder, write_bytes_atomically, written_file
from ...surface.decimation import reduced_mesh
from ...surface.mesh import TriangleMesh, diameter
from ...surface.mesh_writer import write_ply
from ..layout import OBJECT_ID, TARGETS, ViewPaths
from ..run.resume_record import Box, ViewRecord

EVAL_VERTICES = 10_000
"""Most vertices of the model in ``models_eval/``: about as many as in BOP's, as errors of poses visit every vertex."""
LEAST_VISIBLE = 0.1
"""BOP tests on objects of at least this visible fraction."""
HIDDEN_BELOW = 0.1
"""Annotations with a smaller visible fraction are marked ``ignore``, as bop_toolkit does."""


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
    write_json(folder / "scene_gt_coco_modal.json", coco_table(paths, records, camera, object_name), indent=None)


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


def run_lengths(mask: np.ndarray) -> tuple[int, ...]:
    """The uncompressed run-length encoding of an ``(H, W)`` bool mask: column by column, zeros first."""
    flat = np.concatenate([[False], mask.T.ravel(), [False]])
    edges = np.flatnonzero(flat[1:] != flat[:-1])
    counts = np.diff(np.concatenate([[0], edges, [mask.size]]))
    if len(counts) > 1 and counts[-1] == 0:
        counts = counts[:-1]
    return tuple(counts.tolist())


def compressed_counts(counts: Sequence[int]) -> str:
    """Run lengths as COCO's compressed text, the only form that ``COCO.loadRes`` takes.

    Every number is the difference to the run before the last one, in groups of 5 bits, the lowest first, with a sixth
    bit if more follow. Source: cocodataset/cocoapi, ``rleToString`` in common/maskApi.c.
    """
    values = np.array(counts, np.int64)
    values[3:] -= values[1:-2].copy()
    # bits of the absolute value, of -v - 1 for a negative one, and one of sign
    size = values ^ (values >> 63)
    shifts = 5 * np.arange(max(1, -(-(int(np.max(size, initial=0)).bit_length() + 1) // 5)))
    groups = (values[:, None] >> shifts) & 31
    # a group is needed if what is left before it is more than the sign of the group below
    needed = np.concatenate([np.ones((len(values), 1), bool), size[:, None] >> (shifts[1:] - 1) > 0], axis=1)
    more = np.concatenate([needed[:, 1:], np.zeros((len(values), 1), bool)], axis=1)
    return (48 + (groups | 32 * more))[needed].astype(np.uint8).tobytes().decode()


def coco_table(
    paths: Sequence[ViewPaths], records: Sequence[ViewRecord], camera: PinholeCamera, object_name: str
) -> dict[str, object]:
    """The images, annotations and single category of a scene's views.

    As in bop_toolkit, paths are relative to the scene's folder, boxes and areas are those of the visible mask, and a
    view without visible surface has no annotation.
    """
    images, annotations = [], []
    for path, record in zip(paths, records, strict=True):
        size = {"width": camera.width, "height": camera.height}
        name = path.file("rgb").relative_to(path.scene).as_posix()
        images.append({"id": path.image_id, "file_name": name, **size})
        info = record.gt_info
        if not info.px_count_visib:
            continue
        x, y, to_last_column, to_last_row = info.bbox_visib
        annotations.append(
            {
                # pycocotools takes 0 for "no match"
                "id": path.image_id + 1,
                "image_id": path.image_id,
                "category_id": OBJECT_ID,
                "iscrowd": 0,
                "area": info.px_count_visib,
                # COCO counts pixels, BOP the steps between them
                "bbox": [x, y, to_last_column + 1, to_last_row + 1],
                "segmentation": {
                    "counts": compressed_counts(record.rle_counts),
                    "size": [camera.height, camera.width],
                },
                **size,
                "ignore": info.visib_fract < HIDDEN_BELOW,
            }
        )
    category = {"id": OBJECT_ID, "name": object_name, "supercategory": "surface"}
    return {"info": {}, "licenses": [], "categories": [category], "images": images, "annotations": annotations}
