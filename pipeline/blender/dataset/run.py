"""A whole dataset run from start to end, for ``render_dataset.py`` and the add-on's background job."""

import signal
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import TextIO

from ...dataset.checksums import FileSurvey, survey_files
from ...dataset.layout import RECORD, VIDEO_FILES, other_files
from ...dataset.option_arguments import option_arguments
from ...dataset.run.render_processes import WorkerPool, assigned_views, report_finished, report_ready
from ...dataset.run.run_folder import RunFolder
from ...dataset.run.same_run import check_description
from ...dataset.run.survey import Survey, Tally, survey_views, unrecorded_views, view_ranges
from ...dataset.stereo import further_datasets
from ...dataset.truths import written_truths
from ...files.machine import available_cores
from ...progress import LINE_SECONDS, Progress
from ..render.engines import engine_named, keep_freed_memory
from . import finish
from .job import Job, OpenJob, open_job, render_views, write_error
from .view_renderer import ViewRenderer


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
    for folder, options in further_datasets(job.options).items():
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
    views = _survey_views(opened, wanted, verify=verify)
    missing = tuple(index for index in wanted if index not in views.finished)
    return _Found(files, views, has_tables, missing, finish.video_to_render(opened, files))


def _kinds(job: Job) -> tuple[str, ...]:
    return written_truths(job.options.content(), len(job.case.every_frame))


def _survey_views(opened: OpenJob, views: range, *, verify: bool = False) -> Survey:
    return survey_views(
        opened.job.out,
        views,
        opened.description,
        _kinds(opened.job),
        poses=opened.given_poses,
        hashes=verify,
        threads=available_cores(),
    )


def _complete(opened: OpenJob, found: _Found, means: _Means) -> Tally | None:
    """Render what is missing, then write what all views give; sums over them, ``None`` while other shards lack some."""
    with _at_work(opened, found, means) as (renderer, pool, progress):
        if found.lacks_tables:
            finish.write_model_files(opened, renderer)
            render_views(renderer, opened.job.out, pool.views(), lambda _index: progress.advance())
        progress.close()
        tally = _write_tables(opened, renderer, means.report) if found.lacks_tables else found.views.tally
        if tally is not None:
            _write_video(opened, renderer, found, means)
            # the description is written by the folder, which forgets its sum
            tables = set(other_files(opened.count)) - {RECORD} if found.lacks_tables else set()
            video = VIDEO_FILES if found.video_frames is not None else ()
            has_video = bool(video) or found.files.intact.issuperset(VIDEO_FILES)
            finish.write_sums(opened, written={*tables, *video}, rendered=found.missing, video=has_video)
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


def _write_video(opened: OpenJob, renderer: ViewRenderer, found: _Found, means: _Means) -> None:
    """Write the video, if it is missing."""
    if found.video_frames is None:
        return
    with means.progress(found.video_frames, "video frames") as progress:
        path = finish.write_trajectory_video(opened, renderer, found.video_frames, progress)
    means.report(f"video: {path}")


def _write_tables(opened: OpenJob, renderer: ViewRenderer, report: Callable[[str], None]) -> Tally | None:
    """Write the tables if all views of the dataset exist; sums over the views, or ``None`` if some are missing."""
    out, count = opened.job.out, opened.count
    complete = len(opened.views) == count
    if not complete and not unrecorded_views(out, count):
        others = _survey_views(opened, range(count))
        complete = len(others.finished) == count
        if not complete:
            report(
                f"{len(others.damaged)} views of other shards are not whole: {view_ranges(others.damaged)}; run the "
                "same command without --shard to render them again"
            )
    if not complete:
        finish.write_finished_scenes(opened, renderer)
        return None
    tally = finish.write_dataset_tables(opened, renderer)
    report(f"contact sheet: {out / 'contact_sheet.png'}")
    return tally


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
    check_description(job.out, opened.description, opened.given_poses, may_shrink=False)
    with opened.renderer(threads=_threads(workers)) as renderer:
        report_ready(stream)
        render_views(renderer, job.out, views, lambda index: report_finished(index, stream))


def _threads(workers: int) -> int:
    return max(1, available_cores() // (workers or available_cores()))
