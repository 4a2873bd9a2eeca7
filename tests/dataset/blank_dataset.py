"""Records of views and their files, without a surface."""

from dataclasses import replace

import numpy as np

from oneframe.camera.pinhole import PinholeCamera
from oneframe.dataset.layout import ViewPaths
from oneframe.dataset.run.resume_record import GroundTruthInfo, ViewRecord
from oneframe.dataset.tables.bop import bounding_box, run_lengths
from oneframe.dataset.view import ViewWriter, file_sums
from oneframe.poses.constraints import Rejections
from oneframe.transforms import rigid, rotation_from_vector

CAMERA = PinholeCamera(width=20, height=14, fx=31.7, fy=29.3, cx=8.2, cy=7.9)


def record_of(index: int) -> ViewRecord:
    seen = 6 + index
    mask = np.arange(CAMERA.width * CAMERA.height).reshape(CAMERA.shape_hw) < seen
    return ViewRecord(
        index=index,
        identity="ab" * 32,
        cam_from_model=rigid(rotation_from_vector(np.array([0.3 * index, -0.7, 1.5])), [1.0, -0.5, 60.0 + index]),
        depth_scale=0.002,
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
