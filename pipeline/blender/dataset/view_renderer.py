"""One view of a dataset from its number: pose, render, ground truth."""

from collections.abc import Sequence
from contextlib import ExitStack

import numpy as np

from ...case.loaded_case import LoadedCase
from ...colour.reference_view import ReferenceView, colours_of, unseen_colours_of
from ...colour.shading import ColouredSurface
from ...dataset.layout import ViewPaths
from ...dataset.options import DatasetOptions
from ...dataset.run.resume_record import ViewRecord
from ...dataset.truths import written_truths
from ...dataset.view import RenderedSample, encode_view
from ...occlusion.compositing import front_filter, shadow_filter
from ...occlusion.instruments import Instrument
from ...occlusion.occluders import places_doubt
from ...occlusion.staging import StagedView, Staging
from ...occlusion.surroundings import surroundings_filter
from ...projection.silhouette import SilhouetteEdges
from ...transforms import inverse_rigid
from ..render.engines import opened_engine
from .view_planner import SAMPLED_VIEWS, ViewPlanner

FILTERS = (shadow_filter, surroundings_filter, front_filter)
"""What changes a view after its engine, in this order; each is made from a :class:`.Staging`, if that asks for it."""


class ViewRenderer(ViewPlanner):
    """Plans and renders views of one dataset; creating it prepares all that they share. Use as a context manager.

    ``render`` renders any pose (4x4, mm).
    """

    def __init__(
        self,
        loaded: LoadedCase,
        reference: ReferenceView,
        options: DatasetOptions,
        given_poses: np.ndarray | None,
        instruments: Sequence[Instrument] = (),
        *,
        identity: str = "",
        threads: int = 0,
    ) -> None:
        """Prepare colours and engine.

        Parameters
        ----------
        loaded, reference, options, given_poses
            As of :class:`ViewPlanner`.
        instruments
            The user's own, in place of the built-in ones.
        identity
            Identity of the dataset, for the records of the views.
        threads
            Number of render threads, 0 for one per core.
        """
        super().__init__(loaded, reference, options, given_poses)
        self._identity = identity
        self._kinds = written_truths(options.content(), len(loaded.frames))
        self._edges = SilhouetteEdges.of(reference.mesh)
        colours, messages = colours_of(self.reference, options.colour)
        self.messages = (*self.messages, *messages)
        unseen = unseen_colours_of(self.reference, options.unseen)
        # both eyes see everything by the left one's lamp
        light = None if reference.light is None else reference.light.moved(self._camera_from_planned)
        surface = ColouredSurface(reference.mesh, tuple(colours), unseen, reference.pivot_model, light)
        self._staging = Staging(
            options.content(),
            self.reference,
            self.camera,
            self._camera_from_planned,
            light,
            self.probe,
            tuple(instruments),
        )
        self._filters = [*filter(None, (made(self._staging) for made in FILTERS))]
        self._resources = ExitStack()
        self.render = self._resources.enter_context(
            opened_engine(options.engine, surface, self.camera, samples=options.samples, threads=threads)
        )

    def __enter__(self) -> "ViewRenderer":
        return self

    def __exit__(self, *_: object) -> None:
        self._resources.close()

    def sampling_doubt(self) -> str:
        """As of :class:`ViewPlanner`, and of the user's own instruments."""
        own, views, back = self._staging.own_instruments, range(SAMPLED_VIEWS), inverse_rigid(self._camera_from_planned)
        poses = [back @ self.plan(index).cam_from_model for index in views if own and index < self._count]
        said = [super().sampling_doubt(), *places_doubt(own, self._options.seed, self.probe, self.camera, poses)]
        return "; ".join(filter(None, said))

    def make(self, index: int) -> RenderedSample:
        """Plan, render and compose view ``index``."""
        planned = self.plan(index)
        view, staged = self.render(planned.cam_from_model), StagedView(self._staging, index, planned.cam_from_model)
        for change in self._filters:
            view = change(view, staged)
        return RenderedSample(planned, view)

    def encode(self, paths: ViewPaths, sample: RenderedSample) -> tuple[dict[str, bytes], ViewRecord]:
        """Encode a view's files, by kind, and its record; uses no Blender data, so any thread may call it."""
        return encode_view(
            paths,
            sample,
            self._edges,
            self.camera,
            identity=self._identity,
            depth_scale=self.depth_scale,
            kinds=self._kinds,
        )
