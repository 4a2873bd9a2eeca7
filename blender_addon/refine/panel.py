"""The panel Refine, and the one that says what the pose rests on: landmarks, pins, the image or the hand."""

from collections.abc import Mapping

import bpy

from ..landmarks import solve
from ..pipeline.errors import InputError
from ..pipeline.files.numbers import format_two_digits
from ..setup.alignment_record import pose_record
from ..state import image_evidence, pose_evidence
from ..ui.keymap import draw_key
from ..ui.panel import AlignmentPanel, draw_text
from ..ui.step_panel import PartPanel, StepPanel
from . import operator
from .preview import error_text, preview_text
from .status_line import KINDS, kind_of

FIGURE_LINES, MESSAGE_LINES = 4, 6
"""Of the slots that stay as high as they are when a result appears: no button moves under the pointer."""


class ONEFRAME_PT_refine(AlignmentPanel, StepPanel):
    """Refine the rough pose against the image"""

    bl_label = "5  Refine"
    bl_order = 6
    step = "refine"

    def draw_step(self, context: bpy.types.Context, layout: bpy.types.UILayout) -> None:
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
        refused = found is not None and found.can_be_taken
        row = layout.row()
        row.enabled = refused and not taken and not previewed
        row.operator("oneframe.take_refused", icon="HIDE_OFF")
        table = layout.column(align=True)
        head = table.split(factor=0.35)
        for name in ("", "Before", "Refused" if refused else "After"):
            head.label(text=name)
        figures = {"Explained": ("", ""), "Off By": ("", "")}
        message, icon = "", "NONE"
        if found is not None:
            figures["Explained"] = f"{found.before.score:.0%}", f"{found.after.score:.0%}"
            figures["Off By"] = error_text(found, refined=False), error_text(found, refined=True)
            message, icon = found.message, "CHECKMARK" if found.accepted else "ERROR"
            if refused and (taken or previewed):
                words = "Taken although refused" if taken else preview_text(found)
                message = f"{words}: {found.objection}"
        for name, values in figures.items():
            row = table.split(factor=0.35)
            for text in (name, *values):
                row.label(text=text)
        draw_text(layout, message, icon=icon, lines=MESSAGE_LINES)


class ONEFRAME_PT_evidence(PartPanel):
    """What the current pose rests on, as the case file records it"""

    bl_parent_id = "ONEFRAME_PT_refine"
    bl_label = "Pose Rests On"

    def draw(self, context: bpy.types.Context) -> None:
        layout, scene = self.layout, context.scene
        try:
            found = operator.outcome(scene)
            if found is not None and operator.is_previewed(scene):
                draw_text(layout, preview_text(found), icon="SNAP_ON", lines=1 + FIGURE_LINES)
                return
            record = pose_record(scene)
            title, icon = kind_of(scene, record)
        except InputError:
            return  # the sidebar says what is wrong with the pose
        layout.label(text=title, icon=icon)
        _draw_kinds(layout, scene)
        lines = layout.column(align=True)
        lines.scale_y = 0.8
        texts = record_lines(record)
        for line in (*texts, *[""] * (FIGURE_LINES - len(texts))):
            lines.label(text=line)
        if "weakest" in record:
            draw_text(layout, f"Least certain: {record['weakest']}")
        origin = ", ".join(str(record[key]) for key in ("tool", "date") if key in record)
        if pose_evidence.remembered(scene) and origin:
            draw_text(layout, origin)


def _draw_kinds(layout: bpy.types.UILayout, scene: bpy.types.Scene) -> None:
    """Each kind of evidence: whether it takes part, and how far it pulls the pose."""
    column, pulls = layout.column(align=True), solve.pulls(scene)
    for kind, is_there in (
        ("landmarks", len(scene.oneframe.landmarks) > 0),
        ("image", bool(image_evidence.held(scene))),
    ):
        row = column.row(align=True)
        row.enabled = is_there
        row.prop(scene.oneframe, f"use_{kind}")
        pull = pulls.get(kind, 0.0)
        text = "decides alone" if pull is None else f"pulls {format_two_digits(pull)} px" if kind in pulls else ""
        row.label(text=text)


def record_lines(record: Mapping[str, object]) -> list[str]:
    """The figures of a record, one a line; what it does not know is left out."""
    number = {key: value for key, value in record.items() if isinstance(value, int | float)}
    lines = []
    if "error_px" in number:
        bound = "at least" if "refused" in record else "about"
        lines.append(f"Off by {bound} {format_two_digits(number['error_px'])} px")
    if "pairs" in number:
        rms = f", RMS {number['rms_px']:.2f} px" if "rms_px" in number else ""
        lines.append(f"{_counted(number['pairs'], 'correspondence')}{rms}")
    if "explained" in number:
        lines.append(f"{number['explained']:.0%} of the image explained")
    if "start_method" in record:
        start = KINDS.get(str(record["start_method"]), (str(record["start_method"]), ""))[0]
        figures = [str(record["start_frame"])] if "start_frame" in record else []
        figures += [_counted(number["start_pairs"], "pair")] if "start_pairs" in number else []
        figures += [f"off by {format_two_digits(number['start_error_px'])} px"] if "start_error_px" in number else []
        lines.append(f"Started: {start[0].lower()}{start[1:]}" + "".join(f", {figure}" for figure in figures))
    for key, unit in (("standard_deviation_deg", "°"), ("standard_deviation_mm", " mm")):
        values = record.get(key)
        if isinstance(values, list | tuple):
            lines.append("± " + ", ".join(format_two_digits(value) for value in values) + f"{unit} (x, y, z)")
    return lines


def _counted(count: float, noun: str) -> str:
    return f"{count} {noun}" + ("" if count == 1 else "s")
