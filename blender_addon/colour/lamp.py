"""The lamp at the lens, found for the case."""

from collections.abc import Callable
from dataclasses import replace

import bpy

from ..frames import film_poses
from ..pipeline.errors import InputError
from ..pipeline.light.find_lamp import FoundLamp, find_lamp
from ..pipeline.light.lens_light import LensLight
from ..pipeline.registration.pose_list import AcceptedFrames, small_frames
from ..pipeline.registration.register import accepted_poses
from ..setup.alignment_record import tool_and_date
from ..state import from_scene
from ..state.case_of_file import UNNAMED, case_of_file, keep_case_of_file, lamp_of
from ..ui.background_operator import InBackground, Work, check_inputs, inputs_of
from ..ui.operator import Messages, NeedsAlignment
from ..video import session


class ONEFRAME_OT_find_lamp(NeedsAlignment, InBackground):
    """Find the lamp at the lens from the shading of the frame and of the film's frames that are found. Esc stops it"""

    bl_label = "Find Lamp"
    # without REGISTER: Adjust Last Operation would do it all again
    bl_options = {"UNDO"}
    doing = "Finding the lamp at the lens"

    def work(self, context: bpy.types.Context) -> Work:
        scene = context.scene
        loaded, accepted, known = from_scene.loaded_case(scene), _accepted(scene), lamp_of(scene)
        self._inputs, self._is_alone = inputs_of(scene), accepted is None and len(loaded.frames) == 1

        def find(progress: Callable[[float], None]) -> FoundLamp:
            frames = small_frames(loaded, accepted)
            progress(0.3)
            return find_lamp(loaded.surface.mesh, frames, known.transfer if known else "srgb")

        return find

    def finish(self, context: bpy.types.Context, result: FoundLamp) -> Messages:
        check_inputs(context.scene, self._inputs)
        if result.objection:
            more = "; open its film and press Register Frames first" if self._is_alone else ""
            raise InputError(f"{result.objection}{more}")
        keep_lamp(context.scene, result.recorded(*tool_and_date()))
        return (f"{result.figures}; Save Case keeps it",)


def _accepted(scene: bpy.types.Scene) -> AcceptedFrames | None:
    """The frames of the scene's film that are found."""
    film, registered = session.of(scene), film_poses.of(scene)
    poses = {} if registered is None else accepted_poses(registered.frames)
    return AcceptedFrames(poses, film.path) if film is not None and poses else None


def keep_lamp(scene: bpy.types.Scene, light: LensLight | None) -> None:
    """Let the scene's case have a lamp at the lens, or none."""
    keep_case_of_file(scene, replace(case_of_file(scene) or from_scene.case(scene, UNNAMED), light=light))
