"""Operators that register the frames of the film, and go back to the case's."""

from dataclasses import replace
from functools import partial
from typing import Any

import bpy

from ..pipeline.case.loaded_case import LoadedCase
from ..pipeline.errors import InputError
from ..pipeline.registration.register import Registrar
from ..setup.alignment_record import is_start, pose_record
from ..state import from_scene
from ..state.scene_files import forget_stamps
from ..ui.background_operator import InBackground, Work
from ..ui.keymap import TOOLS, Key, keys
from ..ui.operator import Available, Messages, Needs, OperatorResult
from ..video import session, shown_frame
from ..video.operators import NeedsFilm
from . import film_poses


def is_aligned(scene: bpy.types.Scene) -> bool:
    """Whether somebody has aligned the case's frame, from which the others are registered."""
    try:
        return from_scene.is_set_up(scene) and not is_start(scene)
    except InputError:
        return False


def recorded_case(scene: bpy.types.Scene) -> LoadedCase:
    """The case with the record of its pose, which says how sure it is."""
    loaded = from_scene.loaded_case(scene)
    return replace(loaded, case=replace(loaded.case, alignment=pose_record(scene)))


class NeedsFrames(NeedsFilm):
    """Mixin: available with a film and an aligned frame."""

    needs = (lambda context: is_aligned(context.scene), "Align the case's frame first")


class NeedsFound(NeedsFilm):
    """Mixin: available once frames of the film are registered."""

    needs: Needs = (lambda context: film_poses.of(context.scene) is not None, "Press Register Frames first")


class ONEFRAME_OT_register_frames(NeedsFrames, InBackground):
    """Find the poses of the film's frames by what the case's frame shows; those that are found stay. Esc stops it"""

    bl_label = "Register Frames"
    bl_options = {"REGISTER"}
    doing = "Registering the frames"
    stopped = "the frames found so far are kept, Register Frames goes on with the others"

    def work(self, context: bpy.types.Context) -> Work:
        scene, self._film = context.scene, session.scored(context.scene)
        # may render: in the main thread
        registrar = Registrar(recorded_case(scene))
        self._found = film_poses.begun(scene, self._film)
        scene.oneframe_video.visible = True
        shown_frame.restore(scene)
        return partial(self._found.register, registrar, self._film)

    def so_far(self) -> str:
        return self._found.summary()

    def finish(self, context: bpy.types.Context, result: Any) -> Messages:
        forget_stamps()
        return (f"{self._film.path.name}: {self._found.summary()}",)


class ONEFRAME_OT_case_frame(Available):
    """Show the case's own frame again; looking at others has changed nothing of it"""

    bl_label = "Back to Case Frame"
    bl_options = {"REGISTER"}

    needs = (lambda context: shown_frame.is_shown(context.scene), "The view shows the case's frame")

    def execute(self, context: bpy.types.Context) -> OperatorResult:
        if context.screen is not None and context.screen.is_animation_playing:
            bpy.ops.screen.animation_cancel(restore_frame=False)
        shown_frame.restore(context.scene)
        return {"FINISHED"}


PARTS = (keys(Key("oneframe.case_frame", "ESC", tools=tuple(TOOLS))),)
