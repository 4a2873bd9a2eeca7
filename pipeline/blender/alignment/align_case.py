"""A case with a rough pose -> the case with its pose from landmarks, from the image, or from one after the other."""

from dataclasses import dataclass, replace

import numpy as np

from ...alignment.landmarks.align_landmarks import Alignment, align_landmarks, complete_landmarks
from ...alignment.landmarks.picture import marked
from ...alignment.landmarks.report import alignment_record
from ...alignment.landmarks.surface_distance import check_landmarks_belong, off_surface
from ...alignment.refinement.refine import Refinement, refine_pose
from ...case.case_file import Case
from ...case.loaded_case import LoadedCase, check_pose
from ...errors import InputError
from ...transforms import inverse_rigid
from ..case.load_case import load_case
from .frame_overlay import frame_overlay


@dataclass(frozen=True)
class AlignedCase:
    """A case and how its pose was found.

    Attributes
    ----------
    loaded
        The case in memory, with the new pose; ``loaded.case`` also has the record of it.
    alignment
        The pose from the landmarks, in the frame ``mesh``; ``None`` if there were no landmarks.
    refinement
        The refinement against the image; ``None`` if it was not asked for.
    messages
        Sentences about the files and the landmarks.
    """

    loaded: LoadedCase
    alignment: Alignment | None
    refinement: Refinement | None
    messages: tuple[str, ...]


def align_case(case: Case, *, click_sigma_px: float, refine: bool, tool: str, date: str) -> AlignedCase:
    """Find the pose of a case.

    Parameters
    ----------
    case
        Its landmarks are used if any is complete. Its pose may be rough: it decides where several poses fit the
        landmarks, and is where the refinement starts without landmarks.
    click_sigma_px
        Standard deviation of a click, in each image direction.
    refine
        Fit the surface to the image as well.
    tool, date
        Of the record in the case.

    Raises
    ------
    UndeterminedPose
        The landmarks do not determine a pose.
    InputError
        A file that cannot be used, landmarks of another surface, a pose that does not show the surface, or a refused
        refinement without landmarks.
    """
    loaded = load_case(case, aligned=False)
    alignment, refinement = None, None
    sentences: tuple[str, ...] = ()
    if complete_landmarks(case.landmarks) or not refine:
        alignment = align_landmarks(
            case.landmarks, case.camera, click_sigma_px=click_sigma_px, start=case.cam_from_mesh
        )
        mesh = loaded.mesh.moved(loaded.mesh_from_model[:3, 3])
        # before the pose, which would be blamed for landmarks of another mesh
        check_landmarks_belong(case.landmarks, mesh, case.mesh.name)
        sentences = (*off_surface(case.landmarks, mesh), *alignment.estimate.messages)
        # the landmarks are in the frame of the mesh file, and so is the pose
        cam_from_mesh = alignment.estimate.cam_from_model
        loaded = _with_pose(loaded, cam_from_mesh, alignment_record(alignment, tool, date))
        check_pose(loaded.case, loaded.mesh, loaded.cam_from_model)
    if refine:
        refinement = refine_pose(loaded.image, loaded.valid, case.camera, loaded.mesh, loaded.cam_from_model)
        if refinement.accepted:
            cam_from_mesh = refinement.cam_from_model @ inverse_rigid(loaded.mesh_from_model)
            loaded = _with_pose(loaded, cam_from_mesh, {"method": "refined", "tool": tool, "date": date})
        elif alignment is None:
            raise InputError(f"{case.path.name}: {refinement.message}")
    return AlignedCase(loaded, alignment, refinement, (*loaded.messages, *sentences))


def alignment_picture(aligned: AlignedCase) -> np.ndarray:
    """``(H, W, 3)`` float32 values 0..1: the frame with its overlay and, if there are any, landmarks and residuals."""
    overlay = frame_overlay(aligned.loaded)
    return marked(overlay, aligned.alignment) if aligned.alignment else overlay


def _with_pose(loaded: LoadedCase, cam_from_mesh: np.ndarray, record: dict[str, object]) -> LoadedCase:
    return replace(
        loaded,
        case=replace(loaded.case, cam_from_mesh=cam_from_mesh, alignment=record),
        cam_from_model=cam_from_mesh @ loaded.mesh_from_model,
    )
