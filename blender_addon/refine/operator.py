"""The operator that refines a rough pose against the image: a preview to accept or discard, one undo step.

A refinement that does not improve the pose is refused. It runs in a thread, on arrays only, so that the window stays
responsive; Esc stops it.
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
from ..ui.keymap import Key, Keys
from ..ui.operator import Messages, NeedsAlignment, OperatorResult, Reporting, redraw

KEYS = Keys([Key("oneframe.refine", "F")])
POLL_SECONDS = 0.1
NAVIGATION = {"MIDDLEMOUSE", "WHEELUPMOUSE", "WHEELDOWNMOUSE", "WHEELINMOUSE", "WHEELOUTMOUSE", "MOUSEMOVE"}
NAVIGATION |= {"INBETWEEN_MOUSEMOVE", "TRACKPADPAN", "TRACKPADZOOM", "WINDOW_DEACTIVATE"}
KEEP, DISCARD = {"RET", "NUMPAD_ENTER", "LEFTMOUSE"}, {"ESC", "RIGHTMOUSE"}


class _Stopped(Exception):
    """Ends the thread of a refinement that the user has stopped."""


class RefinementThread:
    """A refinement in a thread; independent of Blender.

    Attributes
    ----------
    start
        ``(4, 4)`` cam_from_model before the refinement, mm.
    fraction
        Progress, 0..1.
    result
        The refinement; ``None`` until it has succeeded.
    error
        The exception with which it failed, otherwise ``None``.
    """

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
        """Whether the thread has not ended yet."""
        return self._thread.is_alive()

    def stop(self) -> None:
        """Ask the thread to stop; it ends at its next step."""
        self._stop.set()

    def _update(self, fraction: float) -> None:
        self.fraction = fraction
        if self._stop.is_set():
            raise _Stopped

    def _run(self, loaded: LoadedCase, colours: np.ndarray | None) -> None:
        try:
            self.result = refined(loaded, colours, self._update)
        except _Stopped:
            pass
        except Exception as error:  # raised again in the main thread, where Blender reports it
            self.error = error


def refined(
    loaded: LoadedCase, colours: np.ndarray | None, progress: Callable[[float], None] | None = None
) -> Refinement:
    """Refine the case's pose against its frame; arguments as for :func:`refine_pose`."""
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
    """``(V, 3)`` colours of the vertices that are evidence for the pose, or ``None``.

    Colours projected from the current frame are not: they would only confirm the pose of that projection.
    """
    surface = from_scene.surface_of(scene)
    record = colour_record(surface)
    if record is None or record["frame"] == str(from_scene.absolute_path(scene.oneframe.frame_path)):
        return None
    codes = vertex_codes(surface)
    if codes is None or np.isnan(codes).all():
        return None
    # the mean colour for vertices without one: it carries no evidence
    return np.where(np.isnan(codes), np.nanmean(codes, axis=0), codes)


class ONEFRAME_OT_refine(NeedsAlignment, Reporting, bpy.types.Operator):
    """Refine the rough pose against the image, with a preview: Enter accepts it, Esc discards it"""

    bl_idname = "oneframe.refine"
    bl_label = "Refine Pose"
    bl_options = {"REGISTER", "UNDO"}

    def run(self, context: bpy.types.Context) -> Messages:
        """Refine without a preview, as scripts do."""
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
        self._refining, self._shows_result = RefinementThread(loaded, colours), False
        self._timer: bpy.types.Timer | None = context.window_manager.event_timer_add(
            POLL_SECONDS, window=context.window
        )
        context.window_manager.modal_handler_add(self)
        _show_status(context, "Refining the pose      Esc: Stop")
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> OperatorResult:
        try:
            return self._handle(context, event)
        except (InputError, RunError) as error:
            # the surface or the camera has been deleted
            return self._end(context, "CANCELLED", error=str(error))
        except Exception:
            self._end(context, "CANCELLED")
            raise

    def cancel(self, context: bpy.types.Context) -> None:
        """Called by Blender when it ends the operator: a file was opened, or the window closed."""
        self._refining.stop()
        self._end(context, "CANCELLED")

    def _handle(self, context: bpy.types.Context, event: bpy.types.Event) -> OperatorResult:
        refining = self._refining
        if refining.running:
            if event.type == "ESC" and event.value == "PRESS":
                refining.stop()
                return self._end(context, "CANCELLED", message="refinement stopped, the pose is unchanged")
            _show_status(context, f"Refining the pose: {refining.fraction:.0%}      Esc: Stop")
            return self._pass_navigation(event)
        if refining.error is not None:
            raise refining.error
        result = refining.result
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
                self._show(context, refining.start, False)
                return self._end(context, "CANCELLED", message="refinement discarded, the pose is unchanged")
            if event.type == "SPACE":
                shown = refining.start if self._shows_result else result.cam_from_model
                self._show(context, shown, not self._shows_result)
        agreement = result.after if self._shows_result else result.before
        _show_status(
            context,
            f"{'AFTER' if self._shows_result else 'BEFORE'}: {agreement.score:.0%} of the image explained      "
            "Enter or Left Click: Accept      Esc or Right Click: Discard      Space: Before / After",
        )
        return self._pass_navigation(event)

    def _pass_navigation(self, event: bpy.types.Event) -> OperatorResult:
        """Let the user navigate in the view meanwhile, but nothing else."""
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
        _show_status(context, None)
        if message:
            self.report({"INFO"}, message)
        if error:
            self.report({"ERROR"}, error)
        redraw(context)
        return {outcome}


_status: str | None = None
"""The text shown at present: setting it again at every movement of the mouse would redraw the headers each time."""


def _show_status(context: bpy.types.Context, text: str | None) -> None:
    """Show a text in the status bar and in the headers of the 3D views; ``None`` restores both."""
    global _status
    if text is not None and text == _status:
        return
    _status = text
    context.workspace.status_text_set(text)
    for window in context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                area.header_text_set(text)


_last: tuple[bytes, Refinement] | None = None
"""The latest refinement and the bytes of its pose; valid for that pose only."""


def _remember(result: Refinement) -> None:
    global _last
    _last = result.cam_from_model.tobytes(), result


def outcome(scene: bpy.types.Scene) -> Refinement | None:
    """The latest refinement if the current pose is its result, or if it was refused at this pose; otherwise ``None``.

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
    """Undo :func:`register`."""
    global _last
    KEYS.unregister()
    _unregister_classes()
    _last = None
