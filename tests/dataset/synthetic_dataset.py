"""A tiny dataset as render_dataset.py would write it, rendered by casting a ray through every pixel."""

import json
from collections.abc import Iterable
from dataclasses import asdict
from pathlib import Path

import cv2
import numpy as np

from oneframe.camera.pinhole import PinholeCamera
from oneframe.dataset.checksums import write_checksums
from oneframe.dataset.identity import geometry_hash, identity_of
from oneframe.dataset.layout import ViewPaths
from oneframe.dataset.options import DatasetOptions
from oneframe.dataset.run.resume_record import GroundTruthInfo, ViewRecord, read_record
from oneframe.dataset.tables.bop import (
    bounding_box,
    is_test_target,
    run_lengths,
    write_camera,
    write_models,
    write_scene,
    write_test_targets,
)
from oneframe.dataset.tables.dataset_info import write_dataset_info
from oneframe.dataset.tables.pose_tables import POSE_COLUMNS, pose_cells, write_poses
from oneframe.dataset.truths import TRUTHS, Shot
from oneframe.files.tables import write_csv
from oneframe.images.contact_sheet import contact_sheet
from oneframe.images.pixel_values import to_uint8
from oneframe.images.png import encode_png
from oneframe.poses.constraints import Rejections
from oneframe.projection.rendered_view import RenderedView
from oneframe.surface.mesh import TriangleMesh
from oneframe.transforms import rigid, rotation_from_vector, transform_points
from tests.dataset.blank_dataset import write_view

CAMERA = PinholeCamera(width=64, height=48, fx=151.3, fy=147.9, cx=30.2, cy=25.1)
COUNT, PER_SCENE, DEPTH_SCALE = 4, 3, 0.01
SCENES = (0, [0, 1, 2]), (1, [3])
"""Number of a scene and of its views."""
CENTRE = np.array([11.0, -7.0, 420.0])
VIDEO_FRAMES = 3
OBJECT_NAME = "lumpy sphere"
KINDS = ("rgb", "depth", "mask", "mask_visib", "mask_observed", "source_frame", "depth_mm")


def encoded(rgb: np.ndarray, depth_mm: np.ndarray, source: np.ndarray, depth_scale: float) -> dict[str, bytes]:
    """The files of a view with these arrays, by kind."""
    view = RenderedView(rgb, depth_mm, source, np.zeros(depth_mm.shape, bool))
    shot = Shot(view, np.eye(4), MESH, CAMERA, depth_scale)
    return {kind: TRUTHS[kind].form.encoded(TRUTHS[kind].array(shot)) for kind in KINDS}


def lumpy_sphere() -> TriangleMesh:
    """A closed surface of 400 triangles with slopes in every direction, radius about 30 mm, its vertices demeaned."""
    latitude, longitude = np.meshgrid(np.linspace(-1.4, 1.4, 11), np.arange(20) * 2 * np.pi / 20, indexing="ij")
    around = np.stack(
        [np.cos(latitude) * np.cos(longitude), np.cos(latitude) * np.sin(longitude), np.sin(latitude)], axis=-1
    ).reshape(-1, 3)
    points = np.concatenate([around, [[0, 0, -1], [0, 0, 1]]])
    points *= 30 + 4 * np.sin(5 * points[:, :1]) * np.cos(4 * points[:, 1:2] + 1)
    i, j = np.mgrid[:10, :20]
    a, b = i * 20 + j, i * 20 + (j + 1) % 20
    sides = [np.stack([a, b, b + 20], -1).reshape(-1, 3), np.stack([a, b + 20, a + 20], -1).reshape(-1, 3)]
    first, second = np.arange(20), (np.arange(20) + 1) % 20
    caps = [np.stack([second, first, 0 * first + 220], -1), np.stack([first + 200, second + 200, 0 * first + 221], -1)]
    # single precision, as the file stores it
    points = (points - points.mean(axis=0)).astype(np.float32).astype(np.float64)
    return TriangleMesh(points, np.concatenate([*sides, *caps]).astype(np.int32))


MESH = lumpy_sphere()


