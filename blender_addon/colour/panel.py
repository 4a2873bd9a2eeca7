"""The panel Colour: projection, and its coverage."""

import bpy

from ..pipeline.blender.colour.surface_colour import colour_record
from ..pipeline.errors import InputError
from ..ui.panel import AdvancedPanel, AlignmentPanel, draw_text
from . import operators


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
    column = layout.column(align=True)
    for name, part in (("Coloured in View", record["of_view"]), ("Seen in Total", record["of_surface"])):
        split = column.split(factor=0.68)
        split.label(text=name)
        split.label(text=f"{part:.1%}")
    for message in record.get("messages", ()):
        draw_text(layout, message, icon="INFO")
