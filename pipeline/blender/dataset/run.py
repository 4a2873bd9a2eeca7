"""A whole dataset run from start to end, for ``render_dataset.py`` and the add-on's background job."""

import signal
import sys
import threading
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TextIO

from ...dataset.folder import RECORD, RunFolder, check_identity
from ...dataset.layout import finished_views
from ...errors import RunError
from ...progress import LINE_SECONDS, Progress
from ..render.engines import check_engine, keep_freed_memory
from . import finish
from .job import Job, OpenJob, available_cores, open_job, render_views, write_error
from .view_renderer import ViewRenderer
from .workers import WorkerPool, assigned_views, report_finished

Report = Callable[[str], None]


def run(
    job: Job,
    *,
    workers: int,
    worker_command: Sequence[str],
    stream: TextIO,
    progress_seconds: float = LINE_SECONDS,
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
    progress_seconds
        Time between lines of progress where there is no terminal.

    Raises
    ------
    InputError
        An input cannot be used.
    RunError
        The folder is in use or holds another dataset, or a file cannot be written. Finished views are kept.
    """

    def report(message: str) -> None:
        stream.write(message + "\n")
        stream.flush()

    check_engine(job.options.engine)
    opened = open_job(job)
    with RunFolder(job.out, opened.description, job.shard) as folder:
        try:
            complete = finish.is_complete(opened)
            if not complete or finish.lacks_video(opened):
                complete = _render_missing(opened, workers, worker_command, report, stream, progress_seconds)
        except OSError as error:
            raise write_error(error, job.out) from error
        if complete:
            folder.finish()
    if complete:
        for message in (*finish.summary(opened), f"dataset of {opened.count} views: {job.out}"):
            report(message)
    elif job.shard.count == 1:
        raise RunError(
            f"{job.out}: finished views have disappeared; do not change the folder, and run the same command again"
        )
    else:
        report(
            f"shard {job.shard.index}/{job.shard.count}: {len(opened.views)} views are finished; when all shards are "
            "in one folder, run the same command without --shard to write the tables"
        )


def _render_missing(
    opened: OpenJob,
    workers: int,
    worker_command: Sequence[str],
    report: Report,
    stream: TextIO,
    progress_seconds: float,
) -> bool:
    """Render the missing views, then write the tables and the video; whether the whole dataset is complete."""
    out = opened.job.out
    done = finished_views(out, opened.views)
    missing = [index for index in opened.views if index not in done]
    workers = min(workers or available_cores(), max(1, len(missing)))
    lock = threading.Lock()
    progress = Progress(len(opened.views), "views", finished=len(done), stream=stream, line_seconds=progress_seconds)

    def finished(_index: int) -> None:
        with lock:
            progress.advance()

    keep_freed_memory()
    pool = WorkerPool(missing, finished)
    try:
        pool.start(worker_command, workers - 1)
        with opened.renderer(threads=_threads(workers)) as renderer:
            for message in (*opened.messages, *renderer.messages):
                report(message)
            complete = finish.is_complete(opened)
            if not complete:
                finish.write_model_files(opened, renderer)
                render_views(renderer, out, pool.views(), finished)
                progress.close()
                complete = finish.write_finished_scenes(opened, renderer)
                if complete:
                    finish.write_dataset_tables(opened, renderer)
                    report(f"contact sheet: {out / 'contact_sheet.png'}")
            if complete and finish.lacks_video(opened):
                shown = Progress(
                    opened.job.options.video_frames, "video frames", stream=stream, line_seconds=progress_seconds
                )
                report(f"video: {_video(opened, renderer, shown)}")
            if complete:
                finish.write_sums(opened)
    finally:
        pool.stop()
    for message in pool.messages:
        sys.stderr.write(message + "\n")
    return complete


def _video(opened: OpenJob, renderer: ViewRenderer, progress: Progress) -> Path:
    path = finish.write_trajectory_video(opened, renderer, progress)
    progress.close()
    return path


def work(job: Job, *, workers: int, stream: TextIO) -> None:
    """Act as one of ``workers`` processes: render the views whose numbers arrive on standard input."""
    # first, so that the input is watched while everything loads
    views = assigned_views()
    # Ctrl-C reaches all processes of a terminal: the parent handles it
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    keep_freed_memory()
    opened = open_job(job)
    # the files may have changed since the run began
    check_identity(job.out / RECORD, opened.description)
    with opened.renderer(threads=_threads(workers)) as renderer:
        render_views(renderer, job.out, views, lambda index: report_finished(index, stream))


def _threads(workers: int) -> int:
    return max(1, available_cores() // (workers or available_cores()))
