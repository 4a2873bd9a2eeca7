"""A whole dataset run from start to end, for ``render_dataset.py`` and the add-on's background job."""

import signal
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import TextIO

from ...dataset.checksums import FileSurvey, survey_files
from ...dataset.layout import RECORD, VIDEO_FILES, other_files, view_kinds
from ...dataset.run.elsewhere import Elsewhere, MissingViews
from ...dataset.run.run_folder import RunFolder
from ...dataset.run.same_run import check_description
from ...dataset.run.survey import Survey, Tally, survey_views, unrecorded_views, view_ranges
from ...files.machine import available_cores
from ...progress import LINE_SECONDS, Progress
from ..render.engines import engine_named, keep_freed_memory
from . import finish
from .job import Job, OpenJob, open_job, render_views, write_error
from .render_process import assigned_views, report_finished, report_ready
from .view_renderer import ViewRenderer
from .workers import WorkerPool

Report = Callable[[str], None]


def run(
    job: Job,
    *,
    workers: int,
    worker_command: Sequence[str],
    stream: TextIO,
    verify: bool = False,
    progress_seconds: float = LINE_SECONDS,
    elsewhere: Elsewhere | None = None,
) -> None:
    """Render the missing views of a job and, when the dataset is complete, write its tables.

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
    elsewhere
        Renders the views in place of this process and ``workers`` others.

    Raises
    ------
    InputError
        An input cannot be used.
    RunError
        The folder is in use or holds another dataset, or a file cannot be written. Finished views are kept.
    """
    report = _reporter(stream)
    engine_named(job.options.engine).check()
    opened = open_job(job)
    with RunFolder(job.out, opened.description, job.shard, poses=opened.given_poses) as folder:
        try:
            found = _survey(opened, verify=verify)
            for message in found.messages():
                report(message)
            tally: Tally | None = found.views.tally
            if found.missing or not found.has_tables or found.video_frames is not None:
                tally = _render_missing(opened, found, workers, worker_command, stream, progress_seconds, elsewhere)
        except OSError as error:
            raise write_error(error, job.out) from error
        if tally is not None:
            folder.finish()
    if tally is not None:
        for message in (*tally.messages(opened.count), f"dataset of {opened.count} views: {job.out}"):
            report(message)
    elif job.shard.count > 1:
        report(
            f"shard {job.shard.index}/{job.shard.count}: {len(opened.views)} views are finished; when all shards are "
            "in one folder, run the same command without --shard to write the tables"
        )


def _reporter(stream: TextIO) -> Report:
    def report(message: str) -> None:
        stream.write(message + "\n")
        stream.flush()

    return report


@dataclass(frozen=True)
class _Found:
    """What is on disk of a dataset: files that are no view's, and views; what is missing of these and of the video."""

    files: FileSurvey
    views: Survey
    has_tables: bool
    missing: tuple[int, ...]
    video_frames: int | None

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


def _missing_views(opened: OpenJob, found: _Found) -> MissingViews:
    job = opened.job
    return MissingViews(
        job.case.path,
        job.out,
        job.options,
        opened.description,
        opened.identity,
        _kinds(job),
        len(found.views.finished),
        found.missing,
        frozenset(found.views.damaged).intersection(found.missing),
    )


def _kinds(job: Job) -> tuple[str, ...]:
    return view_kinds(float_depth=job.options.float_depth, several_frames=bool(job.case.frames))


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


def _render_missing(
    opened: OpenJob,
    found: _Found,
    workers: int,
    worker_command: Sequence[str],
    stream: TextIO,
    progress_seconds: float,
    elsewhere: Elsewhere | None,
) -> Tally | None:
    """Render what is missing, and write the tables and the video; sums over all views if the dataset is complete."""
    total, report = len(found.views.finished) + len(found.missing), _reporter(stream)
    workers = 1 if elsewhere else min(workers or available_cores(), max(1, len(found.missing)))
    keep_freed_memory()
    shown = Progress(total, "views", finished=len(found.views.finished), stream=stream, line_seconds=progress_seconds)
    with shown as progress:
        pool = WorkerPool(() if elsewhere else found.missing, lambda _index: progress.advance())
        try:
            pool.start(worker_command, workers - 1)
            with opened.renderer(threads=_threads(workers)) as renderer:
                for message in (*opened.messages, *renderer.messages):
                    progress.note(message)
                tally: Tally | None = found.views.tally
                written: list[str] = []
                if found.missing and (doubt := renderer.sampling_doubt()):
                    progress.note(doubt)
                if found.missing or not found.has_tables:
                    finish.write_model_files(opened, renderer)
                    if elsewhere and found.missing:
                        elsewhere(_missing_views(opened, found), progress)
                    render_views(renderer, opened.job.out, pool.views(), lambda _index: progress.advance())
                    progress.close()
                    tally = _write_tables(opened, renderer, report)
                    # the description is written by the folder, which forgets its sum
                    written += set(other_files(opened.count)) - {RECORD}
                if tally is not None:
                    frames = found.video_frames
                    if frames is not None:
                        progress.close()
                        with Progress(
                            frames, "video frames", stream=stream, line_seconds=progress_seconds
                        ) as video_bar:
                            path = finish.write_trajectory_video(opened, renderer, frames, video_bar)
                        report(f"video: {path}")
                        written += VIDEO_FILES
                    video = frames is not None or found.files.intact.issuperset(VIDEO_FILES)
                    finish.write_sums(opened, written=written, rendered=found.missing, video=video)
        finally:
            pool.stop()
    for message in pool.messages:
        sys.stderr.write(message + "\n")
    return tally


def _write_tables(opened: OpenJob, renderer: ViewRenderer, report: Report) -> Tally | None:
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


def work(job: Job, *, workers: int, stream: TextIO, threads: int = 0) -> None:
    """Act as one of ``workers`` processes: render the views whose numbers arrive on standard input.

    Parameters
    ----------
    job, workers, stream
        As for :func:`run`.
    threads
        Number of render threads, for a process of another machine than the run's; 0 for an even share of the cores.
    """
    # first, so that the input is watched while everything loads
    views = assigned_views()
    # Ctrl-C reaches all processes of a terminal: the parent handles it
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    keep_freed_memory()
    opened = open_job(job)
    # the files may have changed since the run began
    advice = {"advice": _ADVICE_ELSEWHERE} if threads else {}
    check_description(job.out, opened.description, opened.given_poses, may_shrink=False, **advice)
    with opened.renderer(threads=threads or _threads(workers)) as renderer:
        report_ready(stream)
        render_views(renderer, job.out, views, lambda index: report_finished(index, stream))


_ADVICE_ELSEWHERE = "give this machine the same versions of OneFrame and Blender and the same input as the run has"


def _threads(workers: int) -> int:
    return max(1, available_cores() // (workers or available_cores()))
