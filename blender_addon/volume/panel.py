"""The panel CT: the CT, the threshold, the surface."""

import bpy

from ..ui.panel import AdvancedPanel, draw_text
from .ct import LoadedCT, ct_of, key_of


class ONEFRAME_PT_ct(AdvancedPanel):
    """From a CT to the surface"""

    bl_label = "CT"
    bl_order = 1

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        scene = context.scene
        layout.operator_context = "INVOKE_DEFAULT"
        layout.operator("oneframe.open_ct", icon="FILE_FOLDER")
        if key_of(scene) is None:
            draw_text(layout, "NIfTI, NRRD, or a folder of DICOM slices. Or drop a file onto the view.")
            return
        ct = ct_of(scene)
        if ct is None:
            draw_text(layout, "The CT is not in memory.", icon="INFO")
            again = layout.operator("oneframe.open_ct", text="Read CT Again", icon="FILE_REFRESH")
            again.filepath, again.series = scene.oneframe_ct.path, scene.oneframe_ct.series
            return
        self._draw(context, layout, ct)

    def _draw(self, context: bpy.types.Context, layout: bpy.types.UILayout, ct: LoadedCT) -> None:
        settings = context.scene.oneframe_ct
        name, grid = bpy.path.basename(settings.path.rstrip("/\\")), ct.volume.grid
        column = layout.column(align=True)
        column.label(text=name, icon="VOLUME_DATA")
        spacing = " x ".join(f"{step:.3g}" for step in grid.spacing_mm)
        column.label(text=f"{' x '.join(map(str, grid.size))}, {spacing} mm")
        row = layout.row(align=True)
        row.prop(settings, "threshold_hu", text="Bone", slider=True)
        row.operator("oneframe.otsu", text="Otsu")
        layout.operator("oneframe.open_labels", icon="OUTLINER_OB_MESH")
        if ct.labels is not None:
            layout.label(text=f"{len(ct.labels.names)} labels")
        layout.operator("oneframe.make_surface", icon="MESH_DATA")
