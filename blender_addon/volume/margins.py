"""The margins that the drill leaves around structures: the usual ones, until the user or a plan says otherwise."""

from collections.abc import Sequence

import bpy
from bpy.props import BoolProperty, CollectionProperty, FloatProperty

from ..class_registration import prop
from ..pipeline.volume.bone.structures import structure_names, without_bone
from ..pipeline.volume.drill.drill_plan import LARGEST_MARGIN_MM
from ..state import from_scene
from ..state.events import redraw
from ..ui.operator import Messages, OperatorResult, Reporting
from ..ui.question import DIALOG_PX
from . import drill_strokes
from .loaded import LoadedCT, ct_of


class ONEFRAME_PG_margin(bpy.types.PropertyGroup):
    """The margin around a structure, whose name is the item's."""

    spared: bool = prop(BoolProperty, "Spared", "The drill does not enter the structure")
    margin_mm: float = prop(
        FloatProperty,
        "Margin (mm)",
        "Bone that the drill leaves around the structure",
        min=0,
        max=LARGEST_MARGIN_MM,
        soft_max=5,
        precision=2,
        step=10,
    )


class ONEFRAME_OT_margins(Reporting):
    """Bone that the drill leaves around each structure of the labels, mm"""

    bl_label = "Margins"

    margins: Sequence[ONEFRAME_PG_margin] = prop(
        CollectionProperty, type=ONEFRAME_PG_margin, options={"SKIP_SAVE", "HIDDEN"}
    )

    needs = (lambda context: getattr(ct_of(context.scene), "labels", None), "Open the labels of the CT first")

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> OperatorResult:
        ct = ct_of(context.scene)
        if ct is None:
            return {"CANCELLED"}
        present = margins_of(context.scene, ct)
        for name in structures_of(ct):
            item = self.margins.add()  # type: ignore[attr-defined]
            item.name, item.spared, item.margin_mm = name, name in present, present.get(name, 1.0)
        return context.window_manager.invoke_props_dialog(self, width=DIALOG_PX)

    def draw(self, context: bpy.types.Context) -> None:
        column = self.layout.column(align=True)
        for item in self.margins:
            row = column.split(factor=0.55)
            row.prop(item, "spared", text=item.name.replace("_", " "))
            field = row.row()
            field.active = item.spared
            field.prop(item, "margin_mm", text="mm")

    def run(self, context: bpy.types.Context) -> Messages:
        chosen = {item.name: from_scene.shortest(item.margin_mm) for item in self.margins if item.spared}
        drill_strokes.set_margins(context.scene, chosen)
        redraw()
        return (f"the drill spares {len(chosen)} of {len(self.margins)} structures",)


def structures_of(ct: LoadedCT) -> tuple[str, ...]:
    """Names of the structures in the labels."""
    return () if ct.labels is None else tuple(structure_names(without_bone(ct.labels)).values())


def margins_of(scene: bpy.types.Scene, ct: LoadedCT) -> dict[str, float]:
    """The margins that were chosen or come with a plan; else the usual ones."""
    if scene.oneframe_ct.margins_text:
        return drill_strokes.margins_in(scene)
    return drill_strokes.usual_margins(structures_of(ct))
