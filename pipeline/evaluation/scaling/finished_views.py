"""A folder of any number of finished views, for measurements: real records and names, and files of a few bytes.

The records are what a run writes for 1280x960 px: about 2 000 runs of the mask, a drawn pose, and the sizes and hashes
of all files. Files hold a short text instead of pixels, so that 700 000 of them are written in a minute: a resume scan
and the tables read none of them.
"""

import json
import os
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict
from itertools import repeat
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from ...camera.pinhole import PinholeCamera
from ...dataset.checksums import sum_of
from ...dataset.identity import description_bytes, identity_of
from ...dataset.layout import FORMAT, RECORD, ViewPaths, scene_count, scene_views, view_kinds
from ...dataset.options import DatasetOptions
from ...dataset.view_record import GroundTruthInfo, ViewRecord
from ...poses.constraints import Rejections
from ...transforms import rigid, rotation_from_vector

CAMERA = PinholeCamera(width=1280, height=960, fx=2900.0, fy=2900.0, cx=640.0, cy=480.0)
KINDS = view_kinds(float_depth=True)
OBJECT_NAME = "stand-in"
DEPTH_SCALE = 0.005
RUNS = 2000
"""Runs of a mask: twice the number of its columns that show surface, and some more where the surface has holes."""


def finished_description(count: int) -> dict[str, object]:
    """The description of the dataset, as in ``dataset.json``."""
    beside = ("count", "poses", "video", "video_frames", "quality", "tolerance_colour", "tolerance_px")
    options = asdict(DatasetOptions(count=count, float_depth=True))
    return {
        "format": FORMAT,
        "versions": {"oneframe": "0.0", "blender": "0.0"},
        "conventions": "mm",
        "count": count,
        "object": OBJECT_NAME,
        "options": {name: value for name, value in options.items() if name not in beside},
        "camera": {**asdict(CAMERA), "K": CAMERA.k.tolist()},
        "frame": {
            **asdict(CAMERA),
            "distortion": None,
            "cam_from_model": rigid(translation=np.array([0, 0, 300.0])).tolist(),
        },
        "mesh_from_model": np.eye(4).tolist(),
        "mm_per_unit": 1.0,
        "geometry_sha256": "22" * 32,
        "structures": {},
        "inputs_sha256": {"frame": "00" * 32, "surface": "11" * 32},
    }


def write_finished_views(root: Path, count: int, *, processes: int = 1) -> Iterator[int]:
    """Write the views of a dataset, without its tables, into a new folder; yields the number of views of each scene.

    Nothing is flushed to the disk: a loss of power may leave anything.

    Raises
    ------
    OSError
        The folder exists, or cannot be written to.
    """
    root.mkdir(parents=True)
    description = finished_description(count)
    (root / RECORD).write_bytes(description_bytes(description))
    scenes = range(scene_count(count))
    if processes == 1:
        for scene in scenes:
            yield _write_scene(root, scene, count, identity_of(description))
        return
    with ProcessPoolExecutor(processes, mp_context=get_context("spawn")) as pool:
        yield from pool.map(_write_scene, repeat(root), scenes, repeat(count), repeat(identity_of(description)))


def _write_scene(root: Path, scene: int, count: int, identity: str) -> int:
    views = scene_views(scene, count)
    for kind in (*KINDS, "frame"):
        os.makedirs(ViewPaths(root, views.start).file(kind).parent)
    for index in views:
        paths = ViewPaths(root, index)
        files = {paths.relative(kind): f"{kind} of view {index}".encode() for kind in KINDS}
        record = finished_record(paths, identity, files)
        files[paths.relative("frame")] = (json.dumps(record.to_json(), separators=(",", ":")) + "\n").encode()
        for name, data in files.items():
            with open(root / name, "xb", buffering=0) as stream:
                stream.write(data)
    return len(views)


def finished_record(paths: ViewPaths, identity: str, files: dict[str, bytes]) -> ViewRecord:
    """The record of a view with these files, by name; it depends on the view's number alone."""
    rng = np.random.default_rng(paths.index)
    height, width = CAMERA.shape_hw
    columns = RUNS // 2
    first = int(rng.integers(0, width - columns))
    # each column: background above, surface; its rest is part of the next column's first run
    tops, lengths = rng.integers(100, 300, columns), rng.integers(400, 600, columns)
    starts = (first + np.arange(columns)) * height + tops
    edges = np.stack([starts, starts + lengths], axis=1).ravel()
    runs = np.diff(np.concatenate([[0], edges, [width * height]]))
    visible = int(lengths.sum())
    top, bottom = int(np.min(tops)), int(np.max(tops + lengths)) - 1
    box = (first, top, columns - 1, bottom - top)
    return ViewRecord(
        index=paths.index,
        identity=identity,
        cam_from_model=rigid(rotation_from_vector(rng.normal(size=3)), rng.uniform((-5, -5, 250), (5, 5, 350))),
        depth_scale=DEPTH_SCALE,
        gt_info=GroundTruthInfo(box, box, visible, visible, visible, 1.0),
        px_count_observed=visible // 2,
        attempts=2,
        rejections=Rejections(observed=1),
        files={name: sum_of(data) for name, data in files.items()},
        rle_counts=tuple(runs.tolist()),
    )
