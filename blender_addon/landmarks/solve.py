"""The pose from the landmarks, cached by their content and therefore never stale, even after undo."""

from dataclasses import dataclass
from functools import lru_cache

import bpy
import numpy as np

from ..class_registration import at_end, listening
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
from ..pipeline.blender.alignment.surface_object import edited_mesh, visible_surface
from ..pipeline.camera.pinhole import PinholeCamera
from ..pipeline.case.landmarks import Landmark
from ..pipeline.case.pose_record import PoseRecord
from ..pipeline.errors import InputError
from ..pipeline.transforms import rotation_angle_deg, transform_points
from ..state import events, from_scene, pose_evidence
from ..state.landmarks import landmarks_model, points_model
from ..state.pose import set_cam_from_model

SAME_POSE_PX = 0.05
"""Two poses count as the same if no landmark's projection differs by more than this."""


NEAR_CURRENT_DEG = 30.0
"""Of several poses that fit, one within this angle of the current pose is taken."""


@dataclass(frozen=True)
class Solution:
    """The pose from the landmarks, or the reason why they do not determine one.

    Attributes
    ----------
    alignment
        In the frame ``model``; ``None`` if the landmarks do not determine a pose.
    refusal
        The message for the user in that case, otherwise empty.
    doubtful
        ``(4, 4)`` cam_from_model in that case, the most probable first: the poses that all fit, or the one that comes
        nearest where none does. Empty where the landmarks say nothing.
    probabilities
        Of these, if there are several.
    """

    alignment: Alignment | None
    refusal: str
    doubtful: tuple[np.ndarray, ...] = ()
    probabilities: tuple[float, ...] = ()

    @property
    def estimate(self) -> PoseEstimate | None:
        """The pose, its residuals and its uncertainty."""
        return None if self.alignment is None else self.alignment.estimate

    def is_outlier(self, index: int) -> bool:
        """Whether the landmark with this index in the list is an outlier."""
        if self.alignment is None or index not in self.alignment.indices:
            return False
        return not self.alignment.estimate.inliers[self.alignment.indices.index(index)]


def solution(scene: bpy.types.Scene) -> Solution:
    """Solve for the pose from the scene's landmarks, or return the cached solution if nothing has changed."""
    found = solved(*pairs_of(scene))
    if not isinstance(found, UndeterminedPose):
        return Solution(found, "")
    if is_ambiguous(found):
        return Solution(None, str(found), found.candidates, found.probabilities)
    return Solution(None, str(found), found.candidates[:1] if found.kind == "no fit" else ())


Pairs = tuple[tuple[Landmark, ...], PinholeCamera, float]
"""Landmarks, K, and click noise in px."""


def pairs_of(scene: bpy.types.Scene) -> Pairs:
    """What the pose is solved from."""
    # six digits: a property holds 0.2 as 0.20000000298
    return landmarks_model(scene), from_scene.camera(scene), round(scene.oneframe.click_sigma_px, 6)


@lru_cache(maxsize=128)
def solved(
    landmarks: tuple[Landmark, ...], camera: PinholeCamera, click_sigma_px: float
) -> Alignment | UndeterminedPose:
    """The pose from :data:`Pairs`, or why they determine none."""
    try:
        return align_landmarks(landmarks, camera, click_sigma_px=click_sigma_px)
    except UndeterminedPose as refusal:
        return refusal.with_traceback(None)


def off_surface(scene: bpy.types.Scene) -> tuple[str, ...]:
    """A warning that names the enabled landmarks whose point is not on the surface, or nothing."""
    mesh = edited_mesh(from_scene.surface_of(scene))
    return off_surface_warning(landmark_distances(landmarks_model(scene), mesh))


def residuals_px(scene: bpy.types.Scene) -> dict[int, np.ndarray]:
    """Index -> ``(2,)`` clicked minus projected pixel at the current pose, of all landmarks that have both points."""
    camera, pose = from_scene.camera(scene), from_scene.cam_from_model(scene)
    shown = camera.project(transform_points(pose, points_model(scene)))
    return {
        index: np.array(entry.pixel[:], float) - seen
        for index, (entry, seen) in enumerate(zip(scene.oneframe.landmarks, shown, strict=True))
        if entry.has_point and entry.has_pixel
    }


def departure_px(scene: bpy.types.Scene, solved: Solution) -> float | None:
    """Largest distance of a landmark's projection at the current pose from that at the solution, px.

    Infinite if one lies behind the camera; ``None`` if the poses are the same, or if there is no solution.
    """
    if solved.alignment is None:
        return None
    present, wanted = from_scene.cam_from_model(scene), solved.alignment.estimate.cam_from_model
    camera, points = from_scene.camera(scene), solved.alignment.points
    shifts_px = camera.project(transform_points(present, points)) - camera.project(transform_points(wanted, points))
    largest = float(np.max(np.linalg.norm(np.where(np.isfinite(shifts_px), shifts_px, np.inf), axis=1)))
    return largest if largest > SAME_POSE_PX else None


