"""What the landmarks say about the pose: solved as a function of their content, so never stale, whatever was undone."""

from dataclasses import dataclass
from functools import lru_cache

import bpy
import numpy as np

from ..pipeline.alignment.landmarks import surface_distance
from ..pipeline.alignment.landmarks.align_landmarks import (
    Alignment,
    align_landmarks,
    complete_landmarks,
    is_ambiguous,
    landmark_arrays,
)
from ..pipeline.alignment.landmarks.reprojection import twist_between
from ..pipeline.alignment.landmarks.solver import PoseEstimate, UndeterminedPose
from ..pipeline.alignment.manual.pins import pull_pins
from ..pipeline.blender.alignment import surface_object
from ..pipeline.blender.alignment.visible_surface import visible_surface
from ..pipeline.camera.pinhole import PinholeCamera
from ..pipeline.case.landmarks import Landmark
from ..pipeline.errors import InputError
from ..pipeline.transforms import transform_points
from ..state import events, from_scene

AWAY_PX = 0.05
"""A pose from which no landmark moves by more pixels than this is the landmarks' own."""


@dataclass(frozen=True)
class Solution:
    """The pose that the landmarks give, or why they give none.

    Attributes
    ----------
    alignment
        In the frame ``model``; ``None`` if the landmarks do not determine a pose.
    refusal
        Then the reason, a sentence.
    """

    alignment: Alignment | None
    refusal: str

    @property
    def estimate(self) -> PoseEstimate | None:
        """The pose, its residuals and its uncertainty."""
        return None if self.alignment is None else self.alignment.estimate

    def is_outlier(self, index: int) -> bool:
        """Whether the landmark at this place of the list disagrees with the others."""
        if self.alignment is None or index not in self.alignment.indices:
            return False
        return not self.alignment.estimate.inliers[self.alignment.indices.index(index)]


@dataclass(frozen=True)
class Departure:
    """How far the present pose is from that of the landmarks: the pivot's shift, the turn, the largest effect."""

    shift_mm: float
    turn_deg: float
    largest_px: float


def solution(scene: bpy.types.Scene) -> Solution:
    """Solve the scene's landmarks, or look it up if they are as they were.

    Raises
    ------
    InputError
        There is no camera.
    """
    # six digits: a property holds 0.2 as 0.20000000298
    given = landmarks_model(scene), from_scene.camera(scene), round(scene.oneframe.click_sigma_px, 6)
    solved = _solved(*given, None)
    if isinstance(solved, UndeterminedPose) and is_ambiguous(solved):
        # only then the result depends on the pose of the surface, which changes with every step
        solved = _solved(*given, from_scene.cam_from_model(scene).tobytes())
    if isinstance(solved, UndeterminedPose):
        return Solution(None, str(solved))
    return Solution(solved, "")


def landmarks_model(scene: bpy.types.Scene) -> tuple[Landmark, ...]:
    """All landmarks of a scene, in the frame ``model``, mm."""
    return tuple(
        Landmark(
            entry.name,
            (entry.point[0], entry.point[1], entry.point[2]) if entry.has_point else None,
            (entry.pixel[0], entry.pixel[1]) if entry.has_pixel else None,
            entry.enabled,
        )
        for entry in scene.oneframe.landmarks
    )


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
    """A sentence that names the enabled landmarks whose point is not on the surface, or nothing."""
    return surface_distance.off_surface(
        landmarks_model(scene), surface_object.edited_mesh(from_scene.surface_of(scene))
    )


def residuals_px(scene: bpy.types.Scene) -> dict[int, np.ndarray]:
    """Index -> ``(2,)`` clicked minus predicted pixel at the present pose, of all landmarks that have both halves."""
    camera, pose = from_scene.camera(scene), from_scene.cam_from_model(scene)
    found = {}
    for index, entry in enumerate(scene.oneframe.landmarks):
        if entry.has_point and entry.has_pixel:
            seen = camera.project(transform_points(pose, np.array(entry.point[:], float)[None]))[0]
            found[index] = np.array(entry.pixel[:], float) - seen
    return found


def departure(scene: bpy.types.Scene, solved: Solution) -> Departure | None:
    """How far the present pose is from the solution; ``None`` if it is the solution, or there is none."""
    if solved.alignment is None:
        return None
    present, wanted = from_scene.cam_from_model(scene), solved.alignment.estimate.cam_from_model
    camera, points = from_scene.camera(scene), solved.alignment.points
    apart = camera.project(transform_points(present, points)) - camera.project(transform_points(wanted, points))
    largest = float(np.max(np.linalg.norm(np.where(np.isfinite(apart), apart, np.inf), axis=1)))
    if largest <= AWAY_PX:
        return None
    twist = twist_between(wanted, present, solved.alignment.estimate.uncertainty.pivot_model)
    return Departure(float(np.linalg.norm(twist[:3])), float(np.degrees(np.linalg.norm(twist[3:]))), largest)


def apply(scene: bpy.types.Scene, solved: Solution) -> None:
    """Make a solution the pose.

    Raises
    ------
    InputError
        The pairs do not determine a pose.
    """
    if solved.estimate is None:
        raise InputError(solved.refusal)
    camera_object, surface = from_scene.camera_object_of(scene), from_scene.surface_of(scene)
    surface_object.set_pose(camera_object, surface, solved.estimate.cam_from_model)


def pull(scene: bpy.types.Scene, cam_from_model: np.ndarray) -> None:
    """From a pose ``(4, 4)``, pull the surface to the enabled pairs as pins do: a few hold it only as far as they can.

    Raises
    ------
    InputError
        There is no such pose, for instance because a point would lie behind the camera.
    """
    camera_object, surface, camera = (
        from_scene.camera_object_of(scene),
        from_scene.surface_of(scene),
        from_scene.camera(scene),
    )
    points, pixels = landmark_arrays(tuple(complete_landmarks(landmarks_model(scene)).values()))
    pivot = visible_surface(surface, camera, cam_from_model).pivot_model
    if pivot is None:
        pivot = points.mean(axis=0)
    pulled = pull_pins(points, pixels, camera, cam_from_model, pivot)
    surface_object.set_pose(camera_object, surface, pulled)


def follow(scene: bpy.types.Scene) -> None:
    """After a change of the landmarks: where they determine a pose and Live is on, the surface takes it."""
    if not scene.oneframe.live_solve or not from_scene.is_set_up(scene):
        return
    try:
        # a scaled surface is refused here; the Set up panel says so
        from_scene.cam_from_model(scene)
        solved = solution(scene)
    except InputError:
        return
    if solved.estimate is not None:
        apply(scene, solved)


def register() -> None:
    """Solve at every change."""
    events.on_landmarks_changed(follow)


def unregister() -> None:
    """The opposite of :func:`register`."""
    events.forget(follow)
    _solved.cache_clear()
