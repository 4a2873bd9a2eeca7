"""The panel View: the comparisons of surface and frame, each with its key."""

import bpy

from ..pipeline.errors import InputError
from ..ui.frame_view import shows_frame
from ..ui.keymap import draw_key
from ..ui.panel import AlignmentPanel, draw_text
from ..ui.step_panel import StepPanel
from .operators import ONEFRAME_PG_view, toggling
from .overlay import frame_image_of
from .second_view import second_view


class ONEFRAME_PT_view(AlignmentPanel, StepPanel):
    """Compare surface and frame"""

    bl_label = "2  View"
    bl_order = 3
    step = "view"

    def draw_step(self, context: bpy.types.Context, layout: bpy.types.UILayout) -> None:
        scene = context.scene
        row = layout.row(align=True)
        row.operator("oneframe.side_by_side", icon="WINDOW", depress=second_view(context.screen) is not None)
        if shows_frame(context):
            row.operator("oneframe.orbit_surface", text="Orbit", icon="ORIENTATION_VIEW")
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
        for name, icon in (("wireframe", "MOD_WIREFRAME"), ("contour", "MOD_EDGESPLIT")):
            row = layout.row(align=True)
            row.prop(view, name, icon=icon, toggle=True)
            draw_key(row, "wm.context_toggle", **dict(toggling(name)))
        if view.contour:
            row = layout.row(align=True)
            row.prop(view, "contour_color", text="")
            row.prop(view, "crease_deg", text="Crease (°)")
        if frame_image_of(context.scene) is None:
            draw_text(layout, "No frame is loaded, or its file has moved. Load the frame.", icon="INFO")
        for value, icon in (
            ("NONE", "X"),
            ("BLINK", "HIDE_OFF"),
            ("SWIPE", "ARROW_LEFTRIGHT"),
            ("DIFFERENCE", "SELECT_DIFFERENCE"),
        ):
            row = layout.row(align=True)
            row.prop_enum(view, "comparison", value, icon=icon)
            draw_key(row, "wm.context_toggle_enum", **dict(toggling("comparison", value)))
        if view.comparison == "SWIPE":
            layout.prop(view, "split", slider=True)
        if view.comparison == "DIFFERENCE":
            layout.prop(view, "gain")
        self._draw_zoom(layout)
        layout.prop(view, "loupe")

    def _draw_zoom(self, layout: bpy.types.UILayout) -> None:
        row = layout.row(align=True)
        row.operator("oneframe.zoom_frame", text="1 : 1").magnification = 1.0
        draw_key(row, "oneframe.zoom_frame", magnification=1.0)
        row.operator("oneframe.fit_frame", text="Fit")
        draw_key(row, "oneframe.fit_frame")
        column = layout.column(align=True)
        column.enabled = False
        column.label(text="Wheel: Zoom to Pointer")
        column.label(text="Shift + Middle Button: Pan")
