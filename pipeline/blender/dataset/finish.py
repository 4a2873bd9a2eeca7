"""The end of a dataset job: tables, contact sheet and video, once the views that they need exist."""

from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path

import numpy as np

from ...colour.vertex_colours import colour_vertices
from ...dataset.bop import write_camera, write_models, write_scene, write_test_targets
from ...dataset.checksums import CHECKSUMS, write_checksums
from ...dataset.dataset_info import write_dataset_info
from ...dataset.folder import RECORD
from ...dataset.layout import OBJECT_ID, VIEWS_PER_SCENE, ViewPaths, finished_views
from ...dataset.pose_tables import POSE_COLUMNS, pose_cells, write_poses
from ...dataset.view_record import read_record
from ...files.content import write_bytes_atomically
from ...files.tables import write_csv
from ...images.contact_sheet import contact_sheet
from ...images.pixel_values import to_uint8
from ...images.png import encode_png
from ...poses.constraints import Rejections
from ...progress import Progress
from ..alignment.frame_overlay import frame_overlay
from ..bridge.image import read_image
from ..render.video import FRAMES_PER_SECOND, write_video
from .job import OpenJob
from .view_renderer import ViewRenderer

SHEET_VIEWS, SHEET_COLUMNS, SHEET_TILE_PX = 24, 6, 240
MODEL_FILES = tuple(
    f"{folder}/{name}"
    for folder in ("models", "models_eval")
    for name in (f"obj_{OBJECT_ID:06d}.ply", "models_info.json")
)
TABLES = (
    "camera.json", *MODEL_FILES, "poses.csv", "transforms.json", "test_targets_bop19.json", "dataset_info.md",
    "overlay.png", "contact_sheet.png",
)  # fmt: skip
VIDEO_FILES = ("video/trajectory.mp4", "video/poses.csv")
SCENE_TABLES = ("scene_camera.json", "scene_gt.json", "scene_gt_info.json", "scene_gt_coco.json")


def is_complete(job: OpenJob) -> bool:
    """Whether all views and all tables of the whole dataset exist."""
    out = job.job.out
    tables = all((out / name).exists() for name in (*_tables(job), CHECKSUMS))
    return tables and len(finished_views(out, range(job.count))) == job.count


def write_sums(job: OpenJob) -> None:
    """Write ``checksums.json`` of a dataset whose other files are all written."""
    out = job.job.out
    video = VIDEO_FILES if all((out / name).exists() for name in VIDEO_FILES) else ()
    write_checksums(out, job.identity, (RECORD, *_tables(job), *video))


def _tables(job: OpenJob) -> list[str]:
    """The files of a dataset that are no view's, without its description, checksums and video."""
    out = job.job.out
    scenes = [ViewPaths(out, first).scene.relative_to(out) for first in range(0, job.count, VIEWS_PER_SCENE)]
    return [*TABLES, *((scene / name).as_posix() for scene in scenes for name in SCENE_TABLES)]


def write_model_files(job: OpenJob, renderer: ViewRenderer) -> None:
    """Write ``camera.json`` and ``models/``, which are known before the first view."""
    out, source = job.job.out, renderer.source
    write_camera(out, renderer.camera, renderer.depth_scale)
    colours = colour_vertices(source.mesh, source.view)
    write_models(out, source.mesh, to_uint8(colours.rgb))


def write_overlay(job: OpenJob, renderer: ViewRenderer) -> None:
    """Write ``overlay.png``: the frame with the surface's outline and the structures, to judge the alignment."""
    picture = frame_overlay(job.loaded, renderer.source.view.depth_mm)
    write_bytes_atomically(job.job.out / "overlay.png", encode_png(to_uint8(picture)))


