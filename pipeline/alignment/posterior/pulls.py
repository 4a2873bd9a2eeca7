"""How far each kind of evidence pulls the pose: the shift in the image when it is left out. Needs ``cv2``."""

from collections.abc import Sequence

import numpy as np

from ...transforms import transform_points
from ..landmarks.align_landmarks import LANDMARKS, Alignment
from ..landmarks.degeneracy import UndeterminedPose
from .evidence import PoseEvidence
from .solve import pose_posterior


def pulls_px(found: Alignment, evidence: Sequence[PoseEvidence], points_model: np.ndarray) -> dict[str, float | None]:
    """Kind of evidence -> median shift of surface points in the image when this kind is left out.

    ``None`` where the rest determines no pose.

    Parameters
    ----------
    found
        The pose from all evidence.
    evidence
        All but the landmarks.
    points_model
        ``(N, 3)`` points of the visible surface, mm.
    """
    shown = found.camera.project(transform_points(found.estimate.cam_from_model, points_model))
    pulls: dict[str, float | None] = {}
    for kind in (LANDMARKS, *(each.kind for each in evidence)):
        if kind == LANDMARKS and not found.landmarks:
            continue
        landmarks = () if kind == LANDMARKS else found.landmarks
        rest = [each for each in evidence if each.kind != kind]
        try:
            pose = pose_posterior(landmarks, found.camera, rest, click_sigma_px=found.click_sigma_px)
        except UndeterminedPose:
            pulls[kind] = None
            continue
        moved = found.camera.project(transform_points(pose.estimate.cam_from_model, points_model)) - shown
        pulls[kind] = float(np.nanmedian(np.linalg.norm(moved, axis=1)))
    return pulls
