"""A whole dataset run from start to end, for ``render_dataset.py`` and the add-on's background job."""

import signal
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from typing import TextIO

import numpy as np

from ...colour.vertex_colours import colour_vertices
from ...dataset.checksums import FileSurvey, survey_files, write_checksums
from ...dataset.dataset_file import read_description
from ...dataset.layout import CONTACT_SHEET, RECORD, VIDEO_FILES, ViewPaths, evenly_spaced, other_files
from ...dataset.option_arguments import option_arguments
from ...dataset.run.render_processes import FINISHED, WRITTEN, WorkerPool, assigned_views, report
from ...dataset.run.run_folder import RunFolder, check_description
from ...dataset.run.survey import Survey, Tally, survey_views, view_ranges
from ...dataset.tables.bop import write_camera, write_models
from ...dataset.tables.dataset_info import write_dataset_info
from ...dataset.tables.pose_tables import POSE_COLUMNS, pose_cells
from ...dataset.tables.view_tables import write_view_tables
from ...dataset.truths import written_truths
from ...files.content import read_file
from ...files.machine import available_cores
from ...files.tables import write_csv
from ...files.writing import create_folder, write_bytes_atomically
from ...images.contact_sheet import contact_sheet
from ...images.image_reader import read_image
from ...images.pixel_values import to_uint8
from ...images.png import encode_png
from ...progress import LINE_SECONDS, Progress
from ..render.engines import engine_named, keep_freed_memory
from ..render.video import FRAMES_PER_SECOND, write_video
from .job import Job, OpenJob, open_job, render_views, write_error
from .view_renderer import ViewRenderer

SHEET_VIEWS, SHEET_COLUMNS, SHEET_TILE_PX = 24, 6, 240


def run(
    job: Job,
    *,
    workers: int,
    worker_command: Sequence[str],
    stream: TextIO,
    verify: bool = False,
    progress_seconds: float = LINE_SECONDS,
) -> None:
    """Render the missing views of a job and, when the dataset is complete, write its tables; then what belongs in it.

    Parameters
    ----------
    job
        What to render.
    workers
        Number of processes, including this one; 0 for one per core.
    worker_command
        Starts another process that calls :func:`work` with the same job.
    stream
        Stream for progress and messages.
    verify
        Compare the hashes of all existing files, not only their sizes.
    progress_seconds
        Time between lines of progress where there is no terminal.
    """
    engine_named(job.options.engine).check()
    _run(job, _Means(workers, worker_command, stream, progress_seconds), verify=verify)
    for folder, options in job.options.further().items():
        further = replace(job, out=job.out / folder, options=options)
        command = [*worker_command, f"--out={further.out}", *option_arguments(options)]
        _run(further, _Means(workers, command, stream, progress_seconds), verify=verify)


def _run(job: Job, means: "_Means", *, verify: bool) -> None:
    opened = open_job(job)
    with RunFolder(job.out, opened.description, job.shard, poses=opened.given_poses) as folder:
        try:
            found = _survey(opened, verify=verify)
            for message in found.messages():
                means.report(message)
            tally = found.views.tally if found.is_complete else _complete(opened, found, means)
        except OSError as error:
            raise write_error(error, job.out) from error
        if tally is not None:
            folder.finish()
    if tally is not None:
        for message in (*tally.messages(opened.count), f"dataset of {opened.count} views: {job.out}"):
            means.report(message)
    elif job.shard.count > 1:
        means.report(
            f"shard {job.shard.index}/{job.shard.count}: {len(opened.views)} views are finished; when all shards are "
            "in one folder, run the same command without --shard to write the tables"
        )


@dataclass(frozen=True)
class _Means:
    """What a run works with: see :func:`run`."""

    workers: int
    worker_command: Sequence[str]
    stream: TextIO
    progress_seconds: float

    def report(self, message: str) -> None:
        """Write a message."""
        self.stream.write(message + "\n")
        self.stream.flush()

    def progress(self, total: int, noun: str, finished: int = 0) -> Progress:
        """Progress on the stream."""
        return Progress(total, noun, finished=finished, stream=self.stream, line_seconds=self.progress_seconds)


@dataclass(frozen=True)
class _Found:
    """What is on disk of a dataset: files that are no view's, and views; what is missing of these and of the video."""

    files: FileSurvey
    views: Survey
    has_tables: bool
    missing: tuple[int, ...]
    video_frames: int | None

    @property
    def lacks_tables(self) -> bool:
        """Whether views are missing, or what is made of them."""
        return bool(self.missing) or not self.has_tables

    @property
    def is_complete(self) -> bool:
        """Whether nothing is missing."""
        return not self.lacks_tables and self.video_frames is None

    def messages(self) -> Iterator[str]:
        """What was lost or damaged after it was finished."""
        if self.views.damaged:
            first = self.views.damaged[min(self.views.damaged)]
            yield (
                f"{len(self.views.damaged)} finished views are no longer whole and are rendered again: "
                f"{view_ranges(self.views.damaged)} ({first})"
            )
        if self.files.damaged:
            what = "; ".join(list(self.files.damaged.values())[:4])
            yield f"{len(self.files.damaged)} files of the dataset are no longer whole and are written again: {what}"


def _survey(opened: OpenJob, *, verify: bool) -> _Found:
    job = opened.job
    files = survey_files(job.out, opened.identity, hashes=verify)
    has_tables = files.intact.issuperset(other_files(opened.count))
    # all views of a dataset that was complete; else the other shards may be working on theirs
    wanted = range(opened.count) if has_tables else opened.views
    views = survey_views(
        job.out,
        wanted,
        opened.description,
        written_truths(job.options.content(), len(job.case.every_frame)),
        poses=opened.given_poses,
        hashes=verify,
        threads=available_cores(),
    )
    missing = tuple(index for index in wanted if index not in views.finished)
    return _Found(files, views, has_tables, missing, _video_to_render(opened, files))


