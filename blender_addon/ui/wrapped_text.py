"""Long texts in Blender's narrow panels."""

import textwrap

import bpy

CHARACTER_PX = 6.5
"""Mean width of a character in the interface font at scale 1."""


def draw_text(layout: bpy.types.UILayout, text: str, *, icon: str = "NONE") -> None:
    """Draw a text of any length as labels, wrapped to the width of the sidebar."""
    region = bpy.context.region
    scale = bpy.context.preferences.system.ui_scale
    width = 230 if region is None else region.width / scale
    lines = textwrap.wrap(text, max(20, int((width - 50) / CHARACTER_PX)))
    column = layout.column(align=True)
    column.scale_y = 0.75
    for number, line in enumerate(lines):
        column.label(text=line, icon=icon if number == 0 else "BLANK1" if icon != "NONE" else "NONE")
