"""The pose from the landmarks, cached by their content and therefore never stale, even after undo."""

from dataclasses import dataclass
from functools import lru_cache

import bpy
import numpy as np

from ..class_registration import at_end, class_registration, listening
from ..pipeline.alignment.landmarks.align_landmarks import (
    Alignment,
    align_landmarks,
    complete_landmarks,
    is_ambiguous,
    landmark_arrays,
    landmark_distances,
)
from ..pipeline.alignment.landmarks.align_landmarks import off_surface as off_surface_warning
from ..pipeline.alignment.landmarks.solver import PoseEstimate, UndeterminedPose
from ..pipeline.alignment.manual.pins import pull_pins
from ..pipeline.alignment.reprojection import twist_between
from ..pipeline.blender.alignment.surface_object import edited_mesh, visible_surface
from ..pipeline.camera.pinhole import PinholeCamera
from ..pipeline.case.landmarks import Landmark
from ..pipeline.errors import InputError
from ..pipeline.transforms import transform_points
from ..state import events, from_scene, pose_evidence
from ..state.pose import set_cam_from_model

SAME_POSE_PX = 0.05
"""Two poses count as the same if no landmark's projection differs by more than this."""


@dataclass(frozen=True)
class Solution:
    """The pose from the landmarks, or the reason why they do not determine one.

    Attributes
    ----------
    alignment
        In the frame ``model``; ``None`` if the landmarks do not determine a pose.
    refusal
        The message for the user in that case, otherwise empty.
    """

    alignment: Alignment | None
    refusal: str

    @property
    def estimate(self) -> PoseEstimate | None:
        """The pose, its residuals and its uncertainty."""
        return None if self.alignment is None else self.alignment.estimate

    def is_outlier(self, index: int) -> bool:
        """Whether the landmark with this index in the list is an outlier."""
        if self.alignment is None or index not in self.alignment.indices:
            return False
        return not self.alignment.estimate.inliers[self.alignment.indices.index(index)]


@dataclass(frozen=True)
class Departure:
    """How far the current pose is from the solution.

    Attributes
    ----------
    shift_mm
        Distance between the two positions of the pivot.
    rotation_deg
        Angle of the rotation between the two poses.
    largest_px
        Largest distance between the projections of a landmark; infinite if one lies behind the camera.
    """

    shift_mm: float
    rotation_deg: float
    largest_px: float


def solution(scene: bpy.types.Scene) -> Solution:
    """Solve for the pose from the scene's landmarks, or return the cached solution if they have not changed.

    Raises
    ------
    InputError
        There is no camera; or the landmarks are ambiguous and there is no valid current pose.
    """
    # six digits: a property holds 0.2 as 0.20000000298
    given = from_scene.landmarks_model(scene), from_scene.camera(scene), round(scene.oneframe.click_sigma_px, 6)
    solved = _solved(*given, None)
    if isinstance(solved, UndeterminedPose) and is_ambiguous(solved):
        # only then does the result depend on the current pose, which changes with every step
        solved = _solved(*given, from_scene.cam_from_model(scene).tobytes())
    if isinstance(solved, UndeterminedPose):
        return Solution(None, str(solved))
    return Solution(solved, "")


@lru_cache(maxsize=128)
def _solved(
    landmarks: tuple[Landmark, ...], camera: PinholeCamera, click_sigma_px: float, start: bytes | None
) -> Alignment | UndeterminedPose:
    pose = None if start is None else np.frombuffer(start).reshape(4, 4)
    try:
        return align_landmarks(landmarks, camera, click_sigma_px=click_sigma_px, start=pose)
    except UndeterminedPose as refusal:
        return refusal.with_traceback(None)


def off_surface(scene: bpy.types.Scene) -> tuple[str, ...]:
    """A warning that names the enabled landmarks whose point is not on the surface, or nothing."""
    mesh = edited_mesh(from_scene.surface_of(scene))
    return off_surface_warning(landmark_distances(from_scene.landmarks_model(scene), mesh))


