"""Refining a rough pose against the image: one key, shown before it is kept, one undo step, refused if it is no better.

The work is done in a thread, on arrays alone, so that the window stays alive; Esc stops it.
"""

import threading
from collections.abc import Callable
from typing import Literal

import bpy
import numpy as np

from ..pipeline.alignment.refinement.refine import Refinement, refine_pose
from ..pipeline.blender.alignment.surface_object import set_pose
from ..pipeline.blender.colour.surface_colour import colour_record, vertex_codes
from ..pipeline.case.loaded_case import LoadedCase
from ..pipeline.errors import InputError, RunError
from ..registration import class_registration
from ..setup.alignment_record import remember_refined
from ..state import from_scene
from ..ui.keymap import OBJECT_MODE, Key, Keys
from ..ui.operator import Messages, NeedsAlignment, OperatorResult, Reporting, redraw

KEYS = Keys([Key("oneframe.refine", "F", keymap=OBJECT_MODE)])
POLL_SECONDS = 0.1
NAVIGATION = {"MIDDLEMOUSE", "WHEELUPMOUSE", "WHEELDOWNMOUSE", "WHEELINMOUSE", "WHEELOUTMOUSE", "MOUSEMOVE"}
NAVIGATION |= {"INBETWEEN_MOUSEMOVE", "TRACKPADPAN", "TRACKPADZOOM", "WINDOW_DEACTIVATE"}
KEEP, DISCARD = {"RET", "NUMPAD_ENTER", "LEFTMOUSE"}, {"ESC", "RIGHTMOUSE"}


class _Stopped(Exception):
    """The user wants no more of it."""


class Refining:
    """A refinement in a thread; knows nothing of Blender."""

    def __init__(self, loaded: LoadedCase, colours: np.ndarray | None) -> None:
        self.start = loaded.cam_from_model
        self.fraction = 0.0
        self.result: Refinement | None = None
        self.error: Exception | None = None
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, args=(loaded, colours), daemon=True)
        self._thread.start()

    @property
    def running(self) -> bool:
        """Whether it has not ended yet."""
        return self._thread.is_alive()

    def stop(self) -> None:
        """Give up; it ends at its next step."""
        self._stop.set()

    def _tell(self, fraction: float) -> None:
        self.fraction = fraction
        if self._stop.is_set():
            raise _Stopped

    def _run(self, loaded: LoadedCase, colours: np.ndarray | None) -> None:
        try:
            self.result = refined(loaded, colours, self._tell)
        except _Stopped:
            pass
        except Exception as error:  # raised again where Blender reports it
            self.error = error


def refined(
    loaded: LoadedCase, colours: np.ndarray | None, progress: Callable[[float], None] | None = None
) -> Refinement:
    """The case's pose, refined against its frame."""
    return refine_pose(
        loaded.image,
        loaded.valid,
        loaded.case.camera,
        loaded.mesh,
        loaded.cam_from_model,
        colours=colours,
        progress=progress,
    )


def known_colours(scene: bpy.types.Scene) -> np.ndarray | None:
    """``(V, 3)`` colours of the surface that are evidence for the pose, or ``None``.

    Those projected from the present frame are none: they would only confirm the pose that they were projected from.
    """
    surface = from_scene.surface_of(scene)
    record = colour_record(surface)
    if record is None or record["frame"] == str(from_scene.absolute_path(scene.oneframe.frame_path)):
        return None
    codes = vertex_codes(surface)
    if codes is None or np.isnan(codes).all():
        return None
    # what is not known has the mean colour, and so nothing to say
    return np.where(np.isnan(codes), np.nanmean(codes, axis=0), codes)


