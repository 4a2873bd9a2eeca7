"""How the current pose was found, for the record in the case file."""

import datetime
import json
from dataclasses import replace
from pathlib import Path

import bpy
import numpy as np

from ..landmarks import solve
from ..pipeline import __version__
from ..pipeline.alignment.landmarks.report import alignment_record
from ..pipeline.blender.bridge.exact_values import exact, set_exact
from ..pipeline.case.case_file import Case
from ..state import from_scene

REFINED, OPENED = "oneframe_refined_pose", "oneframe_opened_pose"
"""Custom properties of the surface: the pose found by the refinement, and the pose of the opened case."""


def recorded_case(scene: bpy.types.Scene, path: Path) -> Case:
    """The scene as a case (see :func:`.from_scene.case`) with the record of its pose."""
    return replace(from_scene.case(scene, path), alignment=pose_record(scene))


def pose_record(scene: bpy.types.Scene) -> dict[str, object]:
    """The table ``[alignment]`` of the case file."""
    tool, date = f"OneFrame {__version__}, Blender {bpy.app.version_string}", datetime.date.today().isoformat()
    surface, pose = from_scene.surface_of(scene), from_scene.cam_from_model(scene)
    opened, text = exact(surface, OPENED), scene.oneframe.case_alignment_text
    if text and opened is not None and np.array_equal(opened, pose):
        return json.loads(text)
    refined = exact(surface, REFINED)
    if refined is not None and np.array_equal(refined, pose):
        return {"method": "refined", "tool": tool, "date": date}
    solved = solve.solution(scene)
    if solved.alignment is None or solve.departure(scene, solved) is not None:
        return {"method": "manual", "tool": tool, "date": date}
    return alignment_record(solved.alignment, tool, date)


def remember_opened(scene: bpy.types.Scene, record: dict[str, object], cam_from_model: np.ndarray) -> None:
    """Store the opened case's record and pose ``(4, 4)``, mm: the record holds while the surface keeps that pose."""
    scene.oneframe.case_alignment_text = json.dumps(record) if record else ""
    set_exact(from_scene.surface_of(scene), OPENED, cam_from_model)


def remember_refined(scene: bpy.types.Scene, cam_from_model: np.ndarray) -> None:
    """Store a pose ``(4, 4)``, mm, as found by the refinement."""
    set_exact(from_scene.surface_of(scene), REFINED, cam_from_model)
