"""The poses of a dataset's views, each from its number alone: independent of worker, shard and order."""

from dataclasses import replace

import numpy as np

from ...case.loaded_case import LoadedCase, frame_overlay
from ...colour.colour_doubts import magnification_doubt, pose_doubt, reduction_doubt
from ...colour.reference_view import ReferenceView, limited_to_incidence, without_highlights
from ...dataset.description import distribution_of, trajectory_of, view_camera
from ...dataset.options import DROP, DatasetOptions
from ...dataset.truths import depth_scale_for
from ...poses.constraints import Constraints, PlannedPose, plan_given_pose, plan_pose, sampling_doubt
from ...poses.distributions import Listed, ReferencePose
from ...poses.pose_file import OTHER_CONVENTION
from ..render.surface_tree import ViewProbe

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
