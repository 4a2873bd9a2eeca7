"""What the present pose rests on, as far as it was found by something other than the landmarks: kept with its pose.

The record is a table ``[alignment]`` (:mod:`pipeline.case.alignment_record`). It is stored in the surface together with
the pose that it is about, and holds while the surface has exactly that pose: it survives undo and .blend files, and no
movement of the surface can leave it stale.
"""

import json
from dataclasses import asdict
from typing import Any

import bpy
import numpy as np

from ..pipeline.alignment.landmarks.covariance import PoseUncertainty
from ..pipeline.blender.bridge.exact_values import exact, set_exact
from . import from_scene

EVIDENCE, POSE = "oneframe_evidence", "oneframe_evidence_pose"
"""Custom properties of the surface: the record and the uncertainty as JSON, and the exact pose."""


def remember(
    scene: bpy.types.Scene,
    record: dict[str, object],
    cam_from_model: np.ndarray,
    uncertainty: PoseUncertainty | None = None,
) -> None:
    """Store what a pose ``(4, 4)``, mm, rests on; an empty record: it was given, nobody knows how it was found."""
    surface = from_scene.surface_of(scene)
    numbers = None
    if uncertainty is not None:
        numbers = {
            key: value.tolist() if isinstance(value, np.ndarray) else value
            for key, value in asdict(uncertainty).items()
        }
    surface[EVIDENCE] = json.dumps({"record": record, "uncertainty": numbers})
    set_exact(surface, POSE, cam_from_model)


def remembered(scene: bpy.types.Scene) -> dict[str, object] | None:
    """The record of the present pose, ``None`` if there is none.

    Raises
    ------
    InputError
        There is no pose.
    """
    stored = _stored(scene)
    return None if stored is None else stored["record"]


def remembered_uncertainty(scene: bpy.types.Scene) -> PoseUncertainty | None:
    """The uncertainty that was stored with the present pose, ``None`` if there is none.

    Raises
    ------
    InputError
        There is no pose.
    """
    stored = _stored(scene)
    if stored is None or stored["uncertainty"] is None:
        return None
    numbers: dict[str, Any] = {
        key: np.array(value) if isinstance(value, list) else float(value)
        for key, value in stored["uncertainty"].items()
    }
    return PoseUncertainty(**numbers)


def is_refined(scene: bpy.types.Scene) -> bool:
    """Whether the present pose was refined against the image: landmarks do not replace it unasked.

    Raises
    ------
    InputError
        There is no pose.
    """
    record = remembered(scene)
    return record is not None and record.get("method") == "refined"


def _stored(scene: bpy.types.Scene) -> dict | None:
    surface = from_scene.surface_of(scene)
    text, pose = surface.get(EVIDENCE), exact(surface, POSE)
    if not isinstance(text, str) or pose is None or not np.array_equal(pose, from_scene.cam_from_model(scene)):
        return None
    return json.loads(text)
