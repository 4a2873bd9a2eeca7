"""What the present pose rests on, as far as it was found by something other than the landmarks: kept with its pose.

The record (:class:`.PoseRecord`) is stored in the surface together with
the pose that it is about, and holds while the surface has exactly that pose: it survives undo and .blend files, and no
movement of the surface can leave it stale.
"""

import json
from dataclasses import asdict, replace
from typing import Any

import bpy
import numpy as np

from ..pipeline.alignment.pose_uncertainty import PoseUncertainty
from ..pipeline.blender.bridge.data_blocks import exact, set_exact
from ..pipeline.case.pose_record import OTHER_FRAME, PoseRecord
from ..pipeline.transforms import inverse_rigid, transform_points
from . import from_scene

EVIDENCE, POSE = "oneframe_evidence", "oneframe_evidence_pose"
"""Custom properties of the surface: the record and the uncertainty as JSON, and the exact pose."""
LEFT_POSE = "oneframe_left_pose"
"""Custom property of the surface: the pose that it had when another frame came."""


def remember(
    scene: bpy.types.Scene,
    record: PoseRecord,
    cam_from_model: np.ndarray,
    uncertainty: PoseUncertainty | None = None,
) -> None:
    """Store what a pose ``(4, 4)``, mm, rests on; an empty record: it was given, nobody knows how it was found."""
    _store(from_scene.surface_of(scene), record, cam_from_model, uncertainty)


def rescale(surface: bpy.types.Object, factor: float) -> None:
    """Follow a surface that was scaled about the camera's centre: its pixels, and so what the pose rests on, stay."""
    stored, pose = _read(surface)
    if stored is None or pose is None:
        return
    pose[:3, 3] *= factor
    uncertainty = _uncertainty(stored)
    _store(surface, _record(stored).scaled(factor), pose, None if uncertainty is None else uncertainty.scaled(factor))


def reframe(surface: bpy.types.Object, old_from_new: np.ndarray) -> None:
    """Follow a change of the frame ``model``; ``old_from_new`` is ``(4, 4)``, mm."""
    left = exact(surface, LEFT_POSE)
    if left is not None:
        set_exact(surface, LEFT_POSE, left @ old_from_new)
    stored, pose = _read(surface)
    if stored is None or pose is None:
        return
    uncertainty = _uncertainty(stored)
    if uncertainty is not None:
        pivot = transform_points(inverse_rigid(old_from_new), uncertainty.pivot_model[None])[0]
        uncertainty = replace(uncertainty, pivot_model=pivot)
    _store(surface, _record(stored), pose @ old_from_new, uncertainty)


def remembered(scene: bpy.types.Scene) -> PoseRecord | None:
    """The record of the present pose, ``None`` if there is none.

    Raises
    ------
    InputError
        There is no pose.
    """
    if _is_left(scene):
        name = bpy.path.basename(scene.oneframe.aligned_path)
        return PoseRecord(OTHER_FRAME, doubt=f"found in another frame ({name})")
    stored = _stored(scene)
    return None if stored is None else _record(stored)


def remembered_uncertainty(scene: bpy.types.Scene) -> PoseUncertainty | None:
    """The uncertainty that was stored with the present pose, ``None`` if there is none.

    Raises
    ------
    InputError
        There is no pose.
    """
    stored = None if _is_left(scene) else _stored(scene)
    return None if stored is None else _uncertainty(stored)


def is_refined(scene: bpy.types.Scene) -> bool:
    """Whether the image or other frames found the pose: landmarks do not replace it unasked.

    Raises
    ------
    InputError
        There is no pose.
    """
    record = remembered(scene)
    return record is not None and record.is_from_image


def _is_left(scene: bpy.types.Scene) -> bool:
    """Whether the present pose is that of another frame, and nobody has moved the surface in this one."""
    left = exact(from_scene.surface_of(scene), LEFT_POSE)
    if left is None or not scene.oneframe.aligned_path:
        return False
    return np.array_equal(left, from_scene.cam_from_model(scene))


def _stored(scene: bpy.types.Scene) -> dict[str, Any] | None:
    """What is stored about the present pose."""
    stored, pose = _read(from_scene.surface_of(scene))
    return stored if pose is not None and np.array_equal(pose, from_scene.cam_from_model(scene)) else None


def _read(surface: bpy.types.Object) -> tuple[dict[str, Any] | None, np.ndarray | None]:
    """Record and uncertainty, and the pose ``(4, 4)`` that they are about."""
    text, pose = surface.get(EVIDENCE), exact(surface, POSE)
    return (json.loads(text) if isinstance(text, str) else None), pose


def _store(
    surface: bpy.types.Object,
    record: PoseRecord,
    cam_from_model: np.ndarray,
    uncertainty: PoseUncertainty | None,
) -> None:
    numbers = None if uncertainty is None else uncertainty_table(uncertainty)
    surface[EVIDENCE] = json.dumps({"record": record.table(), "uncertainty": numbers})
    set_exact(surface, POSE, cam_from_model)


def _record(stored: dict[str, Any]) -> PoseRecord:
    return PoseRecord.of_table(stored["record"], "the surface's record")


def _uncertainty(stored: dict[str, Any]) -> PoseUncertainty | None:
    return None if stored["uncertainty"] is None else uncertainty_from(stored["uncertainty"])


def uncertainty_table(uncertainty: PoseUncertainty) -> dict[str, Any]:
    """An uncertainty for JSON."""
    return {
        key: value.tolist() if isinstance(value, np.ndarray) else value for key, value in asdict(uncertainty).items()
    }


def uncertainty_from(table: dict[str, Any]) -> PoseUncertainty:
    """From :func:`uncertainty_table`."""
    numbers: dict[str, Any] = {
        key: np.array(value) if isinstance(value, list) else float(value) for key, value in table.items()
    }
    return PoseUncertainty(**numbers)
