"""The panel Refine, and the one that says what the pose rests on: landmarks, pins, the image or the hand."""

import bpy

from ..pipeline.errors import InputError
from ..ui.keymap import draw_key
from ..ui.panel import AlignmentPanel, StepPanel, draw_text
from . import operator
from .preview import error_text, preview_text

MESSAGE_LINES = 6
"""Of the slots that stay as high as they are when a result appears: no button moves under the pointer."""


class ONEFRAME_PT_refine(AlignmentPanel, StepPanel):
    """Refine the rough pose against the image"""

    bl_label = "3  Refine"
    bl_order = 3

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        scene = context.scene
        layout.operator_context = "INVOKE_DEFAULT"
        row = layout.split(factor=0.85, align=True)
        row.operator("oneframe.refine", icon="SNAP_ON")
        draw_key(row, "oneframe.refine")
        try:
            found = operator.outcome(scene)
            taken, previewed = operator.is_taken(scene), operator.is_previewed(scene)
        except InputError:
            return  # the sidebar says what is wrong with the pose
        refused = found is not None and found.can_be_taken
        row = layout.row()
        row.enabled = refused and not taken and not previewed
        row.operator("oneframe.take_refused", icon="HIDE_OFF")
        table = layout.column(align=True)
        head = table.split(factor=0.35)
        for name in ("", "Before", "Refused" if refused else "After"):
            head.label(text=name)
        figures = {"Explained": ("", ""), "Off By": ("", "")}
        message, icon = "", "NONE"
        if found is not None:
            figures["Explained"] = f"{found.before.score:.0%}", f"{found.after.score:.0%}"
            figures["Off By"] = error_text(found, refined=False), error_text(found, refined=True)
            message, icon = found.message, "CHECKMARK" if found.accepted else "ERROR"
            if refused and (taken or previewed):
                words = "Taken although refused" if taken else preview_text(found)
                message = f"{words}: {found.objection}"
        for name, values in figures.items():
            row = table.split(factor=0.35)
            for text in (name, *values):
                row.label(text=text)
        draw_text(layout, message, icon=icon, lines=MESSAGE_LINES)
