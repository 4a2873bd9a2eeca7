"""Align a case: by its landmarks, then against its image from there."""

from dataclasses import dataclass

import numpy as np

from ..case.case_file import Case
from ..case.loaded_case import LoadedCase, check_pose, frame_overlay, load_case
from ..case.pose_record import UNKNOWN, PoseRecord
from ..errors import InputError
from ..transforms import inverse_rigid
from .landmarks.align_landmarks import (
    Alignment,
    align_landmarks,
    check_landmarks_belong,
    complete_landmarks,
    landmark_distances,
    off_surface,
)
from .landmarks.degeneracy import UndeterminedPose
from .refinement.refine import refine_pose
from .refinement.verdict import Refinement
from .report import marked, pose_lines, pose_table, refinement_table, report_lines, report_table


@dataclass(frozen=True)
class AlignedCase:
    """An aligned case and how its pose was found.

    Attributes
    ----------
    loaded
        The case in memory, with the new pose; ``loaded.case`` also records how it was found.
    alignment
        The pose from the landmarks, in the frame ``mesh``; ``None`` without landmarks that determine a pose.
    refinement
        The refinement against the image, from the pose of the landmarks; ``None`` if not requested.
    messages
        Messages about the files and the landmarks.
    took_refused
        Whether the pose is that of a refused refinement.
    """

    loaded: LoadedCase
    alignment: Alignment | None
    refinement: Refinement | None
    messages: tuple[str, ...]
    took_refused: bool = False

    @property
    def by_landmarks(self) -> Alignment | None:
        """The pose from landmarks, if it is that of the case."""
        is_refined = self.took_refused or (self.refinement is not None and self.refinement.accepted)
        return None if is_refined else self.alignment

    def lines(self) -> list[str]:
        """The report: the pose with all its digits, what it rests on, and what is doubtful."""
        refinement, alignment = self.refinement, self.alignment
        lines = [] if alignment is None else report_lines(alignment)
        lines += [f"note: {message}" for message in self.messages]
        if refinement is not None and self.took_refused:
            lines.append(f"warning: taken although refused: {refinement.objection}")
        elif refinement is not None:
            lines.append(refinement.message if refinement.accepted else f"note: {refinement.message}")
        return lines if self.by_landmarks else [*lines, *pose_lines(self.loaded.case.cam_from_mesh)]

    def table(self) -> dict[str, object]:
        """The report for JSON."""
        alignment, refinement = self.alignment, self.refinement
        table: dict[str, object] = {} if alignment is None else report_table(alignment)
        if not self.by_landmarks:
            # residuals and uncertainty of the landmarks belong to their own pose
            table = {"start": table} if table else {}
        if refinement is not None:
            mesh_from_model = self.loaded.surface.mesh_from_model
            table["refinement"] = refinement_table(refinement, mesh_from_model, taken=self.took_refused)
        return {**table, **pose_table(self.loaded.case.cam_from_mesh)}

    def picture(self) -> np.ndarray:
        """``(H, W, 3)`` float32 values 0..1: frame and overlay; landmarks and residuals if the pose is theirs."""
        overlay, found = frame_overlay(self.loaded), self.by_landmarks
        return overlay if found is None else marked(overlay, found)


def align_case(
    case: Case,
    *,
    click_sigma_px: float,
    refine: bool,
    take_refused: bool = False,
    tool: str,
    date: str,
) -> AlignedCase:
    """Find the pose of a case.

    Parameters
    ----------
    case
        Its landmarks are used if any is complete. Its pose may be rough: it decides between several poses that fit the
        landmarks, and is the initial pose of the refinement if these determine none.
    click_sigma_px
        Standard deviation of the click noise, along each image axis.
    refine
        Refine the pose against the image.
    take_refused
        Take the pose that the refinement has found even if it refuses it; the record in the case says so.
    tool, date
        For the record in the case.

    Raises
    ------
    UndeterminedPose
        The evidence does not determine a pose.
    InputError
        A file cannot be used, the landmarks belong to another surface, the pose does not show the surface, or, without
        landmarks, the refinement is refused.
    """
    loaded = load_case(case, aligned=False)
    if not (case.posed or complete_landmarks(case.landmarks)):
        raise InputError(f"{case.path.name}: expected a pose or landmarks, found neither; align by landmarks first")
    alignment, refinement, took_refused = None, None, False
    start = case.cam_from_mesh if case.posed else None
    mesh = loaded.surface.mesh.moved(loaded.surface.mesh_from_model[:3, 3])
    # before the check of the pose, which would report landmarks of another mesh as a wrong pose
    distances = landmark_distances(case.landmarks, mesh)
    check_landmarks_belong(distances, mesh, case.mesh.name)
    messages = off_surface(distances)
    if complete_landmarks(case.landmarks) or not refine:
        try:
            alignment = align_landmarks(case.landmarks, case.camera, click_sigma_px=click_sigma_px, start=start)
        except UndeterminedPose as refusal:
            # the image may, from a rough pose
            if not refine or start is None:
                raise
            messages = (*messages, f"{refusal}; the refinement starts from the pose of the case")
        else:
            # the landmarks are in the frame of the mesh file, and so is the pose
            loaded = loaded.posed(alignment.estimate.cam_from_model, alignment.record(tool, date))
            check_pose(loaded.case, loaded.surface.mesh, loaded.frame.cam_from_model)
    if refine:
        frame, model_from_mesh = loaded.frame, inverse_rigid(loaded.surface.mesh_from_model)
        refinement = refine_pose(frame.image, frame.valid, case.camera, loaded.surface.mesh, frame.cam_from_model)
        took_refused = take_refused and refinement.can_be_taken
        if not refinement.accepted and not took_refused and alignment is None:
            taken = " --take-refused takes what it has found." if refinement.can_be_taken else ""
            raise InputError(f"{case.path.name}: {refinement.message}{taken}")
        if refinement.accepted or took_refused:
            initial = loaded.case.alignment
            initial = PoseRecord("manual") if initial == UNKNOWN else initial
            record = refinement.record(initial, tool, date)
            loaded = loaded.posed(refinement.found @ model_from_mesh, record)
    found = alignment.estimate.messages if alignment is not None and not took_refused else ()
    return AlignedCase(loaded, alignment, refinement, (*loaded.messages, *messages, *found), took_refused)
