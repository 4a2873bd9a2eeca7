"""The dataset job: from a case and options to a complete dataset on disk, in any number of processes, resumable."""

from collections import deque
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import bpy
import numpy as np

from ...case.case_file import Case
from ...case.loaded_case import LoadedCase, check_listed, load_case
from ...colour.lens_shading import LensShading, lens_shading_of
from ...dataset import layout
from ...dataset.description import POSES, describe, input_files, object_name
from ...dataset.identity import identity_of
from ...dataset.layout import ViewPaths
from ...dataset.options import NONE, SHADOWS, DatasetOptions
from ...dataset.run.run_folder import Shard
from ...dataset.view import RenderedSample, ViewWriter
from ...errors import RunError
from ...files.content import hashed_reading
from ...poses.pose_file import read_poses
from ...process.own_process import STDOUT
from ..render.engines import reference_view_of
from .view_renderer import ViewRenderer

IN_FLIGHT = 3
"""Number of rendered views that may wait for encoding: enough to keep both sides busy with constant memory."""


@dataclass(frozen=True)
class Job:
    """What to render, and where to write it."""

    case: Case
    out: Path
    options: DatasetOptions
    shard: Shard


@dataclass(frozen=True)
class OpenJob:
    """A job with its inputs in memory.

    Attributes
    ----------
    job
        The job.
    loaded
        The case with its files.
    given_poses
        ``(N, 4, 4)`` explicit ``cam_from_model``, mm, or ``None`` to draw poses.
    messages
        Messages about what was corrected.
    inputs_sha256
        SHA-256 of the bytes that were read of each input, by its name.
    """

    job: Job
    loaded: LoadedCase
    given_poses: np.ndarray | None
    messages: tuple[str, ...]
    inputs_sha256: Mapping[str, str]

    @property
    def count(self) -> int:
        """Number of views of the whole dataset."""
        return self.job.options.count if self.given_poses is None else len(self.given_poses)

    @property
    def object_name(self) -> str:
        """Name of the surface in the dataset's tables."""
        return object_name(self.loaded.case)

    @property
    def views(self) -> range:
        """The views of this job's shard."""
        return self.job.shard.views(self.count, layout.VIEWS_PER_SCENE)

    def renderer(self, *, threads: int) -> ViewRenderer:
        """Create the renderer of this job's views, with this number of render threads."""
        options = self.job.options
        reference = reference_view_of(self.loaded, options.engine, light_of(self.loaded, options))
        return ViewRenderer(
            self.loaded,
            reference,
            options,
            self.given_poses,
            identity=self.identity,
            threads=threads,
        )

    @cached_property
    def identity(self) -> str:
        """The dataset's identity: see :func:`oneframe.dataset.identity.identity_of`."""
        return identity_of(self.description)

    @cached_property
    def description(self) -> dict[str, object]:
        """The content of ``dataset.json``: see :func:`oneframe.dataset.description.describe`."""
        return describe(
            self.loaded,
            self.job.options,
            self.given_poses,
            hashes=self.inputs_sha256,
            blender=bpy.app.version_string,
        )


def light_of(loaded: LoadedCase, options: DatasetOptions) -> LensShading | None:
    """The light at the lens, if options ask for it."""
    return None if options.light == NONE else lens_shading_of(loaded, shadows=options.light == SHADOWS)


def open_job(job: Job) -> OpenJob:
    """Read and check all inputs of a job; its case file has been read before."""
    case, files = job.case, input_files(job.case, job.options)
    given_poses: np.ndarray | None = None
    messages: list[str] = []
    with hashed_reading() as hashes:
        loaded = load_case(case)
        if job.options.poses is not None:
            given_poses, messages = read_poses(
                job.options.poses, mesh_from_model=loaded.surface.mesh_from_model, mm_per_unit=case.mm_per_unit
            )
            check_listed(loaded, given_poses, files[POSES].name)
            beside = job.options.camera_from_planned
            given_poses = given_poses if beside is None else beside @ given_poses
    read = {name: hashes[path] for name, path in files.items()}
    return OpenJob(job, loaded, given_poses, tuple(messages), read)


def render_views(
    renderer: ViewRenderer,
    out: Path,
    views: Iterable[int | None],
    finished: Callable[[int], None],
    written: Callable[[int], None] = lambda _: None,
) -> None:
    """Render views and write them; encoding and writing run in parallel with the next render.

    Parameters
    ----------
    renderer
        Renders the views.
    out
        The dataset's folder.
    views
        Numbers of the views; ``None`` means "nothing to do now".
    finished
        Called from any thread with the number of a view that is on disk, to stay.
    written
        Called from another thread with that of a view whose files are written.
    """

    def write(writer: ViewWriter, index: int, sample: RenderedSample) -> None:
        paths = ViewPaths(out, index)
        writer.write(paths, *renderer.encode(paths, sample))
        written(index)

    waiting: deque[Future[None]] = deque()
    try:
        with ViewWriter(finished) as writer, ThreadPoolExecutor(1, "encode") as encoder:
            for index in views:
                if index is not None:
                    waiting.append(encoder.submit(write, writer, index, renderer.make(index)))
                elif not waiting:
                    writer.settle()
                while waiting and (len(waiting) > IN_FLIGHT or waiting[0].done()):
                    waiting.popleft().result()
            while waiting:
                waiting.popleft().result()
    except OSError as error:
        raise write_error(error, out) from error


def write_error(error: OSError, out: Path) -> RunError:
    """The error to report if a file of the dataset, or standard output, cannot be written."""
    is_output = error.filename == STDOUT or isinstance(error, BrokenPipeError)
    place, what = (STDOUT, "to it") if is_output else (out, error.filename or "a file")
    return RunError(
        f"{place}: cannot write {what} ({error.strerror}); "
        "the views finished so far are safe: correct this and run the same command again"
    )
