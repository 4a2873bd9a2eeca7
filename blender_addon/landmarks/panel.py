"""The panel Landmarks: the list, the solution and its uncertainty."""

import bpy
import numpy as np

from ..pipeline.alignment.pose_uncertainty import PoseUncertainty
from ..pipeline.errors import InputError
from ..pipeline.files.numbers import format_two_digits
from ..state import pose_evidence
from ..state.properties import ONEFRAME_PG_landmark, ONEFRAME_PG_scene
from ..ui.keymap import LANDMARK_TOOL, PIN_TOOL, TOOLS, active_tool, draw_key
from ..ui.panel import AlignmentPanel, StepPanel, draw_text
from . import solve
from .solve import Solution


class ONEFRAME_UL_landmarks(bpy.types.UIList):
    """One landmark per row: use, name, residual"""

    def draw_item(  # noqa: PLR0913  # as Blender calls it
        self,
        context: bpy.types.Context,
        layout: bpy.types.UILayout,
        data: ONEFRAME_PG_scene,
        item: ONEFRAME_PG_landmark,
        icon: int,
        active_data: ONEFRAME_PG_scene,
        active_property: str,
        index: int = 0,
        flt_flag: int = 0,
    ) -> None:
        row = layout.row(align=True)
        row.prop(item, "enabled", text="")
        row.prop(item, "name", text="", emboss=False)
        text, symbol = _row_text(context.scene, item, index)
        value = row.row()
        value.alignment = "RIGHT"
        value.active = item.enabled
        value.label(text=text, icon=symbol)


class ONEFRAME_PT_landmarks(AlignmentPanel, StepPanel):
    """Correspondences that determine the pose"""

    bl_label = "2  Pin"
    bl_order = 2

    def draw_header_preset(self, context: bpy.types.Context) -> None:
        settings = context.scene.oneframe
        icon = "HIDE_OFF" if settings.show_landmarks else "HIDE_ON"
        self.layout.prop(settings, "show_landmarks", text="", icon=icon, emboss=False)

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.operator_context = "INVOKE_DEFAULT"
        row = layout.row(align=True)
        row.enabled = context.mode == "OBJECT"
        active = active_tool(context)
        for name, icon in ((PIN_TOOL, "PINNED"), (LANDMARK_TOOL, "EYEDROPPER")):
            row.operator("wm.tool_set_by_id", text=TOOLS[name], icon=icon, depress=active == name).name = name


class ONEFRAME_PT_landmark_list(AlignmentPanel):
    """All landmarks, and how sure the pose of them is"""

    bl_parent_id = "ONEFRAME_PT_landmarks"
    bl_label = "Landmarks"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        layout, settings = self.layout, context.scene.oneframe
        layout.operator_context = "INVOKE_DEFAULT"
        row = layout.row()
        row.template_list(ONEFRAME_UL_landmarks.__name__, "", settings, "landmarks", settings, "landmark_index", rows=5)
        column = row.column(align=True)
        column.operator("oneframe.landmark_set", text="", icon="ADD")
        column.operator("oneframe.landmark_remove", text="", icon="REMOVE")
        column.separator()
        column.operator("oneframe.landmarks_clear", text="", icon="TRASH")
        column.separator()
        column.operator("oneframe.import_landmarks", text="", icon="IMPORT")
        layout.prop(settings, "click_sigma_px", text="Click Noise (px)")
        try:
            _draw_solution(layout, context.scene, solve.solution(context.scene))
        except InputError as error:
            draw_text(layout, str(error), icon="ERROR")


def _draw_solution(layout: bpy.types.UILayout, scene: bpy.types.Scene, solved: Solution) -> None:
    """The buttons first, then figures in slots that stay as high as they are: nothing moves under the pointer."""
    found, away = solved.estimate, solve.departure_px(scene, solved)
    # by shares: three of one width would cut a name off
    row = layout.split(factor=0.32, align=True)
    solving, other = row.row(align=True), row.split(factor=0.75, align=True)
    solving.enabled, other.enabled = away is not None or bool(solved.doubtful), len(solved.doubtful) > 1
    solving.operator("oneframe.solve_landmarks", icon="CHECKMARK")
    other.operator("oneframe.other_pose", icon="FILE_REFRESH")
    draw_key(other, "oneframe.other_pose")
    text, icon = solved.refusal, "ERROR" if solved.doubtful else "INFO"
    if solved.alignment is not None and found is not None:
        text = f"{int(found.inliers.sum())} of {len(solved.alignment.landmarks)} correspondences"
        text, icon = f"{text}, RMS reprojection error {found.rms_px:.2f} px", "NONE"
        if away is not None:
            kept = "The refined pose stays when landmarks change. " if pose_evidence.is_refined(scene) else ""
            text, icon = (
                f"{kept}Solve would move the surface by up to {away:.1f} px in the frame: {text}.",
                "INFO",
            )
    draw_text(layout, text if scene.oneframe.landmarks else "", icon=icon)
    draw_uncertainty(layout.box(), None if found is None or away is not None else found.uncertainty)
    if found is not None and away is None:
        for message in found.messages:
            draw_text(layout, message, icon="ERROR")
    _draw_doubtful(layout, scene, solved)


def _draw_doubtful(layout: bpy.types.UILayout, scene: bpy.types.Scene, solved: Solution) -> None:
    """The poses that all fit: none has an uncertainty of its own, as another may be the right one."""
    if len(solved.doubtful) < 2:
        return
    shown = solve.shown_pose(scene, solved)
    for number, probability in enumerate(solved.probabilities):
        text = f"Pose {number + 1} of {len(solved.doubtful)}: {probability:.0%} by the clicks"
        layout.label(text=text, icon="HIDE_OFF" if number == shown else "BLANK1")


def draw_uncertainty(box: bpy.types.UILayout, uncertainty: PoseUncertainty | None) -> None:
    """Draw the standard deviations of a pose, and its least certain direction; without figures if not known."""
    box.label(text="Standard Deviations")
    columns = box.row(align=True)
    kinds = zip(
        (("Pitch", "Yaw", "Roll"), ("Right", "Down", "Depth")),
        np.full((2, 3), np.nan) if uncertainty is None else (uncertainty.rotation_deg, uncertainty.translation_mm),
        ("°", " mm"),
        strict=True,
    )
    for names, deviations, unit in kinds:
        column = columns.column(align=True)
        column.scale_y = 0.8
        for name, deviation in zip(names, deviations, strict=True):
            column.label(text=name if np.isnan(deviation) else f"{name} ± {format_two_digits(deviation)}{unit}")
    draw_text(box, "" if uncertainty is None else f"Least certain: {uncertainty.weakest}", lines=2)


def _row_text(scene: bpy.types.Scene, item: ONEFRAME_PG_landmark, index: int) -> tuple[str, str]:
    if not item.has_pixel:
        return "No pixel" if item.has_point else "Empty", "NONE"
    if not item.has_point:
        return "No 3D point", "NONE"
    try:
        residual = solve.residuals_px(scene)[index]
        solved = solve.solution(scene)
        outlier = item.enabled and solved.is_outlier(index) and solve.is_current(scene, solved)
    except InputError:
        return "", "NONE"
    if not np.isfinite(residual).all():
        return "Behind camera", "ERROR"
    return f"{np.linalg.norm(residual):.1f} px", "ERROR" if outlier else "NONE"
