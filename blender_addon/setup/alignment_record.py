"""How the current pose was found, for the record in the case file."""

import datetime
from dataclasses import replace
from pathlib import Path

import bpy

from ..landmarks import solve
from ..pipeline import __version__
from ..pipeline.alignment.refinement.verdict import Refinement
from ..pipeline.case.case_file import Case
from ..pipeline.case.pose_record import INITIAL_GUESS, OTHER_FRAME, UNKNOWN, PoseRecord
from ..state import from_scene, pose_evidence
from .operators import doubt_of_size


def recorded_case(scene: bpy.types.Scene, path: Path) -> Case:
    """The scene as a case (see :func:`.from_scene.case`) with the record of its pose."""
    return replace(from_scene.case(scene, path), alignment=pose_record(scene))


def pose_record(scene: bpy.types.Scene) -> PoseRecord:
    """The record of the pose for the case file."""
    tool, date = tool_and_date()
    record = pose_evidence.remembered(scene)
    if record is not None and record != UNKNOWN:
        # pins and doubtful poses are recorded where the tool is not known; other records stay as they are
        is_unsigned = not record.tool and (record.method == "pins" or record.doubt)
        return replace(record, tool=tool, date=date) if is_unsigned else record
    solved = solve.solution(scene)
    if solved.alignment is not None and solve.departure_px(scene, solved) is None:
        return solved.alignment.record(tool, date)
    # unknown: given by the case, and not moved since
    return PoseRecord("manual", tool, date) if record is None else record


def is_start(scene: bpy.types.Scene) -> bool:
    """Whether nobody has aligned the pose in this frame."""
    return pose_record(scene).is_start


def doubts(scene: bpy.types.Scene) -> tuple[str, ...]:
    """What is in doubt about the case while it lasts, in sentences: the surface's size, a pose nobody is sure of."""
    size, record = doubt_of_size(scene, from_scene.surface_extents(scene)), pose_record(scene)
    found = [] if size is None else [f"In doubt: {size.message}."]
    if record.method == INITIAL_GUESS:
        found.append("The pose is an initial guess: nobody has aligned it with the frame.")
    if record.method == OTHER_FRAME:
        found.append(f"The pose was {record.doubt or 'found in another frame'}: nobody has aligned it with this one.")
    elif record.doubt:
        found.append(f"The pose is in doubt: {record.doubt}.")
    if record.refused:
        found.append(f"The refinement was refused, and its pose taken all the same: {record.refused}.")
    return tuple(found)


def remember_refined(scene: bpy.types.Scene, refinement: Refinement, start: PoseRecord) -> None:
    """Store how a refinement has found its pose; ``start`` is the record of the initial one."""
    start = PoseRecord("manual") if start == UNKNOWN else start
    record = refinement.record(start, *tool_and_date())
    uncertainty = refinement.uncertainty if refinement.verified else None
    pose_evidence.remember(scene, record, refinement.found, uncertainty)


def tool_and_date() -> tuple[str, str]:
    """The program and today, for records."""
    return f"OneFrame {__version__}, Blender {bpy.app.version_string}", datetime.date.today().isoformat()
