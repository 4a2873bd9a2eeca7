"""The panel Refine: one button, its key, and the result."""

import bpy

from ..class_registration import class_registration
from ..pipeline.errors import InputError
from ..ui.keymap import draw_key
from ..ui.panel import AlignmentPanel, draw_text
from . import operator
from .preview import error_text


class ONEFRAME_PT_refine(AlignmentPanel):
    """Refine the rough pose against the image"""

    bl_label = "5  Refine"
    bl_order = 4

    def draw(self, context: bpy.types.Context) -> None:
        layout, scene = self.layout, context.scene
        layout.operator_context = "INVOKE_DEFAULT"
        row = layout.split(factor=0.85, align=True)
        row.operator("oneframe.refine", text="Refine Against Image", icon="SNAP_ON")
        draw_key(row, "oneframe.refine")
        try:
            found = operator.outcome(scene)
        except InputError:
            return  # the panel Set up says what is wrong with the pose
        if found is None:
            return
        refused, taken = found.can_be_taken, operator.is_taken(scene)
        table = layout.column(align=True)
        head = table.split(factor=0.35)
        for name in ("", "Before", "Refused" if refused else "After"):
            head.label(text=name)
        for name, before, after in (
            ("Explained", f"{found.before.score:.0%}", f"{found.after.score:.0%}"),
            ("Off By", error_text(found, refined=False), error_text(found, refined=True)),
        ):
            row = table.split(factor=0.35)
            for text in (name, before, after):
                row.label(text=text)
        if taken:
            draw_text(layout, f"Taken although refused: {found.objection}", icon="ERROR")
        else:
            draw_text(layout, found.message, icon="CHECKMARK" if found.accepted else "ERROR")
        if refused and not taken and not operator.is_previewed(scene):
            layout.operator("oneframe.take_refused", icon="HIDE_OFF")


_CLASSES = (ONEFRAME_PT_refine,)
register, unregister = class_registration(_CLASSES)
