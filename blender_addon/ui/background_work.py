"""Work on arrays in a thread: its progress, its result, and how the user stops it. The window stays responsive."""

import threading
from collections.abc import Callable
from typing import Any

import bpy

from ..pipeline.errors import InputError
from ..state import from_scene

POLL_SECONDS = 0.1
NAVIGATION = {"MIDDLEMOUSE", "WHEELUPMOUSE", "WHEELDOWNMOUSE", "WHEELINMOUSE", "WHEELOUTMOUSE", "MOUSEMOVE"}
NAVIGATION |= {"INBETWEEN_MOUSEMOVE", "TRACKPADPAN", "TRACKPADZOOM", "WINDOW_DEACTIVATE"}
"""Events that the user may use meanwhile; others would change what the work began with."""

_shown: str | None = None
"""The text of :func:`show_status`: setting it again would draw everything again."""


class _Stopped(Exception):
    """Ends the thread of work that the user has stopped."""


def inputs_of(scene: bpy.types.Scene) -> tuple[object, ...]:
    """What work in the background relies on; another window may change it meanwhile.

    Raises
    ------
    InputError
        There is no camera, surface or pose.
    """
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
    """A function in a thread; it must not use Blender.

    Attributes
    ----------
    fraction
        Progress, 0..1.
    result
        What the function returned; ``None`` until it has succeeded.
    error
        The exception with which it failed, otherwise ``None``.
    """

    def __init__(self, function: Callable[[Callable[[float], None]], Any]) -> None:
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

    def _run(self, function: Callable[[Callable[[float], None]], Any]) -> None:
        try:
            self.result = function(self._update)
        except _Stopped:
            pass
        except Exception as error:  # raised again in the main thread, where Blender reports it
            self.error = error


def show_status(context: bpy.types.Context, text: str | None) -> None:
    """Show a text in the status bar and in the headers of the 3D views; ``None`` restores both."""
    global _shown
    if text is not None and text == _shown:
        return
    _shown = text
    context.workspace.status_text_set(text)
    for window in context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                area.header_text_set(text)