class ONEFRAME_OT_refine(NeedsAlignment, Reporting, bpy.types.Operator):
    """Refine the rough pose against the image; shown first: Enter keeps it, Esc goes back"""

    bl_idname = "oneframe.refine"
    bl_label = "Refine Pose"
    bl_options = {"REGISTER", "UNDO"}

    def run(self, context: bpy.types.Context) -> Messages:
        """Without a window: at once."""
        scene = context.scene
        loaded = from_scene.loaded_case(scene, aligned=False)
        result = refined(loaded, known_colours(scene))
        _remember(result)
        if not result.accepted:
            raise InputError(result.message)
        set_pose(from_scene.camera_object_of(scene), from_scene.surface_of(scene), result.cam_from_model)
        remember_refined(scene, result.cam_from_model)
        return (result.message,)

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> OperatorResult:
        if context.window is None or bpy.app.background:
            return self.execute(context)
        try:
            loaded = from_scene.loaded_case(context.scene, aligned=False)
            colours = known_colours(context.scene)
        except (InputError, RunError) as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        self._refining, self._shows_result = Refining(loaded, colours), False
        self._timer: bpy.types.Timer | None = context.window_manager.event_timer_add(
            POLL_SECONDS, window=context.window
        )
        context.window_manager.modal_handler_add(self)
        _tell(context, "Refining the pose      Esc: stop")
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> OperatorResult:
        try:
            return self._handle(context, event)
        except (InputError, RunError) as error:
            # the surface or the camera is gone
            return self._end(context, "CANCELLED", error=str(error))
        except Exception:
            self._end(context, "CANCELLED")
            raise

    def cancel(self, context: bpy.types.Context) -> None:
        """Called by Blender when it ends the operator itself: a file is opened, the window closed."""
        self._refining.stop()
        self._end(context, "CANCELLED")

    def _handle(self, context: bpy.types.Context, event: bpy.types.Event) -> OperatorResult:
        work = self._refining
        if work.running:
            if event.type == "ESC" and event.value == "PRESS":
                work.stop()
                return self._end(context, "CANCELLED", message="refinement stopped, the pose is unchanged")
            _tell(context, f"Refining the pose: {work.fraction:.0%}      Esc: stop")
            return self._passed(event)
        if work.error is not None:
            raise work.error
        result = work.result
        if result is None:
            return self._end(context, "CANCELLED")
        if self._timer is not None:
            self._stop_timer(context)
            _remember(result)
            if not result.accepted:
                return self._end(context, "CANCELLED", error=result.message)
            self._show(context, result.cam_from_model, True)
        if event.value == "PRESS":
            if event.type in KEEP:
                self._show(context, result.cam_from_model, True)
                remember_refined(context.scene, result.cam_from_model)
                return self._end(context, "FINISHED", message=result.message)
            if event.type in DISCARD:
                self._show(context, work.start, False)
                return self._end(context, "CANCELLED", message="the pose is as it was before")
            if event.type == "SPACE":
                self._show(context, work.start if self._shows_result else result.cam_from_model, not self._shows_result)
        agreed = result.after if self._shows_result else result.before
        _tell(
            context,
            f"{'AFTER' if self._shows_result else 'BEFORE'}: {agreed.score:.0%} of the image explained      "
            "Enter or left click: keep      Esc or right click: back      Space: before / after",
        )
        return self._passed(event)

    def _passed(self, event: bpy.types.Event) -> OperatorResult:
        """Looking around is allowed meanwhile, nothing else."""
        return {"PASS_THROUGH"} if event.type in NAVIGATION else {"RUNNING_MODAL"}

    def _show(self, context: bpy.types.Context, cam_from_model: np.ndarray, is_result: bool) -> None:
        scene = context.scene
        set_pose(from_scene.camera_object_of(scene), from_scene.surface_of(scene), cam_from_model)
        self._shows_result = is_result
        redraw(context)

    def _stop_timer(self, context: bpy.types.Context) -> None:
        if self._timer is not None:
            context.window_manager.event_timer_remove(self._timer)
            self._timer = None

    def _end(
        self,
        context: bpy.types.Context,
        outcome: Literal["FINISHED", "CANCELLED"],
        *,
        message: str = "",
        error: str = "",
    ) -> OperatorResult:
        self._stop_timer(context)
        _tell(context, None)
        if message:
            self.report({"INFO"}, message)
        if error:
            self.report({"ERROR"}, error)
        redraw(context)
        return {outcome}


_told: str | None = None
"""What the headers say at present: said again at every move of the mouse, it would have them drawn again."""


def _tell(context: bpy.types.Context, text: str | None) -> None:
    """Show a text in the status bar and in the headers of the 3D views; ``None`` gives both back."""
    global _told
    if text is not None and text == _told:
        return
    _told = text
    context.workspace.status_text_set(text)
    for window in context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                area.header_text_set(text)


_last: tuple[bytes, Refinement] | None = None
"""The latest refinement, and the pose that it left: tells nothing about any other pose."""


def _remember(result: Refinement) -> None:
    global _last
    _last = result.cam_from_model.tobytes(), result


def outcome(scene: bpy.types.Scene) -> Refinement | None:
    """The refinement that the present pose came from, or that was refused at it; ``None`` for any other pose.

    Raises
    ------
    InputError
        There is no pose.
    """
    if _last is None or from_scene.cam_from_model(scene).tobytes() != _last[0]:
        return None
    return _last[1]


_CLASSES = (ONEFRAME_OT_refine,)
_register_classes, _unregister_classes = class_registration(_CLASSES)


def register() -> None:
    """Register the operator and its key."""
    _register_classes()
    KEYS.register()


def unregister() -> None:
    """The opposite of :func:`register`."""
    global _last
    KEYS.unregister()
    _unregister_classes()
    _last = None