def cast_rays(mesh: TriangleMesh, camera: PinholeCamera, cam_from_model: np.ndarray, *, beyond: int = 0) -> np.ndarray:
    """Depth by Moeller & Trumbore's intersection of every ray with every triangle; 0 for none.

    ``beyond`` adds so many image sizes on each side.
    """
    a, b, c = np.moveaxis(transform_points(cam_from_model, mesh.vertices)[mesh.faces], 1, 0)
    across, down = b - a, c - a
    depth = np.zeros(((1 + 2 * beyond) * camera.height, (1 + 2 * beyond) * camera.width))
    (left, top), (right, bottom) = (0, 0), depth.shape[::-1]
    corners = np.concatenate([a, b, c])
    if corners[:, 2].min() > 0:
        # no ray meets a triangle outside the box of the projected corners
        at = camera.project(corners) + beyond * np.array(camera.size_wh)
        box = np.stack([np.floor(at.min(axis=0)), np.ceil(at.max(axis=0)) + 1]).clip(0, depth.shape[::-1])
        (left, top), (right, bottom) = box.astype(int)
    v, u = np.mgrid[top:bottom, left:right] - beyond * np.array([camera.height, camera.width])[:, None, None]
    rays = np.stack([(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, np.ones_like(u)], -1).reshape(-1, 3)
    normal = np.cross(across, down)
    with np.errstate(divide="ignore", invalid="ignore"):
        along = rays @ normal.T
        z = (a * normal).sum(axis=1) / along
        first = -(rays @ np.cross(a, down).T) / along
        second = -(rays @ np.cross(across, a).T) / along
        hit = (first >= 0) & (second >= 0) & (first + second <= 1) & (z > 0)
    nearest = np.where(hit, z, np.inf).min(axis=1)
    depth[top:bottom, left:right] = np.where(np.isfinite(nearest), nearest, 0).reshape(u.shape)
    return depth


def pose_of(index: int) -> np.ndarray:
    turn = rotation_from_vector(np.array([0.4 + 0.3 * index, -0.7 + 0.2 * index, 0.3 * index]))
    # the last view is cut by the image's edge
    return rigid(turn, [18.0 if index == COUNT - 1 else 1.5 * index - 2, 2.0 - index, 260.0 + 20 * index])


def video_pose(index: int) -> np.ndarray:
    """The surface moves across the image from frame to frame."""
    return rigid(translation=[12.0 * index - 12, 0, 0]) @ pose_of(index)


def description_of() -> dict:
    """The content of ``dataset.json``."""
    options = DatasetOptions(count=COUNT, float_depth=True)
    return {
        "format": "oneframe dataset 2",
        "versions": {"oneframe": "0.0", "blender": "0.0"},
        "conventions": "mm",
        "count": COUNT,
        "object": OBJECT_NAME,
        "options": {
            name: value
            for name, value in asdict(options).items()
            if name not in ("count", "poses", "video", "video_frames")
        },
        "camera": {**asdict(CAMERA), "K": CAMERA.k.tolist()},
        "frame": {**asdict(CAMERA), "distortion": None, "cam_from_model": pose_of(0).tolist()},
        "frames": [{**asdict(CAMERA), "distortion": None, "cam_from_model": pose_of(1).tolist()}],
        "mesh_from_model": rigid(translation=CENTRE).tolist(),
        "mm_per_unit": 1.0,
        "geometry_sha256": geometry_hash(MESH),
        "structures": {},
        "inputs_sha256": {"frame": "00" * 32, "surface": "11" * 32},
    }


def make_dataset(root: Path, *, video: bool = True) -> None:
    """What render_dataset.py would have written."""
    root.mkdir()
    description = description_of()
    (root / "dataset.json").write_text(json.dumps(description))
    write_models(root, MESH, np.full((len(MESH.vertices), 3), 200, np.uint8))
    colours = [write_one(root, index, identity_of(description)) for index in range(COUNT)]
    write_tables(root, CAMERA)
    sheet = contact_sheet([to_uint8(colour) / 255 for colour in colours], columns=COUNT, tile_width=240)
    (root / "contact_sheet.png").write_bytes(encode_png(to_uint8(sheet)))
    (root / "overlay.png").write_bytes(encode_png(np.zeros((*CAMERA.shape_hw, 3), np.uint8)))
    if video:
        write_video(root / "video")
    write_sums(root)


def write_video(folder: Path) -> None:
    folder.mkdir()
    video = cv2.VideoWriter(str(folder / "trajectory.mp4"), cv2.VideoWriter_fourcc(*"mp4v"), 24, CAMERA.size_wh)
    poses = [video_pose(index) for index in range(VIDEO_FRAMES)]
    for pose in poses:
        mask = cast_rays(MESH, CAMERA, pose) > 0
        video.write(np.repeat(np.where(mask, np.uint8(180), np.uint8(0))[..., None], 3, axis=2))
    video.release()
    rows = [[number, repr(number / 24), *pose_cells(pose)] for number, pose in enumerate(poses)]
    write_csv(folder / "poses.csv", ("frame", "time_s", *POSE_COLUMNS), rows)


def write_sums(root: Path) -> None:
    """The sums of all files but the views', of the dataset as it is now."""
    names = (path.relative_to(root).as_posix() for path in root.rglob("*") if path.is_file())
    others = [name for name in names if name.count("/") != 3 and name != "checksums.json"]
    write_checksums(root, identity_of(json.loads((root / "dataset.json").read_text())), others)


def write_one(root: Path, index: int, identity: str) -> np.ndarray:
    """Write a view; returns its colours, ``(H, W, 3)`` 0..1."""
    pose = pose_of(index)
    wide = cast_rays(MESH, CAMERA, pose, beyond=1)
    depth = wide[CAMERA.height : 2 * CAMERA.height, CAMERA.width : 2 * CAMERA.width].astype(np.float32)
    mask = depth > 0
    v, u = np.mgrid[: CAMERA.height, : CAMERA.width]
    observed = mask & (u > 12)
    colour = np.stack([u / 64, v / 48, np.full(u.shape, 0.5 + 0.1 * index)], -1) * mask[..., None]
    rows = np.argwhere(wide > 0)
    (top, left), (bottom, right) = rows.min(axis=0), rows.max(axis=0)
    inside, whole = int(mask.sum()), len(rows)
    box = tuple(map(int, (left - CAMERA.width, top - CAMERA.height, right - left, bottom - top)))
    paths = ViewPaths(root, index)
    source = np.where(observed, np.where(u > 30, np.uint8(2), np.uint8(1)), np.uint8(0))
    files = encoded(colour, depth, source, DEPTH_SCALE)
    record = ViewRecord(
        index=index,
        identity=identity,
        cam_from_model=pose,
        depth_scale=DEPTH_SCALE,
        gt_info=GroundTruthInfo(box, bounding_box(mask), whole, inside, inside, inside / whole),
        px_count_observed=int(observed.sum()),
        attempts=1,
        rejections=Rejections(),
        files={},
        rle_counts=run_lengths(mask),
    )
    write_view(paths, files, record)
    return colour


def write_tables(root: Path, camera: PinholeCamera) -> None:
    write_camera(root, camera, DEPTH_SCALE)
    records = [read_record(ViewPaths(root, index)) for index in range(COUNT)]
    for first in range(0, COUNT, PER_SCENE):
        write_scene(root, records[first : first + PER_SCENE], camera, OBJECT_NAME)
    write_pose_tables(root)
    write_test_targets(root, [record.index for record in records if is_test_target(record)])
    write_dataset_info(root, OBJECT_NAME, COUNT, camera, MESH, DEPTH_SCALE)


def write_pose_tables(root: Path, views: Iterable[int] = range(COUNT), centre: np.ndarray = CENTRE) -> None:
    records = (read_record(ViewPaths(root, index)) for index in views)
    write_poses(root, records, CAMERA, rigid(translation=centre), bounds=MESH.bounds, depth_scale=DEPTH_SCALE)


def scene_tables(root: Path, scene: int) -> dict[str, dict]:
    folder = root / "train_synt" / f"{scene:06d}"
    return {path.stem: json.loads(path.read_text()) for path in folder.glob("*.json")}
