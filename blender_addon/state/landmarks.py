"""The landmarks of a scene, in its frame ``model`` and in that of the mesh file.

Blender stores their points in single precision; while these are the rounded ones of the known case, they are its.
"""

from dataclasses import replace
from typing import Any

import bpy
import numpy as np
from numpy.typing import ArrayLike

from ..pipeline.blender.alignment.surface_object import mesh_from_model_of
from ..pipeline.case.landmarks import Landmark
from ..pipeline.transforms import inverse_rigid, transform_points
from . import events
from .known_case import known_case

POINT_DIGITS, PIXEL_DIGITS = 5, 4
"""Decimals of mm and px that a landmark has in files: those that Blender's single precision holds."""


def landmarks_model(scene: bpy.types.Scene) -> tuple[Landmark, ...]:
    """All landmarks as scripts read them from the saved case, points in the frame ``model``, mm."""
    surface, landmarks = scene.oneframe.surface, []
    for landmark in landmarks_mesh(scene):
        if landmark.point is not None and surface is not None:
            x, y, z = transform_points(inverse_rigid(mesh_from_model_of(surface)), np.array([landmark.point]))[
                0
            ].tolist()
            landmark = replace(landmark, point=(x, y, z))
        landmarks.append(landmark)
    return tuple(landmarks)


def landmarks_mesh(scene: bpy.types.Scene) -> tuple[Landmark, ...]:
    """All landmarks as files hold them, points in the frame of the mesh file, mm."""
    surface, known = scene.oneframe.surface, known_case(scene)
    mesh_from_model = np.eye(4) if surface is None else mesh_from_model_of(surface)
    as_read = {} if known is None else {landmark.name: landmark for landmark in known.landmarks}
    return tuple(_landmark(entry, as_read.get(entry.name), mesh_from_model) for entry in scene.oneframe.landmarks)


def _landmark(entry: Any, read: Landmark | None, mesh_from_model: np.ndarray) -> Landmark:
    """A landmark of the scene; ``read`` is that of the same name in the known case."""
    point = pixel = None
    if entry.has_point:
        point = read.point if read is not None else None
        stored = np.array([entry.point[:]])
        if point is None or not _are_rounded(
            stored, transform_points(inverse_rigid(mesh_from_model), np.array([point]))
        ):
            x, y, z = transform_points(mesh_from_model, stored.astype(float))[0].round(POINT_DIGITS).tolist()
            point = x, y, z
    if entry.has_pixel:
        pixel = read.pixel if read is not None else None
        if pixel is None or not _are_rounded(entry.pixel[:], pixel):
            pixel = round(entry.pixel[0], PIXEL_DIGITS), round(entry.pixel[1], PIXEL_DIGITS)
    return Landmark(entry.name, point, pixel, entry.enabled)


def _are_rounded(stored: ArrayLike, exact_values: ArrayLike) -> bool:
    """Whether Blender stores these values so, in single precision."""
    return np.array_equal(np.asarray(stored, np.float32), np.asarray(exact_values, np.float32))


def replace_landmarks(scene: bpy.types.Scene, landmarks: tuple[Landmark, ...]) -> None:
    """Replace all landmarks by these, given in the frame of the mesh file, mm; the pose stays."""
    settings = scene.oneframe
    model_from_mesh = np.eye(4)
    if settings.surface is not None:
        model_from_mesh = inverse_rigid(mesh_from_model_of(settings.surface))
    with events.muted():
        settings.landmarks.clear()
        for landmark in landmarks:
            entry = settings.landmarks.add()
            entry.name, entry.enabled = landmark.name, landmark.enabled
            entry.has_point, entry.has_pixel = landmark.point is not None, landmark.pixel is not None
            if landmark.point is not None:
                entry.point = transform_points(model_from_mesh, np.array([landmark.point]))[0]
            if landmark.pixel is not None:
                entry.pixel = landmark.pixel
        settings.landmark_index = 0
