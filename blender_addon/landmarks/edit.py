"""Edits of the landmarks, shared by operators and gestures; listeners are notified once per edit."""

import bpy
import numpy as np

from ..pipeline.alignment.manual.picking import Half, landmark_for, new_name
from ..pipeline.errors import InputError
from ..state import events, from_scene
from ..state.landmarks import landmarks_model, point_of_file


def checked_index(scene: bpy.types.Scene, index: int) -> int:
    """Return the index of an existing landmark; -1 means the active one."""
    settings = scene.oneframe
    found = settings.landmark_index if index == -1 else index
    count = len(settings.landmarks)
    if not 0 <= found < count:
        raise InputError(f"expected the index of a landmark, found {found}; there are {count} landmarks, from index 0")
    return found


def add(scene: bpy.types.Scene) -> int:
    """Add a landmark without points, make it the active one and return its index."""
    settings = scene.oneframe
    with events.muted():
        unused_name = new_name(landmarks_model(scene))
        settings.landmarks.add().name = unused_name
    settings.landmark_index = len(settings.landmarks) - 1
    return settings.landmark_index


def landmark_for_pick(scene: bpy.types.Scene, half: Half) -> int:
    """Index of the landmark that a newly picked point belongs to, which becomes active; adds one if none lacks it."""
    found = landmark_for(half, landmarks_model(scene), scene.oneframe.landmark_index)
    if found is None:
        return add(scene)
    scene.oneframe.landmark_index = found
    return found


def set_halves(
    scene: bpy.types.Scene, index: int, *, point_model: np.ndarray | None = None, pixel: np.ndarray | None = None
) -> None:
    """Set a landmark's surface point ``(3,)``, model frame, mm, its pixel ``(2,)`` or both, and notify listeners."""
    entry = scene.oneframe.landmarks[index]
    if point_model is not None:
        entry.point, entry.has_point = point_of_file(scene, point_model).tolist(), True
    if pixel is not None:
        entry.pixel, entry.has_pixel = pixel.tolist(), True
    events.landmarks_changed(scene)


def remove(scene: bpy.types.Scene, index: int) -> None:
    """Delete a landmark, and notify listeners."""
    settings = scene.oneframe
    settings.landmarks.remove(index)
    settings.landmark_index = max(0, min(settings.landmark_index, len(settings.landmarks) - 1))
    events.landmarks_changed(scene)


def check_pixel(scene: bpy.types.Scene, pixel: np.ndarray) -> np.ndarray:
    """Return a pixel ``(2,)`` of the frame; raise :class:`InputError` if it lies outside."""
    camera = from_scene.camera(scene)
    if not camera.contains(pixel):
        raise InputError(
            f"expected an image point in the frame of {camera.width} x {camera.height} px, "
            f"found ({pixel[0]:.1f}, {pixel[1]:.1f}); stay inside the frame"
        )
    return pixel
