"""A refinement in a thread, on arrays only, so that the window stays responsive."""

import threading
from collections.abc import Callable

import bpy
import numpy as np

from ..pipeline.alignment.refinement.refine import refine_pose
from ..pipeline.alignment.refinement.verdict import Refinement
from ..pipeline.blender.colour.surface_colour import colour_record, vertex_codes
from ..pipeline.case.loaded_case import LoadedCase
from ..state import from_scene


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
