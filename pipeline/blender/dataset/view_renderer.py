"""One view of a dataset from its number alone, independent of worker, shard and order: pose, render, ground truth."""

from contextlib import ExitStack
from dataclasses import replace

import numpy as np

from ...case.loaded_case import LoadedCase, frame_overlay
from ...colour.colour_doubts import magnification_doubt, pose_doubt, reduction_doubt
from ...colour.reference_view import (
    ReferenceView,
    colours_of,
    limited_to_incidence,
    unseen_colours_of,
    without_highlights,
    without_shadows,
)
from ...colour.shading import ColouredSurface
from ...dataset.description import distribution_of, trajectory_of, view_camera
from ...dataset.layout import ViewPaths
from ...dataset.options import DROP, DatasetOptions
from ...dataset.run.resume_record import ViewRecord
from ...dataset.truths import depth_scale_for, written_truths
from ...dataset.view import RenderedSample, encode_view
from ...occlusion.compositing import front_filter, shadow_filter
from ...occlusion.occluders import places_doubt
from ...occlusion.staging import StagedView, Staging
from ...occlusion.surroundings import surroundings_filter
from ...poses.constraints import Constraints, PlannedPose, plan_given_pose, plan_pose, sampling_doubt
from ...poses.distributions import Listed, ReferencePose
from ...poses.pose_file import OTHER_CONVENTION
from ...projection.silhouette import SilhouetteEdges
from ...transforms import inverse_rigid
from ..render.engines import opened_engine
from ..render.surface_tree import ViewProbe

FILTERS = (shadow_filter, surroundings_filter, front_filter)
"""What changes a view after its engine, in this order; each is made from a :class:`.Staging`, if that asks for it."""
SAMPLED_VIEWS = 4
"""Views whose poses are planned before a run, to see whether the constraints leave enough of them."""


class ViewPlanner:
    """Plans the views of one dataset.

    Attributes
    ----------
    reference
        The reference view, limited to what the options let count as seen.
    camera
        Intrinsics of the views.
    depth_scale
        Millimetres per unit of the depth images.
    probe
        What poses show, and what meets the surface.
    messages
        Messages for the user.
    """

    def __init__(
        self, loaded: LoadedCase, reference: ReferenceView, options: DatasetOptions, given_poses: np.ndarray | None
    ) -> None:
        """Prepare probe and pose distribution.

        Parameters
        ----------
        loaded, reference
            The case and the reference view of the surface to render.
        options
            The run's options.
        given_poses
            ``(N, 4, 4)`` explicit ``cam_from_model``, mm, or ``None`` to draw poses.
        """
        self._loaded, self._options = loaded, options
        self._count = options.count if given_poses is None else len(given_poses)
        self.camera = view_camera(loaded, options)
        if options.highlights == DROP:
            reference = without_highlights(reference, loaded.frames)
        if options.unseen == "fill":
            reference = without_shadows(reference)
        self.reference = limited_to_incidence(reference, options.max_incidence_deg)
        pose = ReferencePose(loaded.frame.cam_from_model, reference.pivot_model)
        self._video_path = trajectory_of(options, pose, self.camera)
        self._distribution = (
            distribution_of(options, pose, self.camera)
            if given_poses is None
            else Listed(reference=pose, poses=given_poses)
        )
        beside = options.camera_from_planned
        self._camera_from_planned = np.eye(4) if beside is None else beside
        # listed poses are already those of the camera
        self._is_beside = beside is not None and given_poses is None
        self.depth_scale = depth_scale_for(self._distribution.farthest_mm(reference.mesh.radius))
        self.probe = ViewProbe(reference.mesh, self.camera, self.reference.observed)
        self._constraints = Constraints(
            min_surface=options.min_surface,
            reference_surface=self.probe(loaded.frame.cam_from_model).surface_fraction,
            min_observed=options.min_observed,
            min_clearance_mm=options.min_clearance_mm,
        )
        nearest, farthest = self._distribution.distances
        view_px, frame_px = self.camera.fx, loaded.frame.camera.fx
        doubts = (
            pose_doubt(loaded.case.alignment),
            magnification_doubt(view_px, frame_px, nearest),
            reduction_doubt(view_px, frame_px, farthest, options.samples),
        )
        self.messages = (*loaded.messages, *reference.messages, *filter(None, doubts))

    def plan(self, index: int) -> PlannedPose:
        """Plan the pose of view ``index``; it depends only on the case, the options and (seed, index)."""
        fixed = self._distribution.fixed_pose(index, self._count)
        if fixed is not None:
            planned = plan_given_pose(fixed, self._constraints, self.probe)
        else:
            seed = self._options.seed
            planned = plan_pose(self._distribution, self._constraints, self.probe, seed=seed, index=index)
        if not self._is_beside:
            return planned
        pose = self._camera_from_planned @ planned.cam_from_model
        return replace(planned, cam_from_model=pose, statistics=self.probe(pose))

    def sampling_doubt(self) -> str:
        """A message if hardly any pose meets the constraints, or listed ones show nothing; empty otherwise.

        See :func:`oneframe.poses.constraints.sampling_doubt`.
        """
        plans = [self.plan(index) for index in range(min(SAMPLED_VIEWS, self._count))]
        if isinstance(self._distribution, Listed) and not any(plan.statistics.surface_fraction for plan in plans):
            return f"poses: the first {len(plans)} show no surface; {OTHER_CONVENTION}"
        return sampling_doubt([plan.attempts for plan in plans])

    def frame_overlay(self) -> np.ndarray:
        """The frame with the surface's outline and the structures, to judge the alignment."""
        return frame_overlay(self._loaded, self.reference.view.depth_mm)

    def video_poses(self, frames: int) -> np.ndarray:
        """``(frames, 4, 4)`` poses of the video's trajectory, ``cam_from_model``, mm."""
        return self._video_path.poses(frames)


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
        *,
        identity: str = "",
        threads: int = 0,
    ) -> None:
        """Prepare colours and engine.

        Parameters
        ----------
        loaded, reference, options, given_poses
            As of :class:`ViewPlanner`.
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
        """As of :class:`ViewPlanner`, and of what stands in front."""
        mean, back, said = self._options.occluders, inverse_rigid(self._camera_from_planned), [super().sampling_doubt()]
        if mean:
            poses = [back @ self.plan(index).cam_from_model for index in range(min(SAMPLED_VIEWS, self._count))]
            said.append(places_doubt(mean, self._options.seed, self.probe, self.camera, poses))
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
