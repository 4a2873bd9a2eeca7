"""A case comes into the scene, and what of the scene's its file lacks."""

from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import bpy

from ..class_registration import at_end
from ..pipeline.alignment.pose_uncertainty import PoseUncertainty
from ..pipeline.blender.alignment import alignment_scene
from ..pipeline.case.case_file import Case, read_case
from ..pipeline.case.case_update import differing_fields
from ..pipeline.case.loaded_case import LoadedCase, load_case
from ..pipeline.errors import InputError
from ..state import from_scene, pose_evidence, to_scene, workbench
from ..state.initial_pose import has_initial_pose, set_initial_pose
from ..state.scene_files import Stamp, known_stamp

_WORDS = {
    "mm_per_unit": "units",
    "image": "frame",
    "camera": "K",
    "distortion": "distortion",
    "mesh": "surface",
    "cam_from_mesh": "pose",
    "frames": "colour sources",
    "structures": "structures",
    "dataset": "dataset options",
    "landmarks": "landmarks",
    "light": "lamp",
}
"""Field of a case -> its name in the window; the record of the pose changes with the pose only."""


def saved_case(path: Path) -> Case:
    """The case as its file has it; it may have no pose."""
    return read_case(path, posed=False)


def lately_saved(path: Path) -> Case:
    """The same, read again when the file has changed, for drawing."""
    return _read(path, known_stamp(path))


@lru_cache(maxsize=1)
def _read(path: Path, _stamp: Stamp) -> Case:
    return saved_case(path)


def unsaved_parts(scene: bpy.types.Scene, read: Callable[[Path], Case] = saved_case) -> tuple[str, ...]:
    """The parts of the scene's case that its file lacks, in words; of a case without a file, all that was aligned."""
    if not from_scene.is_set_up(scene):
        return ()
    if not scene.oneframe.case_path:
        return _aligned_parts(scene)
    path = from_scene.absolute_path(scene.oneframe.case_path)
    try:
        saved = read(path)
    except InputError:
        return ("all of it",)
    try:
        current = from_scene.case(scene, Path(path))
        if not saved.posed and has_initial_pose(scene):
            saved = replace(saved, cam_from_mesh=current.cam_from_mesh)
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


def load_into_scene(context: bpy.types.Context, case: Case) -> LoadedCase:
    """Load a case into the workbench; the views stay as they are.

    Raises
    ------
    InputError
        A file of the case cannot be read; nothing has changed then.
    """
    loaded = load_case(case, aligned=False)
    scene = workbench.enter(context)
    to_scene.remember_case(scene, loaded, alignment_scene.set_up(scene, loaded))
    if not case.posed:
        set_initial_pose(scene, from_scene.surface_of(scene))
    record, pose = loaded.case.alignment, loaded.frame.cam_from_model
    mesh_from_model = loaded.surface.mesh_from_model
    uncertainty = PoseUncertainty.of_entry(record.table(), pose, mesh_from_model) if record.has_covariance else None
    # holds while the surface keeps that pose
    pose_evidence.remember(scene, record, pose, uncertainty)
    return loaded


PARTS = (at_end(_read.cache_clear),)
