"""What would be lost if another case were opened now: the parts of the case that its file lacks."""

from pathlib import Path

import bpy

from ..pipeline.case.case_file import read_case
from ..pipeline.case.case_update import differing_fields
from ..pipeline.errors import InputError
from ..state import from_scene
from ..state.initial_pose import has_initial_pose

QUESTION, ANSWER = "Open Another Case?", "Open Without Saving"

_WORDS = {
    "mm_per_unit": "units",
    "image": "frame",
    "camera": "K",
    "distortion": "distortion",
    "mesh": "surface",
    "cam_from_mesh": "pose",
    "structures": "structures",
    "dataset": "dataset options",
    "landmarks": "landmarks",
}
"""Field of a case -> its name in the window; the record of the pose changes with the pose only."""


def unsaved_parts(scene: bpy.types.Scene) -> tuple[str, ...]:
    """The parts of the scene's case that its file lacks, in words; of a case without a file, all that was aligned."""
    if not from_scene.is_set_up(scene):
        return ()
    if not scene.oneframe.case_path:
        return _aligned_parts(scene)
    path = from_scene.absolute_path(scene.oneframe.case_path)
    try:
        saved = read_case(path)
    except InputError:
        return ("all of it",)
    try:
        current = from_scene.case(scene, Path(path))
    except InputError:
        # a surface that is scaled, or a frame of another size
        return ("pose",)
    return tuple(_WORDS[name] for name in differing_fields(saved, current) if name in _WORDS)


def unsaved_text(scene: bpy.types.Scene) -> str:
    """The question before the case is replaced; empty if nothing would be lost."""
    parts = unsaved_parts(scene)
    if not parts:
        return ""
    listed = parts[0] if len(parts) == 1 else ", ".join(parts[:-1]) + " and " + parts[-1]
    if not scene.oneframe.case_path:
        return f"Never saved: {listed}. Open another case without saving?"
    name = bpy.path.basename(scene.oneframe.case_path)
    return f"Changes that {name} lacks: {listed}. Open another case without saving?"


def _aligned_parts(scene: bpy.types.Scene) -> tuple[str, ...]:
    parts = ["landmarks"] if len(scene.oneframe.landmarks) else []
    try:
        is_initial = has_initial_pose(scene)
    except InputError:
        is_initial = False
    return tuple(parts if is_initial else ["pose", *parts])