def write_finished_scenes(job: OpenJob, renderer: ViewRenderer) -> bool:
    """Write the tables of every complete scene that has views of this job's shard.

    Returns
    -------
    Whether all views of the whole dataset exist.
    """
    out, done = job.job.out, finished_views(job.job.out, range(job.count))
    touched = sorted({index // VIEWS_PER_SCENE for index in job.views})
    for scene in touched:
        views = range(scene * VIEWS_PER_SCENE, min((scene + 1) * VIEWS_PER_SCENE, job.count))
        if done.issuperset(views):
            write_scene(out, views, renderer.camera, job.object_name)
    return len(done) == job.count


def write_dataset_tables(job: OpenJob, renderer: ViewRenderer) -> None:
    """Write the tables of a complete dataset: missing scene tables, poses, overlay and contact sheet."""
    out = job.job.out
    for first in range(0, job.count, VIEWS_PER_SCENE):
        views = range(first, min(first + VIEWS_PER_SCENE, job.count))
        if not (ViewPaths(out, first).scene / SCENE_TABLES[-1]).exists():
            write_scene(out, views, renderer.camera, job.object_name)
    mesh, depth_scale = renderer.source.mesh, renderer.depth_scale
    write_poses(
        out,
        range(job.count),
        renderer.camera,
        job.loaded.mesh_from_model,
        bounds=mesh.bounds,
        depth_scale=depth_scale,
    )
    write_test_targets(out, range(job.count))
    write_dataset_info(out, job.object_name, job.count, renderer.camera, mesh, depth_scale)
    chosen = np.unique(np.linspace(0, job.count - 1, min(SHEET_VIEWS, job.count)).round().astype(int))
    images = [read_image(ViewPaths(out, int(index)).file("rgb"))[0] for index in chosen]
    columns = min(SHEET_COLUMNS, len(images))
    write_overlay(job, renderer)
    sheet = contact_sheet(images, columns=columns, tile_width=SHEET_TILE_PX)
    write_bytes_atomically(out / "contact_sheet.png", encode_png(to_uint8(sheet)))


def lacks_video(job: OpenJob) -> bool:
    """Whether the options ask for a video that does not exist or is incomplete; its poses are written last."""
    folder, options = job.job.out / "video", job.job.options
    if not options.video:
        return False
    if not ((folder / "trajectory.mp4").exists() and (folder / "poses.csv").exists()):
        return True
    return (folder / "poses.csv").read_bytes().count(b"\n") - 1 != options.video_frames


def write_trajectory_video(job: OpenJob, renderer: ViewRenderer, progress: Progress) -> Path:
    """Write ``video/trajectory.mp4`` and ``video/poses.csv``, one pose per frame; returns the video's path."""
    folder = job.job.out / "video"
    (folder / "poses.csv").unlink(missing_ok=True)
    poses = renderer.video_poses()

    def images() -> Iterator[np.ndarray]:
        for pose in poses:
            yield renderer.render(pose).rgb
            progress.advance()

    write_video(folder / "trajectory.mp4", images())
    rows = [[number, repr(number / FRAMES_PER_SECOND), *pose_cells(pose)] for number, pose in enumerate(poses)]
    write_csv(folder / "poses.csv", ("frame", "time_s", *POSE_COLUMNS), rows)
    return folder / "trajectory.mp4"


def summary(job: OpenJob) -> list[str]:
    """Messages about a complete dataset: the observed fraction of the surface, and the rejected poses."""
    visible = observed = attempts = 0
    rejections = Rejections()
    for index in range(job.count):
        record = read_record(ViewPaths(job.job.out, index))
        visible += record.gt_info.px_count_visib
        observed += record.px_count_observed
        attempts += record.attempts
        rejections += record.rejections
    names = {"surface": "too little surface", "observed": "too little observed surface", "clearance": "too near"}
    messages = [
        f"the frame observed {observed / visible:.1%} of the surface in the views"
        if visible
        else "no view shows any surface"
    ]
    reasons = ", ".join(f"{count} with {names[name]}" for name, count in asdict(rejections).items() if count)
    if reasons:
        drawn = attempts > job.count
        messages.append(
            f"{attempts} poses drawn, {attempts - job.count} rejected ({reasons})"
            if drawn
            else f"poses that break the constraints, kept because they were listed: {reasons}"
        )
    return messages
