"""Align a case: by its landmarks, then against its image from there."""

from dataclasses import dataclass

import numpy as np

from ..case.case_file import Case
from ..case.loaded_case import LoadedCase, check_pose, load_case
from ..case.pose_record import UNKNOWN, PoseRecord
from ..errors import InputError
from ..files.numbers import format_two_digits
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

CONVENTION = (
    "cam_from_mesh maps points of the mesh file (mm) to a camera with OpenCV axes: x right, y down, z forward; "
    "pixel (0, 0) is the centre of the top-left pixel of the undistorted frame"
)


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
    """

    loaded: LoadedCase
    alignment: Alignment | None
    refinement: Refinement | None
    messages: tuple[str, ...]

    def lines(self) -> list[str]:
        """The report: the pose with all its digits, what it rests on, and what is doubtful."""
        refinement, alignment = self.refinement, self.alignment
        lines = [] if alignment is None else _landmark_lines(alignment)
        lines += [f"note: {message}" for message in self.messages]
        if refinement is not None:
            lines.append(refinement.message if refinement.accepted else f"note: {refinement.message}")
        by_landmarks = alignment is not None and not (refinement is not None and refinement.accepted)
        return lines if by_landmarks else [*lines, *_pose_lines(self.loaded.case.cam_from_mesh)]


def align_case(
    case: Case,
    *,
    click_sigma_px: float,
    refine: bool,
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
    alignment, refinement = None, None
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
        if not refinement.accepted and alignment is None:
            raise InputError(f"{case.path.name}: {refinement.message}")
        if refinement.accepted:
            initial = loaded.case.alignment
            initial = PoseRecord("manual") if initial == UNKNOWN else initial
            record = refinement.record(initial, tool, date)
            loaded = loaded.posed(refinement.found @ model_from_mesh, record)
    about_pairs = () if alignment is None else alignment.estimate.messages
    return AlignedCase(loaded, alignment, refinement, (*loaded.messages, *messages, *about_pairs))


def _pose_lines(cam_from_mesh: np.ndarray) -> list[str]:
    """A pose (4x4, mm) in both directions with all its digits."""
    forth, back = _rows(cam_from_mesh), _rows(inverse_rigid(cam_from_mesh))
    return [CONVENTION, "cam_from_mesh:", *forth, "mesh_from_cam:", *back]


def _landmark_lines(alignment: Alignment) -> list[str]:
    """The pose in both directions with all its digits, the residuals and the uncertainty; landmarks in ``mesh``."""
    estimate, uncertainty = alignment.estimate, alignment.estimate.uncertainty
    lines = _pose_lines(estimate.cam_from_model)
    width = max(len("landmark"), *(len(landmark.name) for landmark in alignment.landmarks))
    lines.append(f"{'landmark':{width}}    du px    dv px   off px")
    for landmark, apart, inlier in zip(alignment.landmarks, estimate.residuals_px, estimate.inliers, strict=True):
        numbers = "".join(f"{value:9.2f}" for value in (*apart, np.linalg.norm(apart)))
        lines.append(f"{landmark.name:{width}}{numbers}{'' if inlier else '   left out'}")
    lines += [
        f"residuals: rms {estimate.rms_px:.2f} px over {estimate.inliers.sum()} of {len(estimate.inliers)} landmarks, "
        f"clicks taken as {uncertainty.sigma_px:.2f} px uncertain",
        f"standard deviations about camera x, y, z: {_three(uncertainty.rotation_deg)} degrees",
        f"standard deviations along camera x, y, z: {_three(uncertainty.translation_mm)} mm",
        f"weakest: {uncertainty.weakest}",
    ]
    return lines


def _rows(matrix: np.ndarray) -> list[str]:
    # repr of a Python float is the shortest text that reads back to the same number
    return [f"  {row}," for row in matrix.tolist()]


def _three(values: np.ndarray) -> str:
    return ", ".join(map(format_two_digits, values))
