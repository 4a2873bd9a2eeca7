"""The corner of the surface at which the next landmark gains most."""

import bpy
import numpy as np

from ..class_registration import at_end
from ..pipeline.alignment.landmarks.align_landmarks import complete_landmarks
from ..pipeline.alignment.landmarks.degeneracy import UndeterminedPose
from ..pipeline.alignment.pose_uncertainty import PoseMode
from ..pipeline.alignment.posterior.next_click import WIDTH_PX, corners_in_view, next_click, rough_mode
from ..pipeline.blender.alignment.surface_object import edited_mesh, visible_surface
from ..pipeline.surface.decimation import cluster_vertices
from ..pipeline.surface.mesh import TriangleMesh
from ..pipeline.transforms import transform_points
from ..state import from_scene
from . import gestures, solve
from .uncertainty_drawing import is_inner

APART = 0.02
"""Least distance from a landmark, in widths of the frame: another feature."""

_coarse: tuple[tuple, TriangleMesh] | None = None
"""The surface as finely as its corners need it, and which surface that is."""

_last: tuple[tuple, np.ndarray | None] | None = None
"""The latest answer, and what it was computed from."""


def best_point(scene: bpy.types.Scene) -> np.ndarray | None:
    """``(3,)`` point of the visible surface, model frame, mm; ``None`` where none is seen, and during a drag.

    Raises
    ------
    InputError
        There is no camera or surface, or no valid pose.
    """
    global _last
    if gestures.running() is not None:
        return None
    pose, surface = from_scene.cam_from_model(scene), from_scene.surface_of(scene)
    known = (*solve.evidence(scene), pose.tobytes(), surface.name_full, surface.oneframe.mesh_path)
    if _last is None or _last[0] != known:
        _last = known, _best_point(scene, pose)
    return _last[1]


def _best_point(scene: bpy.types.Scene, pose: np.ndarray) -> np.ndarray | None:
    landmarks, camera, click_sigma_px, _ = solve.evidence(scene)
    seen = visible_surface(from_scene.surface_of(scene), camera, pose).points_model
    if not len(seen):
        return None
    corners = corners_in_view(_coarse_surface(scene), camera, pose)
    # a surface without corners still has a place that gains most
    for points in (corners, seen):
        pixels = camera.project(transform_points(pose, points))
        free = is_inner(pixels, camera)
        for landmark in complete_landmarks(landmarks).values():
            free &= np.linalg.norm(pixels - np.array(landmark.pixel), axis=1) > APART * camera.width
        if free.any():
            return points[free][next_click(points[free], camera, _modes(scene, pose, seen), click_sigma_px)]
    return None


def _coarse_surface(scene: bpy.types.Scene) -> TriangleMesh:
    global _coarse
    surface = from_scene.surface_of(scene)
    known = surface.data.session_uid, len(surface.data.vertices), surface.oneframe.mesh_path
    if _coarse is None or _coarse[0] != known:
        mesh = edited_mesh(surface)
        _coarse = known, cluster_vertices(mesh, 2 * mesh.radius / WIDTH_PX)[0]
    return _coarse[1]


def _modes(scene: bpy.types.Scene, pose: np.ndarray, points_model: np.ndarray) -> tuple[PoseMode, ...]:
    landmarks, camera, click_sigma_px, _ = evidence = solve.evidence(scene)
    solved = solve.solved(*evidence)
    if isinstance(solved, UndeterminedPose):
        if len(solved.modes) > 1:
            return solved.modes
    elif solve.is_current(scene, solve.solution(scene)):
        found = solved.estimate
        return (PoseMode(found.cam_from_model, found.uncertainty, 1.0, found.inliers),)
    return (rough_mode(pose, landmarks, points_model, camera, click_sigma_px),)


def _forget() -> None:
    global _last, _coarse
    _last = _coarse = None


PARTS = (at_end(_forget),)
