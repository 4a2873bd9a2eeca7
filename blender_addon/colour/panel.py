"""The panel Colour: projection, its coverage, and the lamp at the lens."""

from collections.abc import Iterable

import bpy

from ..pipeline.blender.colour.surface_colour import colour_record
from ..pipeline.errors import InputError
from ..state.known_case import lamp_of
from ..ui.panel import AdvancedPanel, AlignmentPanel, SidebarPanel, draw_text
from . import lamp, operators


class ONEFRAME_PT_colour(AlignmentPanel, AdvancedPanel):
    """Project the frame's colours on the surface"""

    bl_label = "Colour"
    bl_order = 4

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        scene = context.scene
        layout.operator_context = "INVOKE_DEFAULT"
        surface = scene.oneframe.surface
        record = None if surface is None else colour_record(surface)
        row = layout.row(align=True)
        for mode, name, _ in operators.MODES:
            icon = "GROUP_VCOL" if mode == "vertex" else "TEXTURE"
            shown = record is not None and record["mode"] == mode
            row.operator("oneframe.project_colour", text=name, icon=icon, depress=shown).mode = mode
        if record is not None:
            _draw_record(layout, scene, record)


def _draw_record(layout: bpy.types.UILayout, scene: bpy.types.Scene, record: dict) -> None:
    layout.operator("oneframe.plain_surface", text="Plain", icon="MESH_UVSPHERE")
    try:
        if operators.is_outdated(scene, record):
            draw_text(layout, "The colours belong to another pose or frame. Project again.", icon="ERROR")
    except InputError as error:
        draw_text(layout, str(error), icon="ERROR")
    rows = (
        ("Coloured in View", f"{record['of_view']:.1%}"),
        ("Seen in Total", f"{record['of_surface']:.1%}"),
    )
    _draw_rows(layout, rows, 0.68)
    for message in record.get("messages", ()):
        draw_text(layout, message, icon="INFO")


class ONEFRAME_PT_lamp(SidebarPanel):
    """The lamp at the lens, which moves with it"""

    bl_parent_id = "ONEFRAME_PT_colour"
    bl_label = "Light at the Lens"

    def draw(self, context: bpy.types.Context) -> None:
        layout, scene = self.layout, context.scene
        layout.operator_context = "INVOKE_DEFAULT"
        light = lamp_of(scene)
        if light is None:
            layout.label(text="No lamp known", icon="INFO")
        else:
            _draw_rows(layout, lamp.rows(light), 0.45)
        layout.operator("oneframe.find_lamp", icon="VIEWZOOM")
        row = layout.row(align=True)
        row.operator("oneframe.set_lamp", icon="LIGHT_POINT")
        row.operator("oneframe.clear_lamp", text="", icon="X")


def _draw_rows(layout: bpy.types.UILayout, rows: Iterable[tuple[str, str]], factor: float) -> None:
    column = layout.column(align=True)
    for name, value in rows:
        split = column.split(factor=factor)
        split.label(text=name)
        split.label(text=value)
