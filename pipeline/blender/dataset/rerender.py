"""A dataset's views, video frames and other files rendered again from its case, to be compared with those on disk.

Views are proven by the :attr:`.Engine.proof` of their engine.
"""

import json
import tempfile
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ...case.case_file import Case
from ...dataset.identity import POSES_HASH
from ...dataset.layout import ViewPaths
from ...dataset.options import DatasetOptions, checked_options
from ...dataset.run.run_folder import Shard
from ...dataset.tables.dataset_info import write_dataset_info
from ...files.machine import available_cores
from ..render.engines import engine_named
from ..render.video import write_video
from . import finish
from .job import Job, OpenJob, open_job


class CaseRenderer:
    """Renders a dataset again: a :class:`oneframe.dataset.check.rerendered.Renderer`. Use as a context manager."""

    def __init__(self, case: Case, content: Mapping[str, Any], poses: Path | None) -> None:
        """Load the case.

        Parameters
        ----------
        case
            The case that the dataset was rendered from.
        content
            The object in its ``dataset.json``.
        poses
            The file of its poses, if they were listed; that of the case if left out.

        Raises
        ------
        InputError
            An input cannot be used.
        RunError
            The engine does not work here.
        """
        options = _options(case, content, poses)
        engine = engine_named(options.engine)
        engine.check()
        # the dataset itself is never written to
        self._folder = tempfile.TemporaryDirectory(prefix="oneframe-check-")
        self._opened: OpenJob = open_job(Job(case, Path(self._folder.name), options, Shard()))
        self.description: dict[str, Any] = json.loads(json.dumps(self._opened.description))
        self.same_renderer = engine.proof is None
        self._renderer = self._prover = self._opened.renderer(threads=available_cores())
        if engine.proof is not None:
            proving = replace(self._opened.job, options=replace(options, engine=engine.proof))
            self._prover = replace(self._opened, job=proving).renderer(threads=available_cores())

    def __enter__(self) -> "CaseRenderer":
        return self

    def __exit__(self, *_: object) -> None:
        self._renderer.__exit__()
        self._prover.__exit__()
        self._folder.cleanup()

    def view(self, index: int) -> tuple[dict[str, bytes], dict[str, Any]]:
        """The files of a view, by kind, and the object of its record."""
        paths, planned = ViewPaths(Path(self._folder.name), index), self._renderer.plan(index)
        sample = self._renderer.sample(index, planned, self._prover.render(planned.cam_from_model))
        files, record = self._renderer.encode(paths, sample)
        return files, json.loads(json.dumps(record.to_json()))

    def files(self) -> dict[str, bytes]:
        """The files that are made from the case alone, by path relative to the dataset."""
        root, renderer = Path(self._folder.name), self._renderer
        finish.write_model_files(self._opened, renderer)
        finish.write_overlay(self._opened, renderer)
        write_dataset_info(
            root,
            self._opened.object_name,
            self._opened.count,
            renderer.camera,
            renderer.reference.mesh,
            renderer.depth_scale,
            occluded=self._opened.job.options.occluders > 0,
        )
        return {path.relative_to(root).as_posix(): path.read_bytes() for path in root.rglob("*") if path.is_file()}

    def video_poses(self, frames: int) -> np.ndarray:
        """``(frames, 4, 4)`` poses of a video of so many frames, mm."""
        return self._renderer.video_poses(frames)

    def write_video(self, path: Path, poses: np.ndarray) -> None:
        """Write the views from ``(N, 4, 4)`` poses, mm, as a video, encoded as the dataset's."""
        write_video(path, (self._prover.render(pose).rgb for pose in poses))


def _options(case: Case, content: Mapping[str, Any], poses: Path | None) -> DatasetOptions:
    values = {name: value for name, value in content["options"].items() if name != "views"}
    options = checked_options({**values, "count": content["count"]}, "dataset.json: options")
    if options.occluders and "occluder_meshes" in case.dataset:
        options = replace(options, occluder_meshes=str(case.path.parent / str(case.dataset["occluder_meshes"])))
    if POSES_HASH not in content:
        return options
    if poses is None and "poses" in case.dataset:
        poses = case.path.parent / str(case.dataset["poses"])
    return replace(options, poses=None if poses is None else str(poses))
