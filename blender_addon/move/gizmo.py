"""Handles at the pivot in the camera view: drag them to shift, roll or tilt the surface, or to change its depth."""

import bpy
import numpy as np
from mathutils import Matrix

from ..class_registration import class_registration
from ..pipeline.errors import InputError
from ..state import from_scene
from ..state.pose import pivot_of
from ..ui.frame_view import FrameView, shows_frame
from ..ui.keymap import LANDMARK_TOOL, PIN_TOOL, active_tool

_HANDLES = (
    ("shift", "VIEW_PAN", (0, 0)),
    ("roll", "FILE_REFRESH", (1, 0)),
    ("tilt", "ORIENTATION_GIMBAL", (0, 1)),
    ("depth", "ZOOM_ALL", (1, 1)),
)
"""Mode of the drag, icon, and (column, row) on the grid of handles to the lower right of the pivot."""

SIZE, GAP = 28.0, 34.0
"""Of a handle, and between handles: pixels at interface scale 1."""


class ONEFRAME_GGT_pose(bpy.types.GizmoGroup):
    """Handles to move the surface"""

    bl_label = "Move Surface"
    bl_space_type = "VIEW_3D"
    bl_region_type = "WINDOW"
    bl_options = {"PERSISTENT", "SCALE"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        settings = context.scene.oneframe
        if not settings.show_gizmo or not from_scene.is_set_up(context.scene) or not shows_frame(context):
            return False
        # the handles would catch clicks on landmarks near the pivot
        return active_tool(context) not in (PIN_TOOL, LANDMARK_TOOL)

    def setup(self, context: bpy.types.Context) -> None:
        self._handles = []
        for mode, icon, place in _HANDLES:
            handle = self.gizmos.new("GIZMO_GT_button_2d")
            handle.icon = icon
            handle.draw_options = {"BACKDROP", "OUTLINE"}
            handle.color, handle.alpha = (0.05, 0.05, 0.05), 0.55
            handle.color_highlight, handle.alpha_highlight = (0.2, 0.45, 0.8), 0.9
            handle.scale_basis = SIZE / 2
            handle.use_draw_modal = True
            handle.target_set_operator("oneframe.drag_pose").mode = mode
            self._handles.append((handle, place))

    def draw_prepare(self, context: bpy.types.Context) -> None:
        scene = context.scene
        try:
            pivot, _ = pivot_of(scene)
            pose = from_scene.cam_from_model(scene)
            view = FrameView.of(scene, context.region, context.region_data)
        except InputError:
            # the panel reports it
            for handle, _ in self._handles:
                handle.hide = True
            return
        pixel = view.camera.project((pose[:3, :3] @ pivot + pose[:3, 3])[None])[0]
        scale = context.preferences.system.ui_scale
        size = np.array([context.region.width, context.region.height], float)
        pivot_at = view.region_from_px(np.nan_to_num(pixel))
        # within reach even if the surface is out of view
        pivot_at = np.clip(pivot_at, 2 * GAP * scale, size - 2 * GAP * scale)
        for handle, place in self._handles:
            handle.hide = False
            right, down = place
            x, y = pivot_at + scale * GAP * np.array([right + 0.6, -down - 0.6])
            handle.matrix_basis = Matrix.Translation((x, y, 0.0))


register, unregister = class_registration(__name__)
