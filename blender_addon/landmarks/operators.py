"""Operators that edit, solve, import and export landmarks, without a drag of the mouse."""

from collections.abc import Sequence

import bpy
import numpy as np
from bpy.props import BoolProperty, FloatVectorProperty, IntProperty, StringProperty

from ..class_registration import prop
from ..pipeline.case.case_file import MM_PER_UNIT
from ..pipeline.case.landmarks import read_landmarks
from ..pipeline.case.pose_record import UNKNOWN
from ..pipeline.errors import InputError
from ..pipeline.files.numbers import format_two_digits
from ..state import events, frame_in_view, from_scene, pose_evidence
from ..state.landmarks import landmarks_mesh, replace_landmarks
from ..ui.keymap import LANDMARK_TOOL, PIN_TOOL, Key, keys
from ..ui.operator import (
    Messages,
    NeedsAlignment,
    OpensFile,
    OperatorResult,
    Reporting,
    report_error,
)
from ..ui.question import ask_first
from . import edit, solve
from .gestures import is_alignment_view, landmark_under

INDEX = "Index in the list, counted from 0; -1 for the active landmark"
"""These properties do not keep the value of the last call: a button would act on the wrong landmark."""


class _HasLandmarks(NeedsAlignment):
    """Mixin: available once there are landmarks."""

    needs = (lambda context: bool(context.scene.oneframe.landmarks), "Pick a landmark first")


class ONEFRAME_OT_landmark_set(NeedsAlignment, Reporting):
    """Add a landmark, or set its surface point, image point or name"""

    bl_label = "Set Landmark"

    index: int = prop(
        IntProperty,
        "Index",
        "Index in the list, counted from 0; -1 for the landmark that lacks this point, or a new one",
        default=-1,
        min=-1,
        options={"SKIP_SAVE"},
    )
    name: str = prop(StringProperty, "Name", "New name; empty to keep the name", options={"SKIP_SAVE"})
    point: Sequence[float] = prop(
        FloatVectorProperty,
        "Surface Point",
        "Point on the surface in the frame model, mm",
        size=3,
        precision=4,
        options={"SKIP_SAVE"},
    )
    pixel: Sequence[float] = prop(
        FloatVectorProperty,
        "Image Point",
        "Pixel of the undistorted frame; (0, 0) is the centre of the top-left pixel",
        size=2,
        precision=3,
        options={"SKIP_SAVE"},
    )

    def run(self, context: bpy.types.Context) -> None:
        scene = context.scene
        frame_in_view.check_own(scene)
        is_given = self.properties.is_property_set
        point = np.array(self.point, float) if is_given("point") else None
        pixel = edit.check_pixel(scene, np.array(self.pixel, float)) if is_given("pixel") else None
        if self.index >= 0:
            index = edit.checked_index(scene, self.index)
        elif (point is None) == (pixel is None):
            index = edit.add(scene)
        else:
            index = edit.landmark_for_pick(scene, "point" if pixel is None else "pixel")
        if self.name:
            scene.oneframe.landmarks[index].name = self.name
        edit.set_halves(scene, index, point_model=point, pixel=pixel)


class _OnOneLandmark(bpy.types.Operator):
    """Mixin: acts on the landmark with an index, or on the one under the pointer if called by a key or click."""

    index: int = prop(IntProperty, "Index", INDEX, default=-1, min=-1, options={"SKIP_SAVE"})
    at_pointer: bool = prop(BoolProperty, options={"HIDDEN", "SKIP_SAVE"})
    result_without_landmark: OperatorResult = {"PASS_THROUGH"}

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> OperatorResult:
        if not self.at_pointer:
            return self.execute(context)
        if not is_alignment_view(context):
            return {"PASS_THROUGH"}
        try:
            found = landmark_under(context, event)
        except InputError as error:
            report_error(self, str(error))
            return {"CANCELLED"}
        if found is None:
            if self.result_without_landmark == {"CANCELLED"}:
                self.report({"INFO"}, "no landmark under the pointer")
            return self.result_without_landmark
        self.index = found
        return self.execute(context)


class ONEFRAME_OT_landmark_remove(_OnOneLandmark, _HasLandmarks, Reporting):
    """Delete a landmark"""

    bl_label = "Delete Landmark"
    # a click that misses a mark by a pixel must not let the key delete the surface
    result_without_landmark = {"CANCELLED"}

    def run(self, context: bpy.types.Context) -> None:
        edit.remove(context.scene, edit.checked_index(context.scene, self.index))


