"""One view of a dataset from its number: pose, render, ground truth."""

from collections.abc import Sequence
from contextlib import ExitStack

import numpy as np

from ...case.loaded_case import LoadedCase
from ...colour.lens_shading import CornerNormals
from ...colour.reference_view import ReferenceView, colours_of, unseen_colours_of
from ...colour.shading import ColouredSurface
from ...dataset.layout import ViewPaths
from ...dataset.options import FRAME, DatasetOptions
from ...dataset.run.resume_record import ViewRecord
from ...dataset.truths import written_truths
from ...dataset.view import RenderedSample, encode_view
from ...occlusion.compositing import Front, head_light
from ...occlusion.instruments import KINDS, Instrument
from ...occlusion.occluders import STREAM, draw_occluders, held_instrument
from ...occlusion.shadow import LitSurface, Shadow
from ...occlusion.surroundings import Surroundings
from ...poses.constraints import PlannedPose
from ...projection.rendered_view import RenderedView
from ...projection.silhouette import SilhouetteEdges
from ...transforms import inverse_rigid
from ..render.engines import opened_engine
from ..render.surface_tree import rays_at
from .view_planner import SAMPLED_VIEWS, ViewPlanner


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
        self._own = instruments
        self._instruments = [lambda _rng, each=each: each for each in instruments] or KINDS
        self._kinds = written_truths(options.content(), len(loaded.frames))
        self._edges = SilhouetteEdges.of(reference.mesh)
        colours, messages = colours_of(self.reference, options.colour)
        self.messages = (*self.messages, *messages)
        unseen = unseen_colours_of(self.reference, options.unseen)
        # both eyes see everything by the left one's lamp
        light = None if reference.light is None else reference.light.moved(self._camera_from_planned)
        head = head_light(reference.pivot_model).moved(self._camera_from_planned)
        surface = ColouredSurface(reference.mesh, tuple(colours), unseen, reference.pivot_model, light)
        self._front = Front(self.camera, light or head, options.samples)
        self._lit = None
        if light is not None and options.occluders:
            rays = rays_at(reference.mesh) if light.shadows else None
            self._lit = LitSurface(reference.mesh, CornerNormals(reference.mesh), light, rays)
        self._surroundings = None
        if options.surroundings == FRAME:
            self._surroundings = Surroundings.of(self.reference.view, reference.light, light)
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
        said, views = [super().sampling_doubt()], range(min(SAMPLED_VIEWS, self._count))
        for number, instrument in enumerate(self._own, start=1):
            without = 0
            for view in views:
                pose = inverse_rigid(self._camera_from_planned) @ self.plan(view).cam_from_model
                stream = np.random.default_rng([self._options.seed, view, STREAM])
                without += held_instrument(instrument, stream, self.probe, (), self.camera, pose) is None
            if without:
                said.append(
                    f"--occluder-meshes: number {number} by name finds no place in {without} of the first {len(views)} "
                    "views, and is left out there; its shaft must be longer than what the image shows of it, in mm"
                )
        return "; ".join(filter(None, said))

    def make(self, index: int) -> RenderedSample:
        """Plan and render view ``index``."""
        planned = self.plan(index)
        return self.sample(index, planned, self.render(planned.cam_from_model))

    def sample(self, index: int, planned: PlannedPose, rendered: RenderedView) -> RenderedSample:
        """View ``index`` with what is in front and around, by seed and number alone; the same for both eyes."""
        mean, pose, occluders, shadow = self._options.occluders, planned.cam_from_model, None, None
        if mean > 0:
            left = inverse_rigid(self._camera_from_planned) @ pose
            seed = self._options.seed, index
            occluders = draw_occluders(mean, seed, self.probe, self.camera, left, self._instruments)
        if self._lit is not None and occluders is not None:
            shadow = Shadow(occluders.mesh, self._lit.light, self.camera, pose)
            rendered = self._lit.shaded(rendered, shadow)
        if self._surroundings is not None:
            rendered = self._surroundings.behind(rendered, self.camera, pose, shadow)
        if mean > 0:
            rendered = self._front.composed(rendered, occluders, pose)
        return RenderedSample(planned, rendered)

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
