"""Five views in two scenes with blank images, for laws of the tables made from their records."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from oneframe.camera.pinhole import PinholeCamera
from oneframe.dataset import layout
from oneframe.dataset.layout import ViewPaths
from oneframe.dataset.run.resume_record import GroundTruthInfo, ViewRecord, read_record
from oneframe.dataset.tables.bop import (
    bounding_box,
    is_test_target,
    run_lengths,
    write_camera,
    write_scene,
    write_test_targets,
)
from oneframe.dataset.tables.pose_tables import write_poses
from oneframe.dataset.view import ViewWriter, file_sums
from oneframe.poses.constraints import Rejections
from oneframe.transforms import rigid, rotation_from_vector

CAMERA = PinholeCamera(width=20, height=14, fx=31.7, fy=29.3, cx=8.2, cy=7.9)
CENTRE = np.array([11.0, -7.0, 420.0])
BOUNDS = np.array([[-31.0, -24.0, -6.0], [29.0, 26.0, 8.0]])
DEPTH_SCALE = 0.002
OBJECT_NAME = "lumpy bone"


def pose_of(index: int) -> np.ndarray:
    return rigid(rotation_from_vector(np.array([0.3 * index, -0.7, 0.2 * index + 1.5])), [1.0, -0.5, 60.0 + index])


def record_of(index: int) -> ViewRecord:
    """The fourth view shows nothing."""
    seen = 0 if index == 3 else 6 + index
    mask = np.arange(CAMERA.width * CAMERA.height).reshape(CAMERA.shape_hw) < seen
    return ViewRecord(
        index=index,
        identity="ab" * 32,
        cam_from_model=pose_of(index),
        # the fifth view reaches farther than the scale of the others
        depth_scale=DEPTH_SCALE if index < 4 else 0.005,
        gt_info=GroundTruthInfo((1, 2, 3, 4), bounding_box(mask), 80, seen, seen, seen / 80),
        px_count_observed=seen // 2,
        attempts=3,
        rejections=Rejections(observed=1, clearance=2),
        files={},
        rle_counts=run_lengths(mask),
    )


def write_view(paths: ViewPaths, files: dict[str, bytes], record: ViewRecord) -> None:
    """A finished view of these files, by kind."""
    with ViewWriter(lambda _: None) as writer:
        writer.write(paths, files, replace(record, files=file_sums(paths, files)))


def write_blank_dataset(root: Path) -> None:
    """Views and tables; the images are blank."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(layout, "VIEWS_PER_SCENE", 3)
        for index in range(5):
            write_view(ViewPaths(root, index), {"rgb": b""}, record_of(index))
        write_camera(root, CAMERA, DEPTH_SCALE)
        records = [read_record(ViewPaths(root, index)) for index in range(5)]
        for scene in (records[:3], records[3:]):
            write_scene(root, scene, CAMERA, OBJECT_NAME)
        write_poses(root, records, CAMERA, rigid(translation=CENTRE), bounds=BOUNDS, depth_scale=DEPTH_SCALE)
        write_test_targets(root, [record.index for record in records if is_test_target(record)])


def scene_tables(root: Path, scene: int) -> dict[str, dict]:
    folder = root / "train_synt" / f"{scene:06d}"
    return {path.stem: json.loads(path.read_text()) for path in folder.glob("*.json")}