def is_current(scene: bpy.types.Scene, solved: Solution) -> bool:
    """Whether the current pose is the solution: only then do its figures, outliers and uncertainty hold."""
    return solved.alignment is not None and departure_px(scene, solved) is None


def apply(scene: bpy.types.Scene, solved: Solution) -> None:
    """Move the surface to the pose of a solution: of several that fit, to the one near the current pose."""
    if solved.estimate is not None:
        set_cam_from_model(scene, solved.estimate.cam_from_model)
        return
    if not solved.doubtful:
        raise InputError(solved.refusal)
    current = from_scene.cam_from_model(scene)
    apart_deg = [rotation_angle_deg(pose[:3, :3] @ current[:3, :3].T) for pose in solved.doubtful]
    nearest = int(np.argmin(apart_deg))
    take_doubtful(scene, solved, nearest if apart_deg[nearest] <= NEAR_CURRENT_DEG else 0)


def shown_pose(scene: bpy.types.Scene, solved: Solution) -> int | None:
    """Which of the doubtful poses of a solution is the current one; ``None`` if it is none of them."""
    current = from_scene.cam_from_model(scene)
    return next((number for number, pose in enumerate(solved.doubtful) if np.array_equal(pose, current)), None)


def take_doubtful(scene: bpy.types.Scene, solved: Solution, number: int) -> None:
    """Move the surface to one of the doubtful poses of a solution, and record the doubt."""
    pose = solved.doubtful[number]
    complete = complete_landmarks(landmarks_model(scene))
    if len(solved.doubtful) > 1:
        doubt = (
            f"{len(solved.doubtful)} poses fit the landmarks; this one is right with a probability of "
            f"{solved.probabilities[number]:.0%} by the clicks alone"
        )
    else:
        doubt = "no pose fits the landmarks; this one comes nearest"
    record = PoseRecord("landmarks", doubt=doubt, pairs=len(complete), rms_px=rms_px(scene, pose))
    set_cam_from_model(scene, pose)
    pose_evidence.remember(scene, record, from_scene.cam_from_model(scene))


def rms_px(scene: bpy.types.Scene, cam_from_model: np.ndarray) -> float:
    """Root mean square reprojection error of all enabled pairs at a pose, px; infinite behind the camera."""
    points, pixels = landmark_arrays(tuple(complete_landmarks(landmarks_model(scene)).values()))
    off_px = np.linalg.norm(from_scene.camera(scene).project(transform_points(cam_from_model, points)) - pixels, axis=1)
    return float(np.sqrt(np.mean(np.where(np.isfinite(off_px), off_px, np.inf) ** 2)))


def pull(scene: bpy.types.Scene, cam_from_model: np.ndarray, held: int) -> None:
    """Pull the surface, like pins, from a pose ``(4, 4)`` to the enabled correspondences; see :func:`pull_pins`.

    ``held`` is the index in the list of the pin in the hand, which counts more than the others.
    """
    surface, camera = from_scene.surface_of(scene), from_scene.camera(scene)
    complete = complete_landmarks(landmarks_model(scene))
    points, pixels = landmark_arrays(tuple(complete.values()))
    pivot = visible_surface(surface, camera, cam_from_model).pivot_model
    if pivot is None:
        pivot = points.mean(axis=0)
    radius_mm = float(np.linalg.norm(np.array(surface.bound_box) - pivot, axis=1).max())
    index = list(complete).index(held)
    pulled = pull_pins(points, pixels, camera, cam_from_model, pivot, held=index, radius_mm=radius_mm)
    set_cam_from_model(scene, pulled)
    record = PoseRecord("pins", pairs=len(points), rms_px=rms_px(scene, pulled))
    pose_evidence.remember(scene, record, pulled)


def follow(scene: bpy.types.Scene) -> None:
    """Move the surface to the solution after a change of the landmarks, if there is one.

    A refined pose stays: only *Solve* replaces it. Where several poses fit, it moves to the one near the current pose,
    else to the most probable; where none fits, to the one that comes nearest, if that is nearer than the current pose.
    """
    if not from_scene.is_set_up(scene):
        return
    try:
        # raises for a scaled surface, which the sidebar reports
        if pose_evidence.is_refined(scene):
            return
        solved = solution(scene)
    except InputError:
        return
    is_rough = solved.estimate is None and len(solved.doubtful) == 1
    if is_rough and rms_px(scene, solved.doubtful[0]) >= rms_px(scene, from_scene.cam_from_model(scene)):
        return
    if solved.estimate is not None or solved.doubtful:
        apply(scene, solved)


PARTS = (at_end(solved.cache_clear), listening(events.landmark_listeners, follow))
