"""The landmarks of a scene. Blender stores their points as files do: in the frame and units of the mesh file."""

from dataclasses import replace

import bpy
import numpy as np

from ..pipeline.blender.alignment.surface_object import mesh_from_model_of
from ..pipeline.case.case_file import MM_PER_UNIT
from ..pipeline.case.landmarks import Landmark
from ..pipeline.transforms import inverse_rigid, transform_points
from . import events

POINT_DIGITS, PIXEL_DIGITS = 5, 4
"""Decimals of mm and px that a landmark has in files: those that Blender's single precision holds."""


def landmarks_mesh(scene: bpy.types.Scene) -> tuple[Landmark, ...]:
    """All landmarks as files hold them, points in the frame of the mesh file, mm."""
    mm_per_unit, landmarks = MM_PER_UNIT[scene.oneframe.units], []
    for entry in scene.oneframe.landmarks:
        point = pixel = None
        if entry.has_point:
            x, y, z = (round(mm_per_unit * value, POINT_DIGITS) for value in entry.point)
            point = x, y, z
        if entry.has_pixel:
            pixel = round(entry.pixel[0], PIXEL_DIGITS), round(entry.pixel[1], PIXEL_DIGITS)
        landmarks.append(Landmark(entry.name, point, pixel, entry.enabled))
    return tuple(landmarks)


def landmarks_model(scene: bpy.types.Scene) -> tuple[Landmark, ...]:
    """All landmarks, points in the frame ``model``, mm."""
    model_from_mesh, landmarks = inverse_rigid(_mesh_from_model(scene)), []
    for landmark in landmarks_mesh(scene):
        if landmark.point is not None:
            x, y, z = transform_points(model_from_mesh, np.array(landmark.point)).tolist()
            landmark = replace(landmark, point=(x, y, z))
        landmarks.append(landmark)
    return tuple(landmarks)


def points_model(scene: bpy.types.Scene) -> np.ndarray:
    """``(N, 3)`` the surface point of every landmark, model frame, mm; means nothing for one without."""
    points = np.array([entry.point[:] for entry in scene.oneframe.landmarks], float).reshape(-1, 3)
    return transform_points(inverse_rigid(_mesh_from_model(scene)), MM_PER_UNIT[scene.oneframe.units] * points)


def point_of_file(scene: bpy.types.Scene, point_model: np.ndarray) -> np.ndarray:
    """``(3,)`` of a point (model frame, mm), in the frame and units of the mesh file."""
    return transform_points(_mesh_from_model(scene), point_model) / MM_PER_UNIT[scene.oneframe.units]


def _mesh_from_model(scene: bpy.types.Scene) -> np.ndarray:
    surface = scene.oneframe.surface
    return np.eye(4) if surface is None else mesh_from_model_of(surface)


def replace_landmarks(scene: bpy.types.Scene, landmarks: tuple[Landmark, ...]) -> None:
    """Replace all landmarks by these, given in the frame of the mesh file, mm; the pose stays."""
    settings = scene.oneframe
    with events.muted():
        settings.landmarks.clear()
        for landmark in landmarks:
            entry = settings.landmarks.add()
            entry.name, entry.enabled = landmark.name, landmark.enabled
            entry.has_point, entry.has_pixel = landmark.point is not None, landmark.pixel is not None
            if landmark.point is not None:
                entry.point = [value / MM_PER_UNIT[settings.units] for value in landmark.point]
            if landmark.pixel is not None:
                entry.pixel = landmark.pixel
        settings.landmark_index = 0