def _complete(opened: OpenJob, found: _Found, means: _Means) -> Tally | None:
    """Render what is missing, then write what all views give; sums over them, ``None`` for a shard."""
    with _at_work(opened, found, means) as (renderer, pool, progress):
        if found.lacks_tables:
            _write_model_files(opened, renderer)
            render_views(renderer, opened.job.out, pool.views(), lambda _index: progress.advance())
        progress.close()
        if len(opened.views) < opened.count and found.lacks_tables:
            return None
        tally = _write_tables(opened, renderer, means.report) if found.lacks_tables else found.views.tally
        if found.video_frames is not None:
            with means.progress(found.video_frames, "video frames") as frames:
                _write_video(opened, renderer, found.video_frames, frames)
            means.report(f"video: {opened.job.out / VIDEO_FILES[0]}")
        video = VIDEO_FILES if all((opened.job.out / name).exists() for name in VIDEO_FILES) else ()
        write_checksums(opened.job.out, opened.identity, [*other_files(opened.count), *video])
    return tally


@contextmanager
def _at_work(opened: OpenJob, found: _Found, means: _Means) -> Iterator[tuple[ViewRenderer, WorkerPool, Progress]]:
    """Start worker processes and build the renderer, say what there is to say before; the processes end with it."""
    workers = min(means.workers or available_cores(), max(1, len(found.missing)))
    keep_freed_memory()
    done = len(found.views.finished)
    with means.progress(done + len(found.missing), "views", done) as progress:
        pool = WorkerPool(found.missing, lambda _index: progress.advance())
        try:
            pool.start(means.worker_command, workers - 1)
            with opened.renderer(threads=_threads(workers)) as renderer:
                doubt = renderer.sampling_doubt() if found.missing else ""
                for message in filter(None, (*opened.messages, *renderer.messages, doubt)):
                    progress.note(message)
                yield renderer, pool, progress
        finally:
            pool.stop()
    for message in pool.messages:
        sys.stderr.write(message + "\n")


def _write_model_files(job: OpenJob, renderer: ViewRenderer) -> None:
    """Write ``camera.json`` and ``models/``, which are known before the first view."""
    out, reference = job.job.out, renderer.reference
    write_camera(out, renderer.camera, renderer.depth_scale)
    colours = colour_vertices(reference.mesh, reference.views)
    write_models(out, reference.mesh, to_uint8(colours.rgb))


def _write_tables(job: OpenJob, renderer: ViewRenderer, report: Callable[[str], None]) -> Tally:
    """Write the tables of a complete dataset, its overlay and its contact sheet; gives sums over all views."""
    out, camera, mesh = job.job.out, renderer.camera, renderer.reference.mesh
    depth_scale = renderer.depth_scale
    description = read_description(out / RECORD)
    tally = write_view_tables(out, description, bounds=mesh.bounds, depth_scale=depth_scale)
    occluded = job.job.options.occluders > 0
    write_dataset_info(out, job.object_name, job.count, camera, mesh, depth_scale, occluded=occluded)
    write_bytes_atomically(out / "overlay.png", encode_png(renderer.frame_overlay()))
    images = [read_image(ViewPaths(out, index).file("rgb"))[0] for index in evenly_spaced(job.count, SHEET_VIEWS)]
    sheet = contact_sheet(images, columns=min(SHEET_COLUMNS, len(images)), tile_width=SHEET_TILE_PX)
    write_bytes_atomically(out / CONTACT_SHEET, encode_png(to_uint8(sheet)))
    report(f"contact sheet: {out / CONTACT_SHEET}")
    return tally


def _video_to_render(job: OpenJob, files: FileSurvey) -> int | None:
    """Number of frames of the video that is to be rendered; ``None`` if there is nothing to do.

    That is the video that the options ask for, or one that the dataset had and that is damaged now.
    """
    options, (video, poses), out = job.job.options, VIDEO_FILES, job.job.out
    damaged = not files.damaged.keys().isdisjoint(VIDEO_FILES)
    is_known = (out / poses).exists() and poses not in files.damaged
    frames = read_file(out / poses).count(b"\n") - 1 if is_known else None
    if not options.video:
        return (frames or options.video_frames) if damaged else None
    is_there = (out / video).exists() and frames == options.video_frames and not damaged
    return None if is_there else options.video_frames


def _write_video(job: OpenJob, renderer: ViewRenderer, frames: int, progress: Progress) -> None:
    """Write ``video/trajectory.mp4`` and ``video/poses.csv``, one pose per frame."""
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


def work(job: Job, *, workers: int, stream: TextIO) -> None:
    """Act as one of ``workers`` processes: render the views whose numbers arrive on standard input.

    Parameters
    ----------
    job, workers, stream
        As for :func:`run`.
    """
    # first, so that the input is watched while everything loads
    views = assigned_views()
    # Ctrl-C reaches all processes of a terminal: the parent handles it
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    keep_freed_memory()
    opened = open_job(job)
    # the files may have changed since the run began
    check_description(job.out, opened.description, opened.given_poses)
    with opened.renderer(threads=_threads(workers)) as renderer:
        finished, written = (partial(report, stream, answer) for answer in (FINISHED, WRITTEN))
        render_views(renderer, job.out, views, finished, written)


def _threads(workers: int) -> int:
    return max(1, available_cores() // (workers or available_cores()))
