"""Align a case with a rough pose: from its landmarks, against its image, or both in this order."""

from dataclasses import dataclass, replace

import numpy as np

from ...alignment.landmarks.align_landmarks import (
    Alignment,
    align_landmarks,
    check_landmarks_belong,
    complete_landmarks,
    landmark_distances,
    off_surface,
)
from ...alignment.landmarks.picture import marked
from ...alignment.landmarks.report import alignment_record
from ...alignment.refinement.refine import refine_pose
from ...alignment.refinement.report import refinement_record
from ...alignment.refinement.verdict import Refinement
from ...case.case_file import Case
from ...case.loaded_case import LoadedCase, check_pose
from ...errors import InputError
from ...transforms import inverse_rigid
from ..case.load_case import load_case
from .overlay_picture import frame_overlay


@dataclass(frozen=True)
class AlignedCase:
    """An aligned case and how its pose was found.

    Attributes
    ----------
    loaded
        The case in memory, with the new pose; ``loaded.case`` also records how it was found.
    alignment
        The pose from the landmarks, in the frame ``mesh``; ``None`` without landmarks.
    refinement
        The refinement against the image; ``None`` if not requested.
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
    def is_refined(self) -> bool:
        """Whether the pose is a refined one, and not that of the landmarks."""
        return self.took_refused or (self.refinement is not None and self.refinement.accepted)


def align_case(
    case: Case, *, click_sigma_px: float, refine: bool, take_refused: bool = False, tool: str, date: str
) -> AlignedCase:
    """Find the pose of a case.

    Parameters
    ----------
    case
        Its landmarks are used if any is complete. Its pose may be rough: it decides between several poses that fit the
        landmarks, and is the initial pose of the refinement if there are no landmarks.
    click_sigma_px
        Standard deviation of the click noise, along each image axis.
    refine
        Also refine the pose against the image.
    take_refused
        Take the pose that the refinement has found even if it refuses it; the record in the case says so.
    tool, date
        For the record in the case.

    Raises
    ------
    UndeterminedPose
        The landmarks do not determine a pose.
    InputError
        A file cannot be used, the landmarks belong to another surface, the pose does not show the surface, or, without
        landmarks, the refinement is refused.
    """
    loaded = load_case(case, aligned=False)
    if not (case.posed or complete_landmarks(case.landmarks)):
        raise InputError(f"{case.path.name}: expected a pose or landmarks, found neither; align by landmarks first")
    alignment, refinement = None, None
    messages: tuple[str, ...] = ()
    if complete_landmarks(case.landmarks) or not refine:
        alignment = align_landmarks(
            case.landmarks, case.camera, click_sigma_px=click_sigma_px, start=case.cam_from_mesh if case.posed else None
        )
        mesh = loaded.surface.mesh.moved(loaded.surface.mesh_from_model[:3, 3])
        # before the check of the pose, which would report landmarks of another mesh as a wrong pose
        distances = landmark_distances(case.landmarks, mesh)
        check_landmarks_belong(distances, mesh, case.mesh.name)
        messages = (*off_surface(distances), *alignment.estimate.messages)
        # the landmarks are in the frame of the mesh file, and so is the pose
        cam_from_mesh = alignment.estimate.cam_from_model
        loaded = _with_pose(loaded, cam_from_mesh, alignment_record(alignment, tool, date))
        check_pose(loaded.case, loaded.surface.mesh, loaded.frame.cam_from_model)
    took_refused = False
    if refine:
        frame = loaded.frame
        refinement = refine_pose(frame.image, frame.valid, case.camera, loaded.surface.mesh, frame.cam_from_model)
        took_refused = take_refused and refinement.can_be_taken
        if refinement.accepted or took_refused:
            start = loaded.case.alignment or {"method": "manual"}
            cam_from_mesh = refinement.found @ inverse_rigid(loaded.surface.mesh_from_model)
            loaded = _with_pose(loaded, cam_from_mesh, refinement_record(refinement, start, tool, date))
        elif alignment is None:
            advice = " --take-refused takes what it has found." if refinement.can_be_taken else ""
            raise InputError(f"{case.path.name}: {refinement.message}{advice}")
    return AlignedCase(loaded, alignment, refinement, (*loaded.messages, *messages), took_refused)


def alignment_picture(aligned: AlignedCase) -> np.ndarray:
    """``(H, W, 3)`` float32 values 0..1: frame and overlay; landmarks and residuals if the pose is theirs."""
    overlay = frame_overlay(aligned.loaded)
    return marked(overlay, aligned.alignment) if aligned.alignment and not aligned.is_refined else overlay


def _with_pose(loaded: LoadedCase, cam_from_mesh: np.ndarray, record: dict[str, object]) -> LoadedCase:
    case = replace(loaded.case, cam_from_mesh=cam_from_mesh, alignment=record)
    pose = cam_from_mesh @ loaded.surface.mesh_from_model
    return replace(loaded, case=case, frames=(replace(loaded.frame, cam_from_model=pose), *loaded.frames[1:]))
