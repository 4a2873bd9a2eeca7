"""Pose and image points belong to the frame in which they were found; what becomes of them when another one comes."""

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import bpy
import numpy as np

from ..pipeline.blender.bridge.data_blocks import absolute_path
from ..pipeline.case.pose_record import OTHER_FRAME, UNKNOWN
from ..pipeline.errors import InputError
from ..pipeline.images.image_reader import read_image
from . import events, from_scene, pose_evidence


class SeenFrame(NamedTuple):
    """Another frame that the view shows at its own pose ``(4, 4)``, mm, if that is found; the text says how sure it is.

    The case's frame, pose and landmarks stay as they are.
    """

    name: str
    text: str
    cam_from_model: np.ndarray | None


finders: list[Callable[[bpy.types.Scene], SeenFrame | None]] = []
"""Say which other frame the view shows at its own pose; ``None`` for none."""


def seen(scene: bpy.types.Scene) -> SeenFrame | None:
    """The other frame that the view shows at its own pose; ``None`` while it shows the case's."""
    return next((found for find in finders if (found := find(scene)) is not None), None)


def check_own(scene: bpy.types.Scene) -> None:
    """Raise :class:`InputError` while the view shows another frame: what is done there would go to the case's own."""
    if (other := seen(scene)) is not None:
        raise InputError(f"expected the case's frame in the view, found {other.name}; press Back to Case Frame")


def leave_frame(scene: bpy.types.Scene, image: np.ndarray, valid: np.ndarray) -> bool:
    """Say whose pose and image points are, before a picture replaces the frame's.

    ``(H, W, 3)`` and ``(H, W)`` of the new picture are as :func:`.read_image` returns them.

    Returns
    -------
    Whether it is the same frame: the same picture, with or without a mask.
    """
    settings = scene.oneframe
    is_same = _shows(settings.frame_path, image, valid)
    if settings.aligned_path:
        if not is_same and _shows(settings.aligned_path, image, valid):
            settings.aligned_path = ""
    elif settings.frame_path and not is_same and _is_aligned(scene):
        settings.aligned_path = settings.frame_path
        pose_evidence.leave(scene)
    return is_same


def keep_pose(scene: bpy.types.Scene) -> None:
    """Start from the pose of the other frame, recorded as such; the landmarks keep their points of the surface.

    Raises
    ------
    InputError
        There is no pose.
    """
    record, pose = pose_evidence.remembered(scene), from_scene.cam_from_model(scene)
    if record is not None and record.method == OTHER_FRAME:
        pose_evidence.remember(scene, record, pose)
    scene.oneframe.aligned_path = ""
    with events.muted():
        for entry in scene.oneframe.landmarks:
            entry.has_pixel = False


def _shows(path: str, image: np.ndarray, valid: np.ndarray) -> bool:
    """Whether an image file has this picture, where neither is masked; not if it cannot be read any more."""
    if not path:
        return False
    try:
        before, shown = read_image(absolute_path(path), Path(path).name)
    except InputError:
        return False
    if before.shape != image.shape:
        return False
    both = shown & valid
    return bool(both.any()) and np.array_equal(before[both], image[both])


def _is_aligned(scene: bpy.types.Scene) -> bool:
    """Whether somebody has aligned the present frame: there are image points, or a pose that is no guess."""
    try:
        is_start = (pose_evidence.remembered(scene) or UNKNOWN).is_start
    except InputError:
        # nothing is set up, or the sidebar says what is wrong with the pose
        return False
    return not is_start or any(entry.has_pixel for entry in scene.oneframe.landmarks)
