"""The dataset job: from a case and options to a whole dataset on disk, in any number of processes, resumable."""

import errno
import hashlib
import os
from collections import deque
from collections.abc import Callable, Iterable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path

import bpy
import numpy as np

from ... import __version__
from ...case.case_file import Case
from ...case.loaded_case import LoadedCase
from ...dataset.folder import Shard
from ...dataset.layout import FORMAT, VIEWS_PER_SCENE, ViewPaths
from ...dataset.options import DatasetOptions
from ...dataset.view import RenderedSample, write_view
from ...errors import RunError
from ...files.content import read_content
from ...poses.pose_file import read_poses
from ..case.load_case import load_case
from ..colour.reference_view import reference_view_of
from .view_renderer import ViewRenderer, view_camera

NO_CONTENT = ("count", "poses", "video", "video_frames")
"""Options that no view depends on, or that the identity holds elsewhere; a video may be added later."""
IN_FLIGHT = 3
"""Rendered views that may wait for their encoding: enough to keep both sides busy, and memory flat."""


@dataclass(frozen=True)
class Job:
    """What to render and where to.

    Attributes
    ----------
    case
        The case file, read once.
    out
        The dataset's folder.
    options
        What determines the content.
    shard
        The part of the views to render.
    """

    case: Case
    out: Path
    options: DatasetOptions
    shard: Shard


@dataclass(frozen=True)
class OpenJob:
    """A job with its inputs in memory."""

    job: Job
    loaded: LoadedCase
    given_poses: np.ndarray | None
    messages: tuple[str, ...]

    @property
    def count(self) -> int:
        """Number of views of the whole dataset."""
        return self.job.options.count if self.given_poses is None else len(self.given_poses)

    @property
    def views(self) -> range:
        """The views of this job's shard."""
        return self.job.shard.views(self.count, VIEWS_PER_SCENE)

    def renderer(self, *, threads: int) -> ViewRenderer:
        """What makes this job's views."""
        source = reference_view_of(self.loaded)
        return ViewRenderer(self.loaded, source, self.job.options, self.given_poses, threads=threads)

    def identity(self) -> dict:
        """Everything that the dataset's content depends on, and what is needed to use it: ``dataset.json``."""
        case, options = self.loaded.case, self.job.options
        # what the case file says is below; its text may be saved anew, with landmarks, comments or a video to add
        files = {name: path for name, path in case.input_files().items() if name != "case"}
        if options.poses is not None:
            files["poses"] = Path(options.poses)
        camera = view_camera(self.loaded, options)
        return {
            "format": FORMAT,
            "versions": {"oneframe": __version__, "blender": bpy.app.version_string},
            "conventions": "mm; OpenCV camera axes; pixel (0, 0): centre of the top-left pixel; b_from_a matrices",
            "count": self.count,
            "options": {name: value for name, value in asdict(options).items() if name not in NO_CONTENT},
            "camera": {**asdict(camera), "K": camera.k.tolist()},
            "frame": {
                **asdict(case.camera),
                "distortion": None if case.distortion is None else asdict(case.distortion),
                "cam_from_model": self.loaded.cam_from_model.tolist(),
            },
            "given_from_model": self.loaded.mesh_from_model.tolist(),
            "mm_per_given_unit": case.mm_per_unit,
            "structures": {structure.name: list(structure.colour) for structure in case.structures},
            "inputs_sha256": {name: _file_hash(path) for name, path in files.items()},
        }


def open_job(job: Job) -> OpenJob:
    """Read and check all inputs of a job beside its case file.

    Raises
    ------
    InputError
        Anything that the user gave and that cannot be used.
    """
    loaded = load_case(job.case)
    given_poses: np.ndarray | None = None
    messages: list[str] = []
    if job.options.poses is not None:
        given_poses, messages = read_poses(
            job.options.poses, mesh_from_model=loaded.mesh_from_model, mm_per_unit=job.case.mm_per_unit
        )
    return OpenJob(job, loaded, given_poses, tuple(messages))


def render_views(
    renderer: ViewRenderer, out: Path, views: Iterable[int | None], finished: Callable[[int], None]
) -> None:
    """Make views and write them; encoding and writing run beside the next render.

    Parameters
    ----------
    renderer
        Makes the views.
    out
        The dataset's folder.
    views
        Numbers of the views; ``None`` for "nothing to do just now".
    finished
        Called with a view's number when it is on disk, from another thread.

    Raises
    ------
    RunError
        A file cannot be written; all views reported as finished are safe.
    """

    def write(index: int, made: RenderedSample) -> None:
        paths = ViewPaths(out, index)
        write_view(paths, *renderer.encode(paths, made))
        finished(index)

    waiting: deque[Future[None]] = deque()
    try:
        with ThreadPoolExecutor(1, "encode") as encoder:
            for index in views:
                if index is not None:
                    waiting.append(encoder.submit(write, index, renderer.make(index)))
                while waiting and (len(waiting) > IN_FLIGHT or waiting[0].done()):
                    waiting.popleft().result()
            while waiting:
                waiting.popleft().result()
    except OSError as error:
        raise write_error(error, out) from error


def write_error(error: OSError, out: Path) -> RunError:
    """The error to report when a file of the dataset cannot be written."""
    if error.errno in (errno.ENOSPC, errno.EDQUOT):
        return RunError(
            f"{out}: the disk is full; the views finished so far are safe: free space and run the same command again"
        )
    if isinstance(error, BrokenPipeError):
        return RunError(
            "the standard output was closed; the views finished so far are safe: run the same command again"
        )
    return RunError(
        f"{out}: cannot write {error.filename or 'a file'} ({error.strerror}); "
        "the views finished so far are safe: correct that and run the same command again"
    )


def available_cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _file_hash(path: Path) -> str:
    return hashlib.sha256(read_content(path, "an input of the dataset")).hexdigest()
