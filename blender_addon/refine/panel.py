"""The panel Refine, and the one that says what the pose rests on: landmarks, pins, the image or the hand."""

import bpy

from ..pipeline.errors import InputError
from ..ui.keymap import draw_key
from ..ui.panel import AlignmentPanel, StepPanel, draw_text
from . import operator
from .preview import error_text, preview_text


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
        if found is None:
            return
        table = layout.column(align=True)
        after = "Refused" if found.can_be_taken else "After"
        for texts in (
            ("", "Before", after),
            ("Explained", f"{found.before.score:.0%}", f"{found.after.score:.0%}"),
            ("Off By", error_text(found, refined=False), error_text(found, refined=True)),
        ):
            row = table.split(factor=0.35)
            for text in texts:
                row.label(text=text)
        message, icon = found.message, "CHECKMARK" if found.accepted else "ERROR"
        if found.can_be_taken and (taken or previewed):
            words = "Taken although refused" if taken else preview_text(found)
            message = f"{words}: {found.objection}"
        draw_text(layout, message, icon=icon)
