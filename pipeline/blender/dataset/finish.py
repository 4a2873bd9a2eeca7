"""The end of a dataset job: models, tables, contact sheet and video, once the views that they need exist."""

from collections.abc import Collection, Iterable, Iterator
from contextlib import suppress
from pathlib import Path

import numpy as np

from ...case.loaded_case import frame_overlay
from ...colour.vertex_colours import colour_vertices
from ...dataset.checksums import Checksums, FileSurvey, read_checksums, write_checksums
from ...dataset.dataset_file import read_description
from ...dataset.layout import RECORD, VIDEO_FILES, ViewPaths, other_files, scene_folder
from ...dataset.run.survey import Tally
from ...dataset.tables.bop import write_camera, write_models, write_scene
from ...dataset.tables.dataset_info import write_dataset_info
from ...dataset.tables.pose_tables import POSE_COLUMNS, pose_cells
from ...dataset.tables.view_tables import scene_records, write_view_tables
from ...errors import RunError
from ...files.content import create_folder, read_file, write_bytes_atomically
from ...files.tables import write_csv
from ...images.contact_sheet import contact_sheet
from ...images.image_reader import read_image
from ...images.pixel_values import to_uint8
from ...images.png import encode_png
from ...progress import Progress
from ..render.video import FRAMES_PER_SECOND, write_video
from .job import OpenJob
from .view_renderer import ViewRenderer

SHEET_VIEWS, SHEET_COLUMNS, SHEET_TILE_PX = 24, 6, 240


def write_model_files(job: OpenJob, renderer: ViewRenderer) -> None:
    """Write ``camera.json`` and ``models/``, which are known before the first view."""
    out, reference = job.job.out, renderer.reference
    write_camera(out, renderer.camera, renderer.depth_scale)
    colours = colour_vertices(reference.mesh, reference.views)
    write_models(out, reference.mesh, to_uint8(colours.rgb))


def write_overlay(job: OpenJob, renderer: ViewRenderer) -> None:
    """Write ``overlay.png``: the frame with the surface's outline and the structures, to judge the alignment."""
    picture = frame_overlay(job.loaded, renderer.reference.view.depth_mm)
    write_bytes_atomically(job.job.out / "overlay.png", encode_png(to_uint8(picture)))


def write_finished_scenes(job: OpenJob, renderer: ViewRenderer) -> None:
    """Write the tables of every complete scene that has views of this job's shard, while others are not complete."""
    for scene in sorted({ViewPaths(job.job.out, index).scene_id for index in job.views}):
        # a record of another shard may be missing or damaged
        with suppress(RunError):
            records = scene_records(job.job.out, scene, job.count, job.identity)
            write_scene(job.job.out, records, renderer.camera, job.object_name)


def write_dataset_tables(job: OpenJob, renderer: ViewRenderer) -> Tally:
    """Write the tables of a complete dataset, its overlay and its contact sheet; gives sums over all views."""
    out, camera, mesh = job.job.out, renderer.camera, renderer.reference.mesh
    depth_scale = renderer.depth_scale
    description = read_description(out / RECORD)
    tally = write_view_tables(out, description, bounds=mesh.bounds, depth_scale=depth_scale)
    occluded = job.job.options.occluders > 0
    write_dataset_info(out, job.object_name, job.count, camera, mesh, depth_scale, occluded=occluded)
    write_overlay(job, renderer)
    chosen = np.unique(np.linspace(0, job.count - 1, min(SHEET_VIEWS, job.count)).round().astype(int))
    images = [read_image(ViewPaths(out, int(index)).file("rgb"))[0] for index in chosen]
    sheet = contact_sheet(images, columns=min(SHEET_COLUMNS, len(images)), tile_width=SHEET_TILE_PX)
    write_bytes_atomically(out / "contact_sheet.png", encode_png(to_uint8(sheet)))
    return tally


def video_to_render(job: OpenJob, files: FileSurvey) -> int | None:
    """Number of frames of the video that is to be rendered; ``None`` if there is nothing to do.

    That is the video that the options ask for, or one that the dataset had and that is damaged now.
    """
    frames = job.job.options.video_frames
    video, poses = VIDEO_FILES
    found = _video_frames(job.job.out / poses) if poses in files.intact else None
    if job.job.options.video:
        return None if video in files.intact and found == frames else frames
    if video in files.damaged or poses in files.damaged:
        return found or frames
    return None


def _video_frames(poses: Path) -> int:
    return read_file(poses).count(b"\n") - 1


def write_trajectory_video(job: OpenJob, renderer: ViewRenderer, frames: int, progress: Progress) -> Path:
    """Write ``video/trajectory.mp4`` and ``video/poses.csv``, one pose per frame; returns the video's path."""
    video, table = (job.job.out / name for name in VIDEO_FILES)
    poses = renderer.video_poses(frames)

    def images() -> Iterator[np.ndarray]:
        for pose in poses:
            yield renderer.render(pose).rgb
            progress.advance()

    create_folder(video.parent)
    write_video(video, images())
    rows = [[number, repr(number / FRAMES_PER_SECOND), *pose_cells(pose)] for number, pose in enumerate(poses)]
    write_csv(table, ("frame", "time_s", *POSE_COLUMNS), rows)
    return video


def write_sums(job: OpenJob, *, written: Collection[str], rendered: Iterable[int], video: bool) -> None:
    """Write ``checksums.json`` of a dataset whose other files are all written.

    Parameters
    ----------
    job
        The job.
    written
        Files that this run has written; of the others, ``checksums.json`` keeps what it says.
    rendered
        Views that this run has rendered.
    video
        Whether the dataset has a video.
    """
    out = job.job.out
    scenes = {scene_folder(ViewPaths(out, index).scene_id) for index in rendered}
    known = (read_checksums(out, job.identity) or Checksums()).without(written, scenes)
    names = [*other_files(job.count), *(VIDEO_FILES if video else ())]
    write_checksums(out, job.identity, names, known=known)
