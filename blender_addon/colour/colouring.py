"""Colouring the surface in steps: what needs Blender in its main thread, the arrays in a thread of their own."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import bpy

from ..pipeline.blender.colour.coverage import Coverage, coverage_of
from ..pipeline.blender.colour.reference_view import (
    ReferenceView,
    baked_colour_of,
    can_rasterise,
    rasterised_view_of,
    reference_view_of,
)
from ..pipeline.blender.colour.surface_colour import colour_record, put_colour
from ..pipeline.case.loaded_case import LoadedCase
from ..pipeline.colour.texture_atlas import TextureAtlas
from ..pipeline.colour.vertex_colours import VertexColours, colour_vertices
from ..state import from_scene

Mode = Literal["texture", "vertex"]
SEEN, BAKED = 0.1, 0.85
"""Fractions of the thread's time after which the surface in the frame's view is known, and the colours."""


@dataclass(frozen=True)
class Source:
    """What a colouring starts from: the case, and the surface that its frame saw if only a render can tell."""

    loaded: LoadedCase
    rendered: ReferenceView | None


@dataclass(frozen=True)
class Colouring:
    """The result: the surface that the frame saw, colours, those of the vertices, their coverage, and messages."""

    view: ReferenceView
    colour: VertexColours | TextureAtlas
    vertices: VertexColours
    coverage: Coverage
    messages: tuple[str, ...]


def source_of(scene: bpy.types.Scene) -> Source:
    """Read the scene; in Blender's main thread.

    Raises
    ------
    InputError
        Something is missing, or no pixel of the frame shows the surface.
    """
    loaded = from_scene.loaded_case(scene)
    return Source(loaded, None if can_rasterise(loaded) else reference_view_of(loaded))


def coloured(source: Source, mode: Mode, report: Callable[[float], None]) -> Colouring:
    """Compute the colours; in any thread. ``report`` gets a fraction 0..1, and may raise to end the work.

    Raises
    ------
    InputError
        No pixel of the frame shows the surface.
    """
    report(0.0)
    view = source.rendered or rasterised_view_of(source.loaded)
    colour, messages = baked_colour_of(view, mode, lambda fraction: report(SEEN + (BAKED - SEEN) * fraction))
    report(BAKED)
    vertices = colour_vertices(view.mesh, view.views) if isinstance(colour, TextureAtlas) else colour
    report((BAKED + 1) / 2)
    return Colouring(view, colour, vertices, coverage_of(view, colour), (*view.messages, *messages))


def put(scene: bpy.types.Scene, source: Source, found: Colouring) -> tuple[str, ...]:
    """Colour the surface object with a result; in Blender's main thread. Returns messages."""
    surface = from_scene.surface_of(scene)
    before = colour_record(surface)
    messages = list(found.messages)
    record = {
        "frame": str(source.loaded.case.image),
        "further": [str(each.image) for each in source.loaded.case.frames],
        "cam_from_model": source.loaded.frame.cam_from_model.tolist(),
        "of_view": found.coverage.of_view,
        "of_surface": found.coverage.of_surface,
        "mean_error": found.coverage.mean_error,
        "max_error": found.coverage.max_error,
        "messages": messages,
    }
    put_colour(
        surface,
        source.loaded.surface.mesh,
        found.view,
        found.colour,
        mark_unseen=before is None or before["unseen_marked"],
        record=record,
        vertices=found.vertices,
    )
    return (*source.loaded.messages, *messages, found.coverage.summary())
