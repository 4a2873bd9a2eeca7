"""What the image says of the pose: that of the last accepted refinement, kept to be solved with the landmarks.

It is stored in the surface apart from its pose, and holds for the frame and the K that it was found with: it survives
undo, .blend files, the case file and every change of the landmarks.
"""

import json
from collections.abc import Mapping
from dataclasses import asdict, replace
from typing import Any

import bpy
import numpy as np

from ..pipeline.alignment.pose_record import image_evidence_of, image_table
from ..pipeline.alignment.pose_uncertainty import PoseEvidence, PoseUncertainty
from ..pipeline.blender.alignment.surface_object import mesh_from_model_of
from ..pipeline.case.alignment_record import scaled_record
from ..pipeline.transforms import inverse_rigid
from . import from_scene

STORED = "oneframe_image_evidence"
"""Custom property of the surface: pose, uncertainty, record, frame and K as JSON."""


def hold(scene: bpy.types.Scene, image: PoseEvidence, record: dict[str, object]) -> None:
    """Keep what a refinement has found, with its record."""
    of = {"frame": scene.oneframe.frame_path, "camera": asdict(from_scene.camera(scene))}
    from_scene.surface_of(scene)[STORED] = json.dumps({**of, **_table(image, record)})


def restore(scene: bpy.types.Scene, record: Mapping[str, object], mesh_from_model: np.ndarray) -> None:
    """Keep what the record of a case that was opened says of the image, if anything."""
    found = image_evidence_of(record, from_scene.camera(scene))
    if found is not None:
        hold(scene, found[0].reframed(mesh_from_model), found[1])


def for_file(scene: bpy.types.Scene) -> dict[str, object]:
    """The key ``image`` of a case's record; nothing if nothing is kept."""
    if not (text := held(scene)):
        return {}
    image, record = parsed(text)
    model_from_mesh = inverse_rigid(mesh_from_model_of(from_scene.surface_of(scene)))
    return {"image": image_table(image.reframed(model_from_mesh), from_scene.camera(scene), record)}


def drop(scene: bpy.types.Scene) -> None:
    """Keep nothing of the image."""
    surface = from_scene.surface_of(scene)
    if STORED in surface:
        del surface[STORED]


def held(scene: bpy.types.Scene) -> str:
    """What is kept for the present frame and K, for :func:`parsed`; empty if nothing is.

    Raises
    ------
    InputError
        There is no camera or surface.
    """
    text = from_scene.surface_of(scene).get(STORED)
    if not isinstance(text, str):
        return ""
    stored = json.loads(text)
    is_present = stored["frame"] == scene.oneframe.frame_path and not scene.oneframe.aligned_path
    return text if is_present and stored["camera"] == asdict(from_scene.camera(scene)) else ""


def parsed(text: str) -> tuple[PoseEvidence, dict[str, object]]:
    """The evidence, and the record of the refinement, from what :func:`held` returns."""
    stored = json.loads(text)
    uncertainty = uncertainty_from(stored["uncertainty"])
    return PoseEvidence(np.array(stored["cam_from_model"]), uncertainty), stored["record"]


def rescale(surface: bpy.types.Object, factor: float) -> None:
    """Follow a surface that was scaled about the camera's centre."""
    if isinstance(text := surface.get(STORED), str):
        image, record = parsed(text)
        pose = image.cam_from_model.copy()
        pose[:3, 3] *= factor
        scaled = replace(image, cam_from_model=pose, uncertainty=image.uncertainty.scaled(factor))
        _replace(surface, text, scaled, scaled_record(record, factor))


def reframe(surface: bpy.types.Object, old_from_new: np.ndarray) -> None:
    """Follow a change of the frame ``model``; ``old_from_new`` is ``(4, 4)``, mm."""
    if isinstance(text := surface.get(STORED), str):
        image, record = parsed(text)
        _replace(surface, text, image.reframed(old_from_new), record)


def _replace(surface: bpy.types.Object, text: str, image: PoseEvidence, record: dict[str, object]) -> None:
    surface[STORED] = json.dumps({**json.loads(text), **_table(image, record)})


def _table(image: PoseEvidence, record: dict[str, object]) -> dict[str, Any]:
    uncertainty = uncertainty_table(image.uncertainty)
    return {"cam_from_model": image.cam_from_model.tolist(), "uncertainty": uncertainty, "record": record}


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
