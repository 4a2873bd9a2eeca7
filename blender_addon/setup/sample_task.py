"""The task that the sample sets, and how far the user's pose is from the true one."""

from functools import lru_cache
from pathlib import Path

import bpy
import numpy as np

from ..class_registration import at_end, class_registration
from ..pipeline.blender.alignment.surface_object import mesh_from_model_of
from ..pipeline.case.case_file import read_case
from ..pipeline.errors import InputError
from ..pipeline.files.numbers import format_two_digits
from ..pipeline.transforms import transform_points
from ..state import from_scene
from ..state.initial_pose import has_initial_pose
from ..state.scene_files import Stamp, known_stamp
from ..ui.keymap import binding
from .open_case import TRUE, UNALIGNED

COMPARED = 20_000
"""Vertices at which the poses are compared where the frame shows them: a drag draws this again and again."""


def task_lines(scene: bpy.types.Scene) -> tuple[str, ...]:
    """The task in four lines; nothing in a user's own case.

    Raises
    ------
    InputError
        There is no camera or surface, or no valid pose.
    """
    path = Path(bpy.path.abspath(scene.oneframe.case_path))
    true = path.parent / TRUE
    if path.name != UNALIGNED or known_stamp(true) == (0, 0):
        return ()
    error = "as soon as the bone has moved, this line says how far it is from its true pose"
    if not has_initial_pose(scene):
        off_px = _off_px(scene, true, known_stamp(true))
        error = f"the bone is {format_two_digits(off_px)} px from its true pose, in the median"
    refine = binding("oneframe.refine") or "Refine Against Image"
    return (
        "The sample: lay the bone over the frame, where the frame shows it",
        "1  Drag three points of the bone, far apart, each to its place in the frame",
        f"2  {refine} refines the pose against the frame, Enter keeps it; then Save Case",
        f"3  Below 1 px it is done: {error}",
    )


def _off_px(scene: bpy.types.Scene, true: Path, stamp: Stamp) -> float:
    """Median distance between the pixels of the surface at the present and at the true pose."""
    camera, mesh = from_scene.camera(scene), from_scene.surface_in_file(scene)
    true_pose = _true_pose(true, stamp) @ mesh_from_model_of(from_scene.surface_of(scene))
    points = mesh.vertices[:: max(1, len(mesh.vertices) // COMPARED)]
    pixels = camera.project(transform_points(true_pose, points))
    shown = np.flatnonzero(((pixels >= 0) & (pixels < camera.size_wh)).all(axis=1))
    if len(shown) == 0:
        raise InputError(f"{true}: expected the sample's own camera, found one that does not show the surface")
    found = camera.project(transform_points(from_scene.cam_from_model(scene), points[shown]))
    return float(np.median(np.linalg.norm(found - pixels[shown], axis=1)))


@lru_cache(maxsize=1)
def _true_pose(path: Path, _stamp: Stamp) -> np.ndarray:
    return read_case(path).cam_from_mesh


register, unregister = class_registration(__name__, at_end(_true_pose.cache_clear))
