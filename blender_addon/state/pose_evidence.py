"""What the present pose rests on, as far as it was found by something other than the landmarks: kept with its pose.

The record (:class:`.PoseRecord`) is stored with the pose that it is about, in the frame and units of the mesh file, and
holds while the surface has that pose: it survives undo, .blend files and other units, and is never stale.
"""

import json
from dataclasses import asdict, replace
from typing import Any

import bpy
import numpy as np

from ..pipeline.alignment.pose_uncertainty import PoseUncertainty
from ..pipeline.blender.alignment.surface_object import mesh_from_model_of
from ..pipeline.case.case_file import MM_PER_UNIT
from ..pipeline.case.pose_record import PoseRecord
from ..pipeline.transforms import inverse_rigid, is_same_pose, transform_points
from . import from_scene


def remember(
    scene: bpy.types.Scene,
    record: PoseRecord,
    cam_from_model: np.ndarray,
    uncertainty: PoseUncertainty | None = None,
) -> None:
    """Store what a pose ``(4, 4)``, mm, rests on; an empty record: it was given, nobody knows how it was found."""
    mesh_from_model, numbers = mesh_from_model_of(from_scene.surface_of(scene)), None
    if uncertainty is not None:
        pivot = transform_points(mesh_from_model, uncertainty.pivot_model)
        numbers = {
            key: value.tolist() if isinstance(value, np.ndarray) else value
            for key, value in asdict(replace(uncertainty, pivot_model=pivot)).items()
        }
    scene.oneframe.evidence = json.dumps(
        {
            "mm_per_unit": MM_PER_UNIT[scene.oneframe.units],
            "cam_from_mesh": (cam_from_model @ inverse_rigid(mesh_from_model)).tolist(),
            "record": record.table(),
            "uncertainty": numbers,
        }
    )


def record_of(scene: bpy.types.Scene, cam_from_model: np.ndarray) -> PoseRecord | None:
    """What is stored about a pose ``(4, 4)``, mm, of the surface; ``None`` if nothing is."""
    stored = _stored(scene, cam_from_model)
    return None if stored is None else stored[0]


def remembered(scene: bpy.types.Scene) -> PoseRecord | None:
    """The record of the present pose, ``None`` if there is none."""
    return record_of(scene, from_scene.cam_from_model(scene))


def remembered_uncertainty(scene: bpy.types.Scene) -> PoseUncertainty | None:
    """The uncertainty that was stored with the present pose, ``None`` if there is none."""
    stored = _stored(scene, from_scene.cam_from_model(scene))
    return None if stored is None else stored[1]


def is_refined(scene: bpy.types.Scene) -> bool:
    """Whether the image or other frames found the pose: landmarks do not replace it unasked."""
    record = remembered(scene)
    return record is not None and record.is_from_image


def _stored(scene: bpy.types.Scene, cam_from_model: np.ndarray) -> tuple[PoseRecord, PoseUncertainty | None] | None:
    """Record and uncertainty (model frame) of a pose, if what is stored is about it."""
    settings = scene.oneframe
    if not settings.evidence:
        return None
    stored: dict[str, Any] = json.loads(settings.evidence)
    mesh_from_model = mesh_from_model_of(from_scene.surface_of(scene))
    factor, pose = MM_PER_UNIT[settings.units] / stored["mm_per_unit"], np.array(stored["cam_from_mesh"])
    pose[:3, 3] *= factor
    if not is_same_pose(pose, cam_from_model @ inverse_rigid(mesh_from_model)):
        return None
    record, uncertainty = PoseRecord.of_table(stored["record"], "the record of the pose").scaled(factor), None
    if stored["uncertainty"] is not None:
        numbers: dict[str, Any] = {
            key: np.array(value) if isinstance(value, list) else float(value)
            for key, value in stored["uncertainty"].items()
        }
        scaled = PoseUncertainty(**numbers).scaled(factor)
        pivot = transform_points(inverse_rigid(mesh_from_model), scaled.pivot_model)
        uncertainty = replace(scaled, pivot_model=pivot)
    return record, uncertainty
