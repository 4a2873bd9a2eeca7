"""The dataset job: from a case and options to a complete dataset on disk, in any number of processes, resumable."""

import errno
import os
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import bpy
import numpy as np

from ...case.case_file import Case
from ...case.loaded_case import LoadedCase
from ...dataset import layout
from ...dataset.description import POSES, describe, input_files, object_name
from ...dataset.folder import Shard
from ...dataset.identity import geometry_hash, identity_of
from ...dataset.layout import ViewPaths
from ...dataset.options import DatasetOptions
from ...dataset.quality import Setting
from ...dataset.view import RenderedSample, write_view
from ...errors import RunError
from ...files.content import hashed_reading
from ...poses.pose_file import read_poses
from ..case.load_case import load_case
from ..colour.reference_view import ReferenceView, colouring_view_of, reference_view_of
from ..process import STDOUT
from .reduced_surface import KeptSurface, rendered_mesh, rendered_view_of
from .view_renderer import ViewRenderer

IN_FLIGHT = 3
"""Number of rendered views that may wait for encoding: enough to keep both sides busy with constant memory."""


@dataclass(frozen=True)
class Job:
    """What to render, and where to write it.

    Attributes
    ----------
    case
        The case file, read once.
    out
        The dataset's folder.
    options
        What determines the content.
    shard
        The views to render.
    """

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
    setting
        How views are rendered, if the quality is not ``exact``.
    kept
        The reduced surface of the setting, if it takes the place of the one given in ``loaded``.
    """

    job: Job
    loaded: LoadedCase
    given_poses: np.ndarray | None
    messages: tuple[str, ...]
    inputs_sha256: Mapping[str, str]
    setting: Setting | None = None
    kept: KeptSurface | None = None

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
        setting = self.setting
        if setting is None:
            source = reference_view_of(self.loaded)
        else:
            mesh = self.loaded.mesh if self.kept else rendered_mesh(self.loaded.mesh, setting, self.job.out)
            source = rendered_view_of(self.loaded, setting.pivot_model, mesh)
        return ViewRenderer(
            self.loaded,
            source,
            self.job.options,
            self.given_poses,
            setting=setting,
            radius_mm=self.radius_mm,
            identity=self.identity,
            threads=threads,
        )

    def model_of(self, renderer: ViewRenderer) -> ReferenceView:
        """The view of the surface as given, which is the dataset's model, whatever surface the views are of."""
        return renderer.source if self.setting is None else self._given_view

    @cached_property
    def _given_view(self) -> ReferenceView:
        return colouring_view_of(self.loaded)

    @property
    def radius_mm(self) -> float:
        """The radius of the surface as given, about the origin of the model frame."""
        return self.kept.radius_mm if self.kept else self.loaded.mesh.radius

    @cached_property
    def identity(self) -> str:
        """The dataset's identity: see :func:`pipeline.dataset.identity.identity_of`."""
        return identity_of(self.description)

    @cached_property
    def description(self) -> dict[str, object]:
        """The content of ``dataset.json``: see :func:`pipeline.dataset.description.describe`."""
        return describe(
            self.loaded,
            self.job.options,
            self.given_poses,
            hashes=self.inputs_sha256,
            blender=bpy.app.version_string,
            radius_mm=self.radius_mm,
            geometry_sha256=self.kept.geometry_sha256 if self.kept else geometry_hash(self.loaded.mesh),
            setting=self.setting,
        )


def open_job(job: Job, kept: KeptSurface | None = None) -> OpenJob:
    """Read and check all inputs of a job; its case file has been read before.

    Parameters
    ----------
    job
        The job.
    kept
        A reduced surface that makes it needless to read the one given.

    Raises
    ------
    InputError
        An input cannot be used.
    """
    case, files = job.case, input_files(job.case, job.options)
    given_poses: np.ndarray | None = None
    messages: list[str] = []
    with hashed_reading() as hashes:
        loaded = load_case(case, surface=(kept.mesh, kept.mesh_from_model) if kept else None)
        if POSES in files:
            given_poses, messages = read_poses(
                files[POSES], mesh_from_model=loaded.mesh_from_model, mm_per_unit=case.mm_per_unit
            )
    known = {case.mesh: kept.file_sha256} if kept else {}
    sums = {name: known.get(path) or hashes[path] for name, path in files.items()}
    return OpenJob(job, loaded, given_poses, tuple(messages), sums, kept=kept)


def render_views(
    renderer: ViewRenderer, out: Path, views: Iterable[int | None], finished: Callable[[int], None]
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
        Called from another thread with the number of a view that is on disk.

    Raises
    ------
    RunError
        A file cannot be written; all views reported as finished are on disk.
    """

    def write(index: int, sample: RenderedSample) -> None:
        paths = ViewPaths(out, index)
        write_view(paths, *renderer.encode(paths, sample))
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
    """The error to report if a file of the dataset cannot be written."""
    if error.filename == STDOUT or isinstance(error, BrokenPipeError):
        return RunError(
            f"{STDOUT}: cannot write to it ({error.strerror}); "
            "the views finished so far are safe: run the same command again"
        )
    if error.errno in (errno.ENOSPC, errno.EDQUOT):
        return RunError(
            f"{out}: the disk is full; the views finished so far are safe: free space and run the same command again"
        )
    return RunError(
        f"{out}: cannot write {error.filename or 'a file'} ({error.strerror}); "
        "the views finished so far are safe: fix the cause and run the same command again"
    )


def available_cores() -> int:
    """Number of processor cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
