"""Base class of operators whose work takes long: in a thread with progress, stopped by Esc; in scripts at once."""

import threading
import time
from collections.abc import Callable
from typing import Any

import bpy
from bpy.props import StringProperty
from bpy_extras.io_utils import ImportHelper

from ..class_registration import prop
from ..pipeline.errors import InputError, RunError
from ..state import from_scene
from ..state.events import areas
from .operator import Messages, OperatorResult, Reporting, open_beside, report_error

POLL_SECONDS = 0.1
NAVIGATION = {"MIDDLEMOUSE", "WHEELUPMOUSE", "WHEELDOWNMOUSE", "WHEELINMOUSE", "WHEELOUTMOUSE", "MOUSEMOVE"}
NAVIGATION |= {"INBETWEEN_MOUSEMOVE", "TRACKPADPAN", "TRACKPADZOOM", "WINDOW_DEACTIVATE"}
"""Events that the user may use meanwhile; others would change what the work began with."""

SHOWN_SECONDS = 0.5
"""Between texts of the progress."""

Work = Callable[[Callable[[float], None]], Any]
"""Called in a thread with a function that takes the finished share, 0..1, and may end it; it must not use Blender."""

_shown: list[str] = []
"""The text of :func:`show_status`: setting it again would draw everything again."""


class _Stopped(Exception):
    """Ends the thread of work that the user has stopped."""


def inputs_of(scene: bpy.types.Scene) -> tuple[object, ...]:
    """What work in the background relies on; another window may change it meanwhile."""
    surface, settings = from_scene.surface_of(scene), scene.oneframe
    return (
        (surface.oneframe.mesh_path, len(surface.data.vertices), settings.units, settings.frame_path),
        (from_scene.camera(scene), from_scene.cam_from_model(scene).tobytes()),
    )


def check_inputs(scene: bpy.types.Scene, before: tuple[object, ...]) -> None:
    """Raise :class:`InputError` if the result of work that began with other inputs does not belong to the scene."""
    if inputs_of(scene) != before:
        raise InputError("the frame, K, the surface or its pose has changed meanwhile, nothing was done; start again")


class BackgroundWork:
    """A function in a thread.

    Attributes
    ----------
    fraction
        Progress, 0..1.
    result
        What the function returned; ``None`` until it has succeeded.
    error
        The exception with which it failed, otherwise ``None``.
    """

    def __init__(self, function: Work) -> None:
        """Start ``function(progress)``; it calls ``progress`` with a fraction 0..1 at each step, where it may end."""
        self.fraction = 0.0
        self.result: Any = None
        self.error: Exception | None = None
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, args=(function,), daemon=True)
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

    def _run(self, function: Work) -> None:
        try:
            self.result = function(self._update)
        except _Stopped:
            pass
        except Exception as error:  # raised again in the main thread, where Blender reports it
            self.error = error


def show_status(context: bpy.types.Context, text: str | None) -> None:
    """Show a text in the status bar and in the headers of the 3D views; ``None`` restores both."""
    wanted = [] if text is None else [text]
    if wanted and wanted == _shown:
        return
    _shown[:] = wanted
    context.workspace.status_text_set(text)
    for _window, area in areas("VIEW_3D"):
        area.header_text_set(text)


class InBackground(Reporting):
    """Mixin: :meth:`work` prepares a function for a thread, :meth:`finish` puts its result into the scene."""

    doing = "Working"
    """What the status bar says meanwhile."""
    stopped = "nothing was changed"
    """What Esc leaves."""

    _background: BackgroundWork
    _timer: bpy.types.Timer | None = None
    _began = _next_shown = 0.0
    _pressed = False

    def work(self, context: bpy.types.Context) -> Work:
        """The function for the thread. Implementations raise InputError where it cannot begin."""
        raise NotImplementedError

    def finish(self, context: bpy.types.Context, result: Any) -> Messages:
        """Use the function's result, in the main thread; returns messages to report."""
        raise NotImplementedError

    def run(self, context: bpy.types.Context) -> Messages:
        """Work without a thread, as scripts do."""
        return self.finish(context, self.work(context)(lambda _fraction: None))

    def so_far(self) -> str:
        """What has come of the work so far, in words."""
        return ""

    def start(self, context: bpy.types.Context) -> OperatorResult:
        """Begin, for ``invoke`` to return."""
        if context.window is None or bpy.app.background:
            return self.execute(context)
        try:
            self._background = BackgroundWork(self.work(context))
        except (InputError, RunError) as error:
            report_error(self, self.worded(str(error)))
            return {"CANCELLED"}
        self._began = time.monotonic()
        self._next_shown = self._began
        self._timer = context.window_manager.event_timer_add(POLL_SECONDS, window=context.window)
        context.window_manager.modal_handler_add(self)
        self._show(context)
        return {"RUNNING_MODAL"}

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> OperatorResult:
        return self.start(context)

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> OperatorResult:
        background = self._background
        if background.running:
            if event.type == "ESC" and event.value == "PRESS":
                background.stop()
                self._end(context)
                self.report({"INFO"}, f"{self.doing}: stopped, {self.stopped}")
                return {"CANCELLED"}
            if event.type == "LEFTMOUSE" and event.value == "PRESS":
                self._pressed, self._next_shown = True, 0.0
            if event.type in ("TIMER", "LEFTMOUSE"):
                self._show(context)
            return {"PASS_THROUGH"} if event.type in NAVIGATION | {"TIMER"} else {"RUNNING_MODAL"}
        self._end(context)
        return self.reported(context, lambda: self._finished(context))

    def _finished(self, context: bpy.types.Context) -> Messages:
        if self._background.error is not None:
            raise self._background.error
        return self.finish(context, self._background.result)

    def cancel(self, context: bpy.types.Context) -> None:
        """Called by Blender when it ends the operator: a file was opened, or the window closed."""
        self._background.stop()
        self._end(context)

    def _show(self, context: bpy.types.Context) -> None:
        now = time.monotonic()
        if now < self._next_shown:
            return
        # every other text draws the whole window, for which the work waits
        self._next_shown = now + SHOWN_SECONDS
        share = self._background.fraction
        done = f"{share:.0%}" if share else f"{time.monotonic() - self._began:.0f} s"
        refused = "      Not ready yet: clicks and drags do nothing" if self._pressed else ""
        so_far = f", {text}" if (text := self.so_far()) else ""
        show_status(context, f"{self.doing}: {done}{so_far}      Esc: Stop{refused}")

    def _end(self, context: bpy.types.Context) -> None:
        if self._timer is not None:
            context.window_manager.event_timer_remove(self._timer)
            self._timer = None
        show_status(context, None)


class AsksInBackground(InBackground):
    """Mixin for operators with a dialog, after which the thread begins."""

    def execute(self, context: bpy.types.Context) -> OperatorResult:
        """Called by Blender, also by the dialog."""
        if self.options.is_invoke and not bpy.app.background and self._timer is None:
            return self.start(context)
        return super().execute(context)


class OpensInBackground(AsksInBackground, ImportHelper):
    """Mixin for operators with a file dialog: the thread begins when a file is chosen or given."""

    filepath: str = prop(StringProperty, subtype="FILE_PATH", options={"SKIP_SAVE", "HIDDEN"})

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> OperatorResult:
        if self.filepath:
            return self.start(context)
        open_beside(self, context.scene)
        return ImportHelper.invoke(self, context, event)
