"""Operators that open a case, or the sample."""

import shutil
from functools import lru_cache
from pathlib import Path

import bpy
import numpy as np
from bpy.props import StringProperty

from ..class_registration import at_end, prop
from ..pipeline.blender.alignment.surface_object import mesh_from_model_of
from ..pipeline.case.case_file import read_case
from ..pipeline.errors import InputError
from ..pipeline.files.numbers import format_two_digits
from ..pipeline.transforms import transform_points
from ..state import from_scene
from ..state.camera_view import look_through_camera, show_shape
from ..state.initial_pose import is_initial
from ..state.scene_files import Stamp, known_stamp, own_folder
from ..ui.keymap import binding
from ..ui.operator import Messages, OpensFile, Reporting, call
from . import history

SHIPPED = Path(__file__).resolve().parents[1] / "sample"
"""The sample in the built extension; a checkout has none."""

TRUE, UNALIGNED = "case.toml", "unaligned.toml"
"""Its case files: with the pose of its frame, and without, for the user to find."""

COMPARED = 20_000
"""Vertices at which the poses are compared where the frame shows them: a drag draws this again and again."""


class ONEFRAME_OT_open_case(OpensFile):
    """Open a case file: frame, K, surface, structures, pose and landmarks; the history keeps the present one's pose"""

    bl_label = "Open Case"

    filter_glob: str = prop(StringProperty, default="*.toml", options={"HIDDEN"})

    def run(self, context: bpy.types.Context) -> Messages:
        path = self.chosen_file()
        loaded = history.load(context, path)
        show_shape(context)
        look_through_camera(context)
        width, height = loaded.case.camera.size_wh
        return (
            *loaded.messages,
            f"{self.filepath}: frame {width} x {height} px, {len(loaded.surface.mesh.faces)} triangles",
        )


class ONEFRAME_OT_open_sample(Reporting):
    """Open the sample case: a drilled temporal bone with its frame, K and structures, to be aligned"""

    bl_label = "Open Sample Case"

    def run(self, context: bpy.types.Context) -> None:
        call("open_case", filepath=str(copied_sample(own_folder("sample")) / UNALIGNED))


def copied_sample(folder: Path) -> Path:
    """Copy the sample into a folder, unless it is there; files that exist stay as the user left them."""
    if not SHIPPED.is_dir():
        raise InputError(
            f"{SHIPPED}: expected the sample case of the built extension, found none; "
            "make it with `oneframe sample`, and open its case.toml"
        )
    for source in sorted(SHIPPED.rglob("*")):
        target = folder / source.relative_to(SHIPPED)
        if source.is_dir():
            target.mkdir(parents=True, exist_ok=True)
        elif not target.exists():
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(source, target)
    return folder


def task_lines(scene: bpy.types.Scene) -> tuple[str, ...]:
    """The task in four lines; nothing in a user's own case."""
    path = Path(bpy.path.abspath(scene.oneframe.case_path))
    true = path.parent / TRUE
    if path.name != UNALIGNED or known_stamp(true) == (0, 0):
        return ()
    error = "as soon as the bone has moved, this line says how far it is from its true pose"
    if not is_initial(scene, from_scene.cam_from_model(scene)):
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


PARTS = (at_end(_true_pose.cache_clear),)
