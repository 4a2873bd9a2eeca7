"""Operators that register the frames of the film, play them with the surface drawn in, and go back to the case's."""

from dataclasses import replace
from functools import partial
from typing import Any

import bpy
import numpy as np

from ..pipeline.case.loaded_case import LoadedCase
from ..pipeline.errors import InputError
from ..pipeline.registration.register import Registrar
from ..setup.alignment_record import is_start, pose_record
from ..state import from_scene
from ..state.scene_files import forget_stamps
from ..ui.background_operator import NAVIGATION, InBackground, Work, show_status
from ..ui.keymap import TOOLS, Key, keys
from ..ui.operator import Available, Messages, Needs, OperatorResult
from ..video import session, shown_frame
from ..video.frame_fetcher import AHEAD
from ..video.operators import NeedsFilm
from . import found


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

    needs: Needs = (lambda context: found.of(context.scene) is not None, "Press Register Frames first")


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
        self._found = found.begun(scene, self._film)
        scene.oneframe_video.visible = True
        shown_frame.restore(scene)
        return partial(self._found.register, registrar, self._film)

    def so_far(self) -> str:
        return self._found.summary()

    def finish(self, context: bpy.types.Context, result: Any) -> Messages:
        forget_stamps()
        check = self._found.check
        return (f"{self._film.path.name}: {self._found.summary()}", *([check.words] if check and check.words else []))


class ONEFRAME_OT_case_frame(Available):
    """Show the case's own frame again; looking at others has changed nothing of it"""

    bl_label = "Back to Case Frame"
    bl_options = {"REGISTER"}

    needs = (lambda context: shown_frame.is_shown(context.scene), "The view shows the case's frame")

    def execute(self, context: bpy.types.Context) -> OperatorResult:
        shown_frame.restore(context.scene)
        return {"FINISHED"}


class ONEFRAME_OT_play_frames(NeedsFound):
    """Play the film with surface and structures at the pose of each frame; Esc or a click stops"""

    bl_label = "Play"
    bl_options = {"REGISTER"}

    _timer: bpy.types.Timer | None = None

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> OperatorResult:
        scene, film = context.scene, session.scored(context.scene)
        scene.oneframe_video.visible = True
        is_last = film.shown == len(film.times_s) - 1
        # from the frame in view, at the end from the first one
        self._next = 0 if is_last or not shown_frame.is_shown(scene) else film.shown
        # a slow display plays slower, and leaves out nothing
        step_s = float(np.median(np.diff(film.times_s))) if len(film.times_s) > 1 else 0.1
        self._timer = context.window_manager.event_timer_add(step_s, window=context.window)
        context.window_manager.modal_handler_add(self)
        show_status(context, "Playing      Esc or Click: Stop")
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> OperatorResult:
        is_stopped = event.type in ("ESC", "LEFTMOUSE", "RIGHTMOUSE") and event.value == "PRESS"
        if is_stopped or not self.poll(context) or (event.type == "TIMER" and not self._step(context.scene)):
            self.cancel(context)
            return {"FINISHED"}
        return {"PASS_THROUGH"} if event.type in NAVIGATION | {"TIMER"} else {"RUNNING_MODAL"}

    def _step(self, scene: bpy.types.Scene) -> bool:
        """Show the next picture if it is decoded; returns False at the end of the film."""
        film, at = session.scored(scene), self._next
        if film.fetcher.frame(at) is None and not film.fetcher.failure(at):
            film.fetcher.want(at)
            return True
        shown_frame.show(scene, at)
        self._next = at + 1
        film.fetcher.want(min(at + AHEAD, len(film.times_s) - 1))
        return self._next < len(film.times_s)

    def cancel(self, context: bpy.types.Context) -> None:
        """Called by Blender too, when it ends the operator."""
        if self._timer is not None:
            context.window_manager.event_timer_remove(self._timer)
        self._timer = None
        show_status(context, None)


PARTS = (keys(Key("oneframe.case_frame", "ESC", tools=tuple(TOOLS))),)