def residuals_px(scene: bpy.types.Scene) -> dict[int, np.ndarray]:
    """Index -> ``(2,)`` clicked minus projected pixel at the current pose, of all landmarks that have both points."""
    camera, pose = from_scene.camera(scene), from_scene.cam_from_model(scene)
    found = {}
    for index, entry in enumerate(scene.oneframe.landmarks):
        if entry.has_point and entry.has_pixel:
            seen = camera.project(transform_points(pose, np.array(entry.point[:], float)[None]))[0]
            found[index] = np.array(entry.pixel[:], float) - seen
    return found


def departure(scene: bpy.types.Scene, solved: Solution) -> Departure | None:
    """How far the current pose is from the solution; ``None`` if they are the same, or if there is no solution."""
    if solved.alignment is None:
        return None
    present, wanted = from_scene.cam_from_model(scene), solved.alignment.estimate.cam_from_model
    camera, points = from_scene.camera(scene), solved.alignment.points
    shifts_px = camera.project(transform_points(present, points)) - camera.project(transform_points(wanted, points))
    largest = float(np.max(np.linalg.norm(np.where(np.isfinite(shifts_px), shifts_px, np.inf), axis=1)))
    if largest <= SAME_POSE_PX:
        return None
    twist = twist_between(wanted, present, solved.alignment.estimate.uncertainty.pivot_model)
    return Departure(float(np.linalg.norm(twist[:3])), float(np.degrees(np.linalg.norm(twist[3:]))), largest)


def is_current(scene: bpy.types.Scene, solved: Solution) -> bool:
    """Whether the current pose is the solution: only then do its figures, outliers and uncertainty hold.

    Raises
    ------
    InputError
        There is no camera or surface, or no valid pose.
    """
    return solved.alignment is not None and departure(scene, solved) is None


def apply(scene: bpy.types.Scene, solved: Solution) -> None:
    """Move the surface to the pose of a solution.

    Raises
    ------
    InputError
        The landmarks do not determine a pose.
    """
    if solved.estimate is None:
        raise InputError(solved.refusal)
    set_cam_from_model(scene, solved.estimate.cam_from_model)


def pull(scene: bpy.types.Scene, cam_from_model: np.ndarray) -> None:
    """Pull the surface, like pins, from a pose ``(4, 4)`` to the enabled correspondences; see :func:`pull_pins`.

    Raises
    ------
    InputError
        No pose fits the pins, for instance because a point would lie behind the camera.
    """
    surface, camera = from_scene.surface_of(scene), from_scene.camera(scene)
    points, pixels = landmark_arrays(tuple(complete_landmarks(from_scene.landmarks_model(scene)).values()))
    pivot = visible_surface(surface, camera, cam_from_model).pivot_model
    if pivot is None:
        pivot = points.mean(axis=0)
    pulled = pull_pins(points, pixels, camera, cam_from_model, pivot)
    set_cam_from_model(scene, pulled)
    off_px = np.linalg.norm(camera.project(transform_points(pulled, points)) - pixels, axis=1)
    record = {"method": "pins", "pairs": len(points), "rms_px": float(np.sqrt(np.mean(off_px**2)))}
    pose_evidence.remember(scene, record, pulled)


def follow(scene: bpy.types.Scene) -> None:
    """Move the surface to the solution after a change of the landmarks, if *Live* is on and there is one.

    A pose that was refined against the image stays: it is better than the landmarks', and only *Solve* replaces it.
    """
    if not scene.oneframe.live_solve or not from_scene.is_set_up(scene):
        return
    try:
        # raises for a scaled surface, which the panel Set up reports
        if pose_evidence.is_refined(scene):
            return
        solved = solution(scene)
    except InputError:
        return
    if solved.estimate is not None:
        apply(scene, solved)


register, unregister = class_registration(
    __name__, at_end(_solved.cache_clear), listening(events.landmark_listeners, follow)
)
