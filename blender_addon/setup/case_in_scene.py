"""A case comes into the scene, and what of the scene's its file lacks."""

from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import bpy

from ..class_registration import at_end
from ..pipeline.alignment.pose_uncertainty import PoseUncertainty
from ..pipeline.blender.alignment import alignment_scene
from ..pipeline.case.case_changes import differing_fields
from ..pipeline.case.case_file import Case, read_case
from ..pipeline.case.loaded_case import LoadedCase, load_case
from ..pipeline.case.pose_record import UNKNOWN
from ..pipeline.errors import InputError
from ..state import from_scene, pose_evidence, to_scene, workbench
from ..state.initial_pose import set_initial_pose
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
    "refused": "refusal",
}
"""Field of a case -> its name in the window; the record of the pose changes with the pose only."""


@lru_cache(maxsize=1)
def _saved(path: Path, _stamp: Stamp) -> Case:
    return read_case(path, posed=False)


def unsaved_parts(scene: bpy.types.Scene) -> tuple[str, ...]:
    """The parts of the scene's case that its file lacks, in words; looks at the file again once it has changed."""
    if not from_scene.is_set_up(scene) or not scene.oneframe.case_path:
        return ()
    path = from_scene.absolute_path(scene.oneframe.case_path)
    try:
        saved = _saved(path, known_stamp(path))
    except InputError:
        return ("all of it",)
    try:
        current = from_scene.case(scene, path)
        if not saved.posed and (pose_evidence.remembered(scene) or UNKNOWN).is_start:
            saved = replace(saved, cam_from_mesh=current.cam_from_mesh, posed=True)
    except InputError:
        # a surface that is scaled, or a frame of another size
        return ("pose",)
    return tuple(_WORDS[name] for name in differing_fields(saved, current) if name in _WORDS)


def load_into_scene(context: bpy.types.Context, case: Case) -> LoadedCase:
    """Load a case into the workbench; the views stay as they are."""
    loaded = load_case(case, aligned=False)
    scene = workbench.enter(context)
    to_scene.remember_case(scene, loaded, alignment_scene.set_up(scene, loaded))
    record, pose = loaded.case.alignment, loaded.frame.cam_from_model
    mesh_from_model = loaded.surface.mesh_from_model
    uncertainty = PoseUncertainty.of_entry(record.table(), pose, mesh_from_model) if record.has_covariance else None
    # holds while the surface keeps that pose
    pose_evidence.remember(scene, record, pose, uncertainty)
    if not case.posed:
        set_initial_pose(scene)
    return loaded


PARTS = (at_end(_saved.cache_clear),)
