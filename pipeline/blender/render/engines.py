"""The engines that render a coloured surface: one file of this folder each, whose name is the engine's.

All give the same arrays by the same rule of colour, :mod:`oneframe.colour.seen_frame`.
"""

import ctypes
import sys
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass
from importlib import import_module

import bpy
import numpy as np

from ...camera.pinhole import PinholeCamera
from ...case.loaded_case import LoadedCase
from ...colour.lens_shading import LensShading
from ...colour.reference_view import ReferenceView, reference_view
from ...colour.shading import ColouredSurface
from ...errors import InputError
from ...evaluation.methods import Renderers
from ...projection.rendered_view import Render, RenderedView

LARGEST_VIEW_PX = 8192**2
"""Pixels of a view: with its passes it takes 7 GB."""


@dataclass(frozen=True)
class Engine:
    """What renders.

    Attributes
    ----------
    opened
        From surface, camera, samples (1: a ray at each pixel's centre; more: anti-aliased, so many rays in each pixel
        at an edge) and threads (0: one per core) to what renders any pose inside a ``with`` block.
    check
        Raises ``InputError`` if the engine does not work on this machine.
    reference
        Name of the engine that finds what the frames saw; its own if left out.
    """

    opened: Callable[[ColouredSurface, PinholeCamera, int, int], AbstractContextManager[Render]]
    check: Callable[[], None] = lambda: None
    reference: str | None = None


def engine_named(name: str) -> Engine:
    """The engine of one of the names :data:`oneframe.dataset.options.ENGINES`."""
    found: Engine = import_module(f".{name}", __package__).ENGINE
    return found


def opened_engine(
    name: str, surface: ColouredSurface, camera: PinholeCamera, *, samples: int = 1, threads: int = 0
) -> AbstractContextManager[Render]:
    """What renders a surface: see :class:`Engine`."""
    if camera.width * camera.height > LARGEST_VIEW_PX:
        raise InputError(
            f"view: expected at most {LARGEST_VIEW_PX / 1e6:.0f} million pixels, found {camera.width}x"
            f"{camera.height}; use a smaller frame or --scale"
        )
    return engine_named(name).opened(surface, camera, samples, threads)


def reference_view_of(loaded: LoadedCase, engine: str = "cycles", light: LensShading | None = None) -> ReferenceView:
    """The reference view by the :attr:`.Engine.reference` of an engine, as of :func:`.reference_view`."""
    name = engine_named(engine).reference or engine

    def look(surface: ColouredSurface, camera: PinholeCamera, cam_from_model: np.ndarray) -> RenderedView:
        with opened_engine(name, surface, camera) as render:
            return render(cam_from_model)

    return reference_view(loaded, look, light)


def keep_freed_memory() -> None:
    """Let the C library reuse large buffers from view to view instead of returning them to the system.

    Otherwise every view's buffers are mapped, zeroed page by page and unmapped again, which takes a tenth of the time
    of a 1-sample view. Only glibc has this option; elsewhere nothing happens.
    """
    if sys.platform != "linux":
        return
    m_trim_threshold, m_mmap_threshold = -1, -3
    try:
        mallopt = ctypes.CDLL(None).mallopt
    except (OSError, AttributeError):
        return
    mallopt(m_mmap_threshold, 1 << 30)
    mallopt(m_trim_threshold, 1 << 30)


RENDERERS = Renderers(lambda name: engine_named(name).check(), opened_engine, bpy.app.version_string)
"""For evaluations."""