class ONEFRAME_OT_landmark_toggle(_OnOneLandmark, _HasLandmarks, Reporting):
    """Enable or disable a landmark for the pose"""

    bl_label = "Toggle Landmark"

    def run(self, context: bpy.types.Context) -> None:
        scene = context.scene
        index = edit.checked_index(scene, self.index)
        entry = scene.oneframe.landmarks[index]
        scene.oneframe.landmark_index = index
        # the property notifies listeners of its change
        entry.enabled = not entry.enabled


class ONEFRAME_OT_landmarks_clear(_HasLandmarks, Reporting):
    """Delete all landmarks; the pose stays"""

    bl_label = "Delete All Landmarks"

    def run(self, context: bpy.types.Context) -> None:
        replace_landmarks(context.scene, ())


class ONEFRAME_OT_solve_landmarks(_HasLandmarks, Reporting):
    """Move the surface to the pose that fits the landmarks"""

    bl_label = "Solve"

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> OperatorResult:
        """Ask before a refined pose is replaced."""
        scene = context.scene
        try:
            solved = solve.solution(scene)
            away = solve.departure_px(scene, solved)
            if away is None or not pose_evidence.is_refined(scene):
                return self.execute(context)
            record = pose_evidence.remembered(scene) or UNKNOWN
        except InputError as error:
            report_error(self, str(error))
            return {"CANCELLED"}
        off = "" if record.error_px is None else f", off by about {format_two_digits(record.error_px)} px"
        question = f"It comes from the image{off}. The landmarks' pose is up to {away:.1f} px away."
        ask_first(("Replace the Refined Pose?", question, "Solve"), "solve_landmarks")
        return {"CANCELLED"}

    def run(self, context: bpy.types.Context) -> Messages:
        scene = context.scene
        # raises for a scaled surface, which must not become rigid unnoticed
        from_scene.cam_from_model(scene)
        solved = solve.solution(scene)
        solve.apply(scene, solved)
        if solved.alignment is None:
            self.report({"WARNING"}, solved.refusal)
            return ()
        estimate = solved.alignment.estimate
        used = f"{int(estimate.inliers.sum())} of {len(solved.alignment.landmarks)} correspondences"
        return *estimate.messages, f"pose from {used}, RMS reprojection error {estimate.rms_px:.2f} px"


class ONEFRAME_OT_other_pose(_HasLandmarks, Reporting):
    """Move the surface to the next of the poses that fit the landmarks equally well"""

    bl_label = "Other Pose"

    def run(self, context: bpy.types.Context) -> Messages:
        scene = context.scene
        solved = solve.solution(scene)
        count = len(solved.doubtful)
        if count < 2:
            raise InputError("expected landmarks that fit several poses, found none or one pose; there is no other")
        shown = solve.shown_pose(scene, solved)
        number = 0 if shown is None else (shown + 1) % count
        solve.take_doubtful(scene, solved, number)
        return (f"pose {number + 1} of {count}, right with a probability of {solved.probabilities[number]:.0%}",)


class ONEFRAME_OT_import_landmarks(NeedsAlignment, OpensFile):
    """Import landmarks from a CSV or JSON file: surface points in the frame and units of the mesh file, and pixels"""

    bl_label = "Import Landmarks"

    filter_glob: str = prop(StringProperty, default="*.csv;*.json", options={"HIDDEN"})
    keep: bool = prop(BoolProperty, "Keep Existing", "Add to the existing landmarks instead of replacing them")

    def run(self, context: bpy.types.Context) -> Messages:
        scene = context.scene
        frame_in_view.check_own(scene)
        path = self.chosen_file()
        read = read_landmarks(path, mm_per_unit=MM_PER_UNIT[scene.oneframe.units])
        existing = landmarks_mesh(scene) if self.keep else ()
        replace_landmarks(scene, (*existing, *read))
        events.landmarks_changed(scene)
        messages = [f"{path.name}: {len(read)} landmarks", *solve.off_surface(scene)]
        if pose_evidence.is_refined(scene):
            messages.append("the refined pose is unchanged; press Solve to replace it by that of the landmarks")
        return messages


def _on_mark(operator: str, key: str, *, alt: bool = False) -> Key:
    return Key(operator, key, alt=alt, properties=(("at_pointer", True),), tools=(PIN_TOOL, LANDMARK_TOOL))


PARTS = (
    keys(
        _on_mark("oneframe.landmark_toggle", "LEFTMOUSE", alt=True),
        _on_mark("oneframe.landmark_remove", "X"),
        _on_mark("oneframe.landmark_remove", "DEL"),
        Key("oneframe.other_pose", "O"),
    ),
)
