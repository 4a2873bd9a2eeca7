"""Operators that project the frame's colours on the surface, and show them."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, Literal

import bpy
import numpy as np
from bpy.app.handlers import persistent
from bpy.props import EnumProperty

from ..class_registration import listening, prop
from ..pipeline.blender.colour.surface_colour import colour_record, put_colour, remove_colour
from ..pipeline.case.loaded_case import LoadedCase
from ..pipeline.colour.reference_view import ReferenceView, baked_colour_of, reference_view
from ..pipeline.colour.texture_atlas import TextureAtlas
from ..pipeline.colour.vertex_colours import VertexColours, colour_vertices
from ..pipeline.errors import InputError
from ..pipeline.transforms import is_same_pose
from ..state import from_scene
from ..state.camera_view import light_shape, spaces_of
from ..state.case_of_file import further_frames
from ..ui.background_operator import InBackground, Work, check_inputs, inputs_of
from ..ui.operator import Available, Messages, NeedsAlignment, Reporting

MODES = [
    ("vertex", "Vertex Colours", "One colour per vertex: as fine as the mesh"),
    ("texture", "UV Texture", "A texture made of the frame's pixels: full detail"),
]


class ONEFRAME_OT_project_colour(NeedsAlignment, InBackground):
    """Project the frame on the surface at the current pose; replaces existing colours. Esc stops it"""

    bl_label = "Project Colour"

    mode: Literal["texture", "vertex"] = prop(
        EnumProperty, "As", "How the surface holds the colours", items=MODES, default="vertex"
    )

    doing = "Projecting the frame on the surface"

    def work(self, context: bpy.types.Context) -> Work:
        _check_object_mode(from_scene.surface_of(context.scene))
        self._inputs, self._loaded = inputs_of(context.scene), from_scene.loaded_case(context.scene)
        return partial(coloured, self._loaded, self.mode)

    def finish(self, context: bpy.types.Context, result: Any) -> Messages:
        check_inputs(context.scene, self._inputs)
        messages = put(context.scene, self._loaded, result)
        show_colour(from_scene.surface_of(context.scene))
        return messages


def _is_coloured(surface: bpy.types.Object | None) -> bool:
    return surface is not None and colour_record(surface) is not None


class _NeedsColour(Available):
    """Mixin: available once the surface has colours."""

    needs = (lambda context: _is_coloured(context.scene.oneframe.surface), "Project colour on the surface first")


class ONEFRAME_OT_plain_surface(_NeedsColour, Reporting):
    """Remove the colours from the surface"""

    bl_label = "Plain Surface"

    def run(self, context: bpy.types.Context) -> None:
        surface = from_scene.surface_of(context.scene)
        _check_object_mode(surface)
        remove_colour(surface)
        show_colour(surface)


def is_outdated(scene: bpy.types.Scene, record: dict) -> bool:
    """Whether the colours on the surface come from other frames or another pose than the current ones."""
    frame = from_scene.absolute_path(scene.oneframe.frame_path)
    further = [str(each.image) for each in further_frames(scene)]
    if record["frame"] != str(frame) or record.get("further", []) != further:
        return True
    return not is_same_pose(np.array(record["pose"]), from_scene.pose_in_file(scene))


def show_colour(surface: bpy.types.Object) -> None:
    """Let 3D views in Solid mode show the colours unlit if the surface has any, otherwise its shape in studio light.

    Without colours, views in which the user has chosen another shading keep it.
    """
    record = colour_record(surface)
    for space in spaces_of(surface):
        shading = space.shading
        if record is not None:
            shading.light, shading.show_cavity = "FLAT", False
            shading.color_type = "TEXTURE" if record["mode"] == "texture" else "VERTEX"
        elif shading.light == "FLAT" and shading.color_type in ("VERTEX", "TEXTURE"):
            light_shape(shading)


def _check_object_mode(surface: bpy.types.Object) -> None:
    if surface.mode != "OBJECT":
        raise InputError(
            f"{surface.name}: expected Object mode, found {surface.mode.replace('_', ' ').capitalize()} mode; "
            "press Tab in the 3D view or choose Object Mode in its header, then try again"
        )


@persistent
def _after_undo(scene: bpy.types.Scene, *_: object) -> None:
    """Update the views' shading, which Blender's undo does not restore."""
    surface = scene.oneframe.surface
    if surface is not None:
        show_colour(surface)


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


PARTS = (listening(bpy.app.handlers.undo_post, _after_undo), listening(bpy.app.handlers.redo_post, _after_undo))
