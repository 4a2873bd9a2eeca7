"""One view of a dataset from its number: pose, render, ground truth. Independent of worker, shard and order."""

from contextlib import ExitStack

import numpy as np

from ...camera.pinhole import PinholeCamera
from ...case.loaded_case import LoadedCase
from ...colour.colour_doubts import magnification_doubt, pose_doubt, reduction_doubt
from ...colour.reference_view import ReferenceView, colours_of, limited_to_incidence, unseen_colours_of
from ...colour.shading import ColouredSurface
from ...dataset.description import farthest_listed_mm, view_camera
from ...dataset.layout import ViewPaths, view_kinds
from ...dataset.options import DatasetOptions
from ...dataset.run.resume_record import ViewRecord
from ...dataset.view import RenderedSample, depth_scale_for, encode_view
from ...poses.constraints import Constraints, PlannedPose, plan_given_poses, plan_pose, sampling_doubt
from ...poses.distributions import Cone, Gaussian, PoseDistribution, ReferencePose, Shell, Trajectory
from ...projection.silhouette import SilhouetteEdges
from ..render.engines import opened_engine
from ..render.surface_tree import ViewProbe

SAMPLED_VIEWS = 4
"""Views whose poses are planned before a run, to see whether the constraints leave enough of them."""


class ViewRenderer:
    """Renders views of one dataset; creating it prepares everything that they share. Use as a context manager.

    Attributes
    ----------
    render
        Renders any pose (4x4, mm).
    """

    def __init__(
        self,
        loaded: LoadedCase,
        source: ReferenceView,
        options: DatasetOptions,
        given_poses: np.ndarray | None,
        *,
        identity: str = "",
        threads: int = 0,
    ) -> None:
        """Prepare colour, scene, probe and pose distribution.

        Parameters
        ----------
        loaded, source
            The case and the reference view of the surface to render.
        options
            The run's options.
        given_poses
            ``(N, 4, 4)`` explicit ``cam_from_model``, mm, or ``None`` to draw poses.
        identity
            Identity of the dataset, for the records of the views.
        threads
            Number of render threads of Cycles, 0 for one per core.
        """
        self._options, self._identity = options, identity
        self.camera = view_camera(loaded, options)
        source = limited_to_incidence(source, options.max_incidence_deg)
        self.source = source
        orbits = given_poses is None and options.sampler != "gaussian"
        nearest, farthest = (options.distance_min, options.distance_max) if orbits else (1.0, 1.0)
        view_px, frame_px = self.camera.fx, loaded.frame.camera.fx
        doubts = (
            pose_doubt(loaded.case.alignment),
            magnification_doubt(view_px, frame_px, nearest),
            reduction_doubt(view_px, frame_px, farthest, options.samples),
        )
        self.messages = (*loaded.messages, *source.messages, *filter(None, doubts))
        colours, messages = colours_of(source, options.colour)
        self.messages = (*self.messages, *messages)
        surface = ColouredSurface(
            source.mesh, tuple(colours), unseen_colours_of(source, options.unseen), source.pivot_model
        )
        self._resources = ExitStack()
        self.render = self._resources.enter_context(
            opened_engine(options.engine, surface, self.camera, samples=options.samples, threads=threads)
        )
        self._probe = ViewProbe(source.mesh, self.camera, source.observed)
        self._kinds = view_kinds(float_depth=options.float_depth, several_frames=len(loaded.frames) > 1)
        self._edges = SilhouetteEdges.of(source.mesh)
        self._given = given_poses
        reference = ReferencePose(loaded.frame.cam_from_model, source.pivot_model)
        self._trajectory = Trajectory(
            reference=reference,
            cone_deg=options.cone_deg,
            roll_deg=options.roll_deg,
            # the path starts at the reference pose, at factor 1
            distance_min=min(options.distance_min, 1.0),
            distance_max=max(options.distance_max, 1.0),
        )
        self._distribution = _distribution(options, reference, self.camera)
        self._constraints = Constraints(
            min_surface=options.min_surface,
            reference_surface=self._probe(loaded.frame.cam_from_model).surface_fraction,
            min_observed=options.min_observed,
            min_clearance_mm=options.min_clearance_mm,
        )
        self.depth_scale = depth_scale_for(_farthest_mm(source, options, reference, given_poses))

    def __enter__(self) -> "ViewRenderer":
        return self

    def __exit__(self, *_: object) -> None:
        self._resources.close()

    def plan(self, index: int) -> PlannedPose:
        """Plan the pose of view ``index``; it depends only on the case, the options and (seed, index).

        Raises
        ------
        InputError
            No pose meets the constraints.
        """
        if self._given is not None:
            return plan_given_poses(self._given[index : index + 1], self._constraints, self._probe)[0][0]
        if self._distribution is None:
            pose = self._trajectory.pose_at(index / self._options.count)
            return plan_given_poses(pose[None], self._constraints, self._probe)[0][0]
        return plan_pose(self._distribution, self._constraints, self._probe, seed=self._options.seed, index=index)

    def sampling_doubt(self) -> str:
        """A message if hardly any pose meets the constraints; empty otherwise.

        See :func:`oneframe.poses.constraints.sampling_doubt`.

        Raises
        ------
        InputError
            One of the first views finds no pose.
        """
        if self._given is not None or self._distribution is None:
            return ""
        return sampling_doubt([self.plan(index).attempts for index in range(min(SAMPLED_VIEWS, self._options.count))])

    def make(self, index: int) -> RenderedSample:
        """Plan and render view ``index``."""
        planned = self.plan(index)
        return RenderedSample(planned, self.render(planned.cam_from_model))

    def video_poses(self, frames: int) -> np.ndarray:
        """``(frames, 4, 4)`` poses of the video's trajectory."""
        return self._trajectory.poses(frames)

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


def _distribution(options: DatasetOptions, reference: ReferencePose, camera: PinholeCamera) -> PoseDistribution | None:
    distances = {"distance_min": options.distance_min, "distance_max": options.distance_max}
    match options.sampler:
        case "cone":
            return Cone(
                reference=reference,
                cone_deg=options.cone_deg,
                roll_deg=options.roll_deg,
                shift_mm=options.shift_mm,
                **distances,
            )
        case "gaussian":
            return Gaussian(reference=reference, sigma_deg=options.sigma_deg, sigma_mm=options.sigma_mm)
        case "shell":
            middle = camera.rays_cam(np.array([[(camera.width - 1) / 2, (camera.height - 1) / 2]]))[0]
            return Shell(
                reference=reference,
                max_polar_deg=options.polar_deg,
                roll_deg=options.roll_deg,
                look_ray_cam=tuple(middle),
                **distances,
            )
    return None


def _farthest_mm(
    source: ReferenceView, options: DatasetOptions, reference: ReferencePose, given_poses: np.ndarray | None
) -> float:
    """A depth that the surface hardly ever exceeds in the dataset's views; a view beyond it gets its own scale."""
    radius_mm = source.mesh.radius
    reach = radius_mm + float(np.linalg.norm(source.pivot_model))
    if given_poses is not None:
        return farthest_listed_mm(given_poses, radius_mm)
    if options.sampler == "gaussian":
        return reference.distance_mm + reach + 4 * options.sigma_mm
    return reference.distance_mm * max(options.distance_max, 1.0) + reach
