"""Whole sentences in Blender's narrow panels."""

import textwrap

import bpy

PIXELS_A_CHARACTER = 6.5
"""Mean width of a character of the interface's font at scale 1."""


def draw_sentence(layout: bpy.types.UILayout, text: str, *, icon: str = "NONE") -> None:
    """Draw a text of any length as several labels, wrapped to the sidebar's width."""
    region = bpy.context.region
    scale = bpy.context.preferences.system.ui_scale
    width = 230 if region is None else region.width / scale
    lines = textwrap.wrap(text, max(20, int((width - 50) / PIXELS_A_CHARACTER)))
    column = layout.column(align=True)
    column.scale_y = 0.75
    for number, line in enumerate(lines):
        column.label(text=line, icon=icon if number == 0 else "BLANK1" if icon != "NONE" else "NONE")
