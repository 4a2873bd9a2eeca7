"""Colouring the surface in steps: the arrays in any thread, what Blender shows in its main one."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import bpy

from ..pipeline.blender.colour.surface_colour import put_colour
from ..pipeline.case.loaded_case import LoadedCase
from ..pipeline.colour.reference_view import ReferenceView, baked_colour_of, reference_view
from ..pipeline.colour.texture_atlas import TextureAtlas
from ..pipeline.colour.vertex_colours import VertexColours, colour_vertices
from ..state import from_scene

Mode = Literal["texture", "vertex"]
SEEN, BAKED = 0.1, 0.85
"""Fractions of the thread's time after which the surface in the frame's view is known, and the colours."""


@dataclass(frozen=True)
class Colouring:
    """The surface that the frame saw, its colours, those of the vertices, the parts that they cover, and messages."""

    view: ReferenceView
    colour: VertexColours | TextureAtlas
    vertices: VertexColours
    coverage: tuple[float, float]
    messages: tuple[str, ...]


def coloured(loaded: LoadedCase, mode: Mode, report: Callable[[float], None]) -> Colouring:
    """Compute the colours; in any thread. ``report`` gets a fraction 0..1, and may raise to end the work."""
    report(0.0)
    view = reference_view(loaded)
    colour, messages = baked_colour_of(view, mode, lambda fraction: report(SEEN + (BAKED - SEEN) * fraction))
    report(BAKED)
    vertices = colour_vertices(view.mesh, view.views) if isinstance(colour, TextureAtlas) else colour
    report((BAKED + 1) / 2)
    return Colouring(view, colour, vertices, view.coverage(), (*view.messages, *messages))


def put(scene: bpy.types.Scene, loaded: LoadedCase, found: Colouring) -> tuple[str, ...]:
    """Colour the surface object with a result; in Blender's main thread. Returns messages."""
    surface = from_scene.surface_of(scene)
    messages, (of_view, of_surface) = list(found.messages), found.coverage
    record = {
        "frame": str(loaded.case.image),
        "further": [str(each.image) for each in loaded.case.frames],
        "pose": from_scene.pose_in_file(scene).tolist(),
        "of_view": of_view,
        "of_surface": of_surface,
        "messages": messages,
    }
    put_colour(
        surface,
        loaded.surface.mesh,
        found.view,
        found.colour,
        record=record,
        vertices=found.vertices,
    )
    return (
        *loaded.messages,
        *messages,
        f"the frame colours {of_view:.1%} of the surface in its view, {of_surface:.1%} of the whole",
    )
