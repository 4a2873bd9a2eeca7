"""Pose and image points belong to the frame in which they were found; what becomes of them when another one comes."""

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import bpy
import numpy as np

from ..pipeline.blender.bridge.data_blocks import absolute_path
from ..pipeline.case.pose_record import OTHER_FRAME, UNKNOWN, PoseRecord
from ..pipeline.errors import InputError
from ..pipeline.images.image_reader import read_image
from . import events, from_scene, pose_evidence


class FrameInView(NamedTuple):
    """Another frame that the view shows at its own pose ``(4, 4)``, mm, if that is found; the text says how sure it is.

    The case's frame, pose and landmarks stay as they are.
    """

    name: str
    text: str
    cam_from_model: np.ndarray | None


lookups: list[Callable[[bpy.types.Scene], FrameInView | None]] = []
"""Say which other frame the view shows at its own pose; ``None`` for none."""


def other(scene: bpy.types.Scene) -> FrameInView | None:
    """The other frame that the view shows at its own pose; ``None`` while it shows the case's."""
    return next((found for find in lookups if (found := find(scene)) is not None), None)


def check_own(scene: bpy.types.Scene) -> None:
    """Raise :class:`InputError` while the view shows another frame: what is done there would go to the case's own."""
    if (shown := other(scene)) is not None:
        raise InputError(f"expected the case's frame in the view, found {shown.name}; press Back to Case Frame")


leaving: list[Callable[[], None]] = []
"""Called before another frame takes the place of an aligned one: what was found in that goes to its history."""


def leave_frame(scene: bpy.types.Scene, image: np.ndarray, valid: np.ndarray) -> bool:
    """Make the pose a start, recorded as such, and take the image points away, unless the picture is the frame's own.

    ``(H, W, 3)`` and ``(H, W)`` of the new picture are as :func:`.read_image` returns them; the landmarks keep their
    points of the surface.

    Returns
    -------
    Whether it is the same frame: the same picture, with or without a mask.
    """
    settings = scene.oneframe
    if _shows(settings.frame_path, image, valid):
        return True
    if settings.frame_path and _is_aligned(scene):
        for call in leaving:
            call()
        name = bpy.path.basename(settings.frame_path)
        record = PoseRecord(OTHER_FRAME, doubt=f"found in another frame ({name})")
        pose_evidence.remember(scene, record, from_scene.cam_from_model(scene))
        with events.muted():
            for entry in settings.landmarks:
                entry.has_pixel = False
    return False


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
