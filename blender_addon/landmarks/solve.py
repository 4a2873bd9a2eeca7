"""What the landmarks say about the pose: solved as a function of their content, so never stale, whatever was undone."""

from dataclasses import dataclass
from functools import lru_cache

import bpy
import numpy as np

from ..pipeline.alignment.landmarks.reprojection import twist_between
from ..pipeline.alignment.landmarks.solver import PoseEstimate, UndeterminedPose, solve_pose
from ..pipeline.alignment.manual.pins import pull_pins
from ..pipeline.blender.alignment import alignment_scene
from ..pipeline.blender.alignment.visible_surface import visible_surface
from ..pipeline.camera.pinhole import PinholeCamera
from ..pipeline.errors import InputError
from ..pipeline.transforms import transform_points
from ..state import events, from_scene

AWAY_PX = 0.05
"""A pose from which no landmark moves by more pixels than this is the landmarks' own."""


@dataclass(frozen=True)
class LandmarkCorrespondences:
    """The enabled landmarks that have both halves.

    Attributes
    ----------
    indices
        N places in the scene's list.
    names
        Their names.
    points_model
        ``(N, 3)`` mm.
    pixels
        ``(N, 2)``.
    """

    indices: tuple[int, ...]
    names: tuple[str, ...]
    points_model: np.ndarray
    pixels: np.ndarray

    @classmethod
    def of(cls, scene: bpy.types.Scene) -> "LandmarkCorrespondences":
        """Those of a scene."""
        used = [
            (index, entry)
            for index, entry in enumerate(scene.oneframe.landmarks)
            if entry.enabled and entry.has_point and entry.has_pixel
        ]
        return cls(
            tuple(index for index, _ in used),
            tuple(entry.name for _, entry in used),
            np.array([entry.point[:] for _, entry in used], float).reshape(-1, 3),
            np.array([entry.pixel[:] for _, entry in used], float).reshape(-1, 2),
        )


@dataclass(frozen=True)
class Solution:
    """The pose that the landmarks say, or why they say none.

    Attributes
    ----------
    pairs
        What it was solved from.
    estimate
        ``None`` if the pairs do not determine a pose.
    refusal
        Then the reason, a sentence.
    """

    pairs: LandmarkCorrespondences
    estimate: PoseEstimate | None
    refusal: str

    def is_outlier(self, index: int) -> bool:
        """Whether the landmark at this place of the list disagrees with the others."""
        if self.estimate is None or index not in self.pairs.indices:
            return False
        return not self.estimate.inliers[self.pairs.indices.index(index)]


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
    pairs = LandmarkCorrespondences.of(scene)
    given = (
        pairs.points_model.tobytes(),
        pairs.pixels.tobytes(),
        pairs.names,
        from_scene.camera(scene),
        round(scene.oneframe.click_sigma_px, 6),
    )
    solved = _solved(*given, None)
    if isinstance(solved, _Refusal) and solved.choices > 1:
        # only where several poses fit does it matter which one the surface is in
        solved = _solved(*given, from_scene.cam_from_model(scene).tobytes())
    if isinstance(solved, _Refusal):
        return Solution(pairs, None, solved.sentence)
    return Solution(pairs, solved, "")


@dataclass(frozen=True)
class _Refusal:
    sentence: str
    choices: int


@lru_cache(maxsize=128)
def _solved(
    points: bytes,
    pixels: bytes,
    names: tuple[str, ...],
    camera: PinholeCamera,
    click_sigma_px: float,
    start: bytes | None,
) -> PoseEstimate | _Refusal:
    try:
        return solve_pose(
            np.frombuffer(points).reshape(-1, 3),
            np.frombuffer(pixels).reshape(-1, 2),
            camera,
            click_sigma_px=click_sigma_px,
            start=None if start is None else np.frombuffer(start).reshape(4, 4),
            names=names,
        )
    except UndeterminedPose as refusal:
        return _Refusal(str(refusal), len(refusal.candidates))


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
    if solved.estimate is None:
        return None
    present, wanted = from_scene.cam_from_model(scene), solved.estimate.cam_from_model
    camera, points = from_scene.camera(scene), solved.pairs.points_model
    apart = camera.project(transform_points(present, points)) - camera.project(transform_points(wanted, points))
    largest = float(np.max(np.linalg.norm(np.where(np.isfinite(apart), apart, np.inf), axis=1)))
    if largest <= AWAY_PX:
        return None
    twist = twist_between(wanted, present, solved.estimate.uncertainty.pivot_model)
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
    alignment_scene.set_pose(camera_object, surface, solved.estimate.cam_from_model)


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
    pairs = LandmarkCorrespondences.of(scene)
    pivot = visible_surface(surface, camera, cam_from_model).pivot_model
    if pivot is None:
        pivot = pairs.points_model.mean(axis=0)
    pulled = pull_pins(pairs.points_model, pairs.pixels, camera, cam_from_model, pivot)
    alignment_scene.set_pose(camera_object, surface, pulled)


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
