"""The panel CT: the CT and its slices, the threshold, the surface, the drill."""

import bpy

from ..ui.panel import draw_text
from ..ui.step_panel import StepPanel
from . import drill_session
from .drill_strokes import strokes_of
from .loaded import LoadedCT, ct_of, key_of
from .slice_areas import slice_areas
from .surface import made_by, strokes_text


class ONEFRAME_PT_ct(StepPanel):
    """From a CT to the surface"""

    bl_label = "0  CT"
    bl_order = 1
    step = "ct"

    def draw_step(self, context: bpy.types.Context, layout: bpy.types.UILayout) -> None:
        scene = context.scene
        layout.operator_context = "INVOKE_DEFAULT"
        layout.operator("oneframe.open_ct", icon="FILE_FOLDER")
        if key_of(scene) is None:
            draw_text(layout, "NIfTI, NRRD, MetaImage, or a folder of DICOM slices. Or drop a file onto the view.")
            return
        ct = ct_of(scene)
        if ct is None:
            draw_text(layout, "The CT is not in memory.", icon="INFO")
            layout.operator("oneframe.read_ct", icon="FILE_REFRESH")
            return
        self._draw(context, layout, ct)

    def _draw(self, context: bpy.types.Context, layout: bpy.types.UILayout, ct: LoadedCT) -> None:
        settings = context.scene.oneframe_ct
        name, grid = bpy.path.basename(settings.path.rstrip("/\\")), ct.volume.grid
        column = layout.column(align=True)
        column.label(text=name, icon="VOLUME_DATA")
        spacing = " x ".join(f"{step:.3g}" for step in grid.spacing_mm)
        column.label(text=f"{' x '.join(map(str, grid.size))}, {spacing} mm")
        column.operator("oneframe.slices", icon="IMAGE_DATA", depress=bool(slice_areas(context.screen)))
        if slice_areas(context.screen):
            row = layout.row(align=True)
            row.prop(settings, "level_hu", text="Level")
            row.prop(settings, "width_hu", text="Window")
        row = layout.row(align=True)
        row.prop(settings, "threshold_hu", text="Bone", slider=True)
        row.operator("oneframe.otsu", text="Otsu")
        layout.operator("oneframe.open_labels", icon="OUTLINER_OB_MESH")
        if ct.labels is not None:
            layout.label(text=f"{len(ct.labels.names)} labels")
        layout.operator("oneframe.make_surface", icon="MESH_DATA")
        self._draw_drill(layout, context.scene)

    def _draw_drill(self, layout: bpy.types.UILayout, scene: bpy.types.Scene) -> None:
        settings, strokes = scene.oneframe_ct, strokes_of(scene)
        column = layout.column(align=True)
        row = column.row(align=True)
        session = drill_session.of(scene)
        if session is not None:
            row.operator("oneframe.stop_drill", icon="PANEL_CLOSE")
            column.prop(settings, "burr_mm")
            draw_text(layout, session.said)
        else:
            row.operator("oneframe.drill", icon="MESH_UVSPHERE")
        row.operator("oneframe.margins", text="", icon="MOD_SOLIDIFY")
        row.operator("oneframe.open_plan", text="", icon="FILE_FOLDER")
        row.operator("oneframe.save_plan", text="", icon="FILE_TICK")
        if settings.drilling and session is None:
            draw_text(layout, "The threshold has changed: press Drill again.", icon="INFO")
        record = made_by(scene)
        if record is not None and record["strokes"] and not record["newer_strokes"]:
            draw_text(layout, f"{strokes_text(record)}. Red in the slices.")
        elif strokes:
            count, them = ("1 stroke", "it") if len(strokes) == 1 else (f"{len(strokes)} strokes", "them")
            draw_text(layout, f"{count} drilled: Make Surface applies {them}, Save Case keeps {them} as drill.toml.")
