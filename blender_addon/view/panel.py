"""The panel View: how surface and frame are seen, each setting with its key."""

import bpy

from ..pipeline.errors import InputError
from ..ui.frame_view import shows_frame
from ..ui.keymap import draw_key
from ..ui.panel import AdvancedPanel, AlignmentPanel, draw_text
from .operators import CONTOUR, WIREFRAME, ONEFRAME_PG_view
from .overlay import frame_image_of


class ONEFRAME_PT_view(AlignmentPanel, AdvancedPanel):
    """See surface and frame"""

    bl_label = "View"
    bl_order = 2

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        scene = context.scene
        if not shows_frame(context):
            layout.operator("oneframe.show_frame", icon="OUTLINER_OB_CAMERA")
            return
        view = scene.oneframe_view
        try:
            self._draw(context, layout, view)
        except InputError as error:
            draw_text(layout, str(error), icon="ERROR")

    def _draw(self, context: bpy.types.Context, layout: bpy.types.UILayout, view: ONEFRAME_PG_view) -> None:
        row = layout.row(align=True)
        row.prop(view, "opacity", slider=True)
        row.operator("oneframe.cycle_opacity", text="", icon="FILE_REFRESH")
        draw_key(row, "oneframe.cycle_opacity")
        row = layout.row(align=True)
        row.prop(context.scene.oneframe.surface, "display_type", text="Surface")
        draw_key(row, "wm.context_toggle_enum", **dict(WIREFRAME))
        row = layout.row(align=True)
        row.prop(view, "contour", icon="MOD_EDGESPLIT", toggle=True)
        draw_key(row, "wm.context_toggle", **dict(CONTOUR))
        if view.contour:
            row.prop(view, "contour_color", text="")
        if frame_image_of(context.scene) is None:
            draw_text(layout, "No frame is loaded, or its file has moved. Load the frame.", icon="INFO")
        self._draw_zoom(layout)

    def _draw_zoom(self, layout: bpy.types.UILayout) -> None:
        row = layout.row(align=True)
        row.operator("oneframe.zoom_frame", text="1 : 1").to_pixels = True
        draw_key(row, "oneframe.zoom_frame", to_pixels=True)
        row.operator("oneframe.fit_frame", text="Fit")
        draw_key(row, "oneframe.fit_frame")
