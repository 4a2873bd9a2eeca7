"""Changes of landmarks, each told as one, whichever operator or gesture makes them."""

import bpy
import numpy as np

from ..pipeline.alignment.manual.picking import Half, landmark_for, new_name
from ..pipeline.case.landmarks import Landmark
from ..pipeline.errors import InputError
from ..state import events, from_scene


def landmarks_model(scene: bpy.types.Scene) -> tuple[Landmark, ...]:
    """All landmarks, points in the model frame, mm."""
    return tuple(
        Landmark(
            entry.name,
            (entry.point[0], entry.point[1], entry.point[2]) if entry.has_point else None,
            (entry.pixel[0], entry.pixel[1]) if entry.has_pixel else None,
            entry.enabled,
        )
        for entry in scene.oneframe.landmarks
    )


def checked_index(scene: bpy.types.Scene, index: int) -> int:
    """An index that exists; -1 stands for the active landmark.

    Raises
    ------
    InputError
        There is no such landmark.
    """
    settings = scene.oneframe
    found = settings.landmark_index if index == -1 else index
    count = len(settings.landmarks)
    if not 0 <= found < count:
        raise InputError(f"expected a landmark, found none with number {found + 1}; there are {count}")
    return found


def add(scene: bpy.types.Scene, name: str = "") -> int:
    """A new landmark without halves, made the active one; its index."""
    settings = scene.oneframe
    with events.untold():
        wanted = name or new_name(landmarks_model(scene))
        settings.landmarks.add().name = wanted
    settings.landmark_index = len(settings.landmarks) - 1
    return settings.landmark_index


def target(scene: bpy.types.Scene, half: Half) -> int:
    """The landmark that a newly picked half belongs to, made the active one; a new one if none waits for it."""
    found = landmark_for(half, landmarks_model(scene), scene.oneframe.landmark_index)
    if found is None:
        return add(scene)
    scene.oneframe.landmark_index = found
    return found


def set_halves(
    scene: bpy.types.Scene, index: int, *, point_model: np.ndarray | None = None, pixel: np.ndarray | None = None
) -> None:
    """Give a landmark one half or both, and tell."""
    entry = scene.oneframe.landmarks[index]
    if point_model is not None:
        entry.point, entry.has_point = point_model.tolist(), True
    if pixel is not None:
        entry.pixel, entry.has_pixel = pixel.tolist(), True
    events.landmarks_changed(scene)


def remove(scene: bpy.types.Scene, index: int) -> None:
    """Delete a landmark, and tell."""
    settings = scene.oneframe
    settings.landmarks.remove(index)
    settings.landmark_index = max(0, min(settings.landmark_index, len(settings.landmarks) - 1))
    events.landmarks_changed(scene)


def check_pixel(scene: bpy.types.Scene, pixel: np.ndarray) -> np.ndarray:
    """A pixel that lies in the frame, or :class:`InputError`."""
    camera = from_scene.camera(scene)
    if not camera.contains(pixel):
        raise InputError(
            f"expected an image point in the frame, {camera.width} x {camera.height} px, "
            f"found ({pixel[0]:.1f}, {pixel[1]:.1f}); click inside the frame"
        )
    return pixel
