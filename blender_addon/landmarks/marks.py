"""Positions of the landmarks in a 3D view, both for drawing them and for finding the one under the pointer."""

from collections.abc import Sequence
from dataclasses import dataclass

import bpy
import numpy as np
from bpy_extras import view3d_utils

from ..pipeline.transforms import transform_points
from ..state import from_scene
from ..state.landmarks import points_model
from ..ui import frame_view
from ..ui.frame_view import FrameView

PICK_RADIUS = 11.0
"""Distance from a mark within which a press hits it, in pixels at interface scale 1."""

OCCLUSION_TOLERANCE = 2e-3
"""A point is hidden if the surface in front of it is nearer by more than this, relative to the point's depth."""


@dataclass(frozen=True)
class LandmarkView:
    """A 3D view, and how it maps points of the surface and of the frame.

    Attributes
    ----------
    region, region_3d
        Valid during one event or one drawing only; Blender may free them afterwards.
    frame
        The mapping of the frame's pixels if the view looks through its camera, otherwise ``None``.
    cam_from_model
        ``(4, 4)`` the current pose, mm.
    """

    region: bpy.types.Region
    region_3d: bpy.types.RegionView3D
    frame: FrameView | None
    cam_from_model: np.ndarray

    @classmethod
    def of(cls, context: bpy.types.Context) -> "LandmarkView":
        """The view of a context whose area is a 3D view."""
        region, region_3d = frame_view.window_region(context.area), context.space_data.region_3d
        frame = FrameView.of(context.scene, region, region_3d) if frame_view.shows_frame(context) else None
        return cls(region, region_3d, frame, from_scene.cam_from_model(context.scene))

    def region_from_model(self, scene: bpy.types.Scene, points_model: np.ndarray) -> np.ndarray:
        """``(N, 3)`` points (model frame, mm) -> ``(N, 2)`` region pixels at the current pose; NaN behind the eye."""
        if self.frame is not None:
            points_cam = transform_points(self.cam_from_model, points_model)
            return self.frame.region_from_px(self.frame.camera.project(points_cam))
        clip_from_model = np.array(self.region_3d.perspective_matrix) @ world_from_model(scene)
        clip = points_model @ clip_from_model[:3].T[:3] + clip_from_model[:3, 3]
        w = points_model @ clip_from_model[3, :3] + clip_from_model[3, 3]
        with np.errstate(divide="ignore", invalid="ignore"):
            half = np.array([self.region.width, self.region.height]) / 2
            region = (1 + clip[:, :2] / w[:, None]) * half
        return np.where(w[:, None] > 0, region, np.nan)

    def surface_point(self, scene: bpy.types.Scene, at: np.ndarray) -> np.ndarray | None:
        """``(3,)`` the surface point (model frame, mm) seen at a region pixel, or ``None``."""
        if self.frame is not None:
            return frame_view.surface_point_at(scene, self.frame.px_from_region(at))
        origin = view3d_utils.region_2d_to_origin_3d(self.region, self.region_3d, at)
        direction = view3d_utils.region_2d_to_vector_3d(self.region, self.region_3d, at)
        return frame_view.surface_point(scene, origin, direction)

    def hidden(self, scene: bpy.types.Scene, points_model: np.ndarray, region: Sequence[np.ndarray]) -> np.ndarray:
        """``(N,)`` bool: whether the surface occludes each point, seen at ``region``; all False in Edit mode."""
        if from_scene.surface_of(scene).mode == "EDIT":
            return np.zeros(len(points_model), bool)
        eye_from_model = np.array(self.region_3d.view_matrix) @ world_from_model(scene)
        found = np.zeros(len(points_model), bool)
        for index, (point, at) in enumerate(zip(points_model, region, strict=True)):
            if not np.isfinite(at).all():
                continue
            seen = self.surface_point(scene, at)
            if seen is None:
                continue
            # depth along the viewing direction, increasing away from the eye
            depth, seen_depth = -(transform_points(eye_from_model, np.stack([point, seen]))[:, 2])
            found[index] = depth - seen_depth > OCCLUSION_TOLERANCE * max(abs(depth), 1.0)
        return found


@dataclass(frozen=True)
class Mark:
    """The marks of a landmark's image point and surface point, ``(2,)`` region pixels; ``None`` if there is none."""

    index: int
    image: np.ndarray | None
    surface: np.ndarray | None


def world_from_model(scene: bpy.types.Scene) -> np.ndarray:
    """``(4, 4)`` world_from_model of the surface at the current pose."""
    return np.array(from_scene.surface_of(scene).matrix_world, dtype=np.float64)


def marks_of(scene: bpy.types.Scene, view: LandmarkView) -> list[Mark]:
    """The marks of all landmarks in a view."""
    entries = scene.oneframe.landmarks
    surface = view.region_from_model(scene, points_model(scene))
    marks = []
    for index, entry in enumerate(entries):
        image = None
        if view.frame is not None and entry.has_pixel:
            image = view.frame.region_from_px(np.array(entry.pixel[:], float))
        shown = entry.has_point and np.isfinite(surface[index]).all()
        marks.append(Mark(index, image, surface[index] if shown else None))
    return marks


def nearest(marks: Sequence[Mark], half: str, at: np.ndarray) -> tuple[int, np.ndarray] | None:
    """The landmark whose ``image`` or ``surface`` mark is nearest to a region pixel and hit by it: index and mark."""
    radius = PICK_RADIUS * bpy.context.preferences.system.ui_scale
    best = None
    for mark in marks:
        place = getattr(mark, half)
        if place is not None and (distance := float(np.linalg.norm(place - at))) <= radius:
            best, radius = (mark.index, place), distance
    return best


def landmark_at(marks: Sequence[Mark], at: np.ndarray) -> int | None:
    """Index of the landmark with a mark at a region pixel, image points first; ``None`` if there is none."""
    found = nearest(marks, "image", at) or nearest(marks, "surface", at)
    return None if found is None else found[0]
