"""From a list of landmarks to a pose: which of them take part, and what decides where several poses fit."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...camera.pinhole import PinholeCamera
from ...case.landmarks import Landmark
from .degeneracy import UndeterminedPose
from .solver import PoseEstimate, solve_pose


@dataclass(frozen=True)
class Alignment:
    """A pose and the landmarks that it was found from, all in one frame of the surface: ``mesh`` or ``model``.

    Attributes
    ----------
    landmarks
        N complete, enabled landmarks, in the order of the estimate's residuals.
    indices
        N places of these in the list that was given.
    camera
        Intrinsics.
    estimate
        The pose; its ``cam_from_model`` maps from the frame of the landmarks.
    click_sigma_px
        The assumed standard deviation of a click.
    """

    landmarks: tuple[Landmark, ...]
    indices: tuple[int, ...]
    camera: PinholeCamera
    estimate: PoseEstimate
    click_sigma_px: float

    @property
    def points(self) -> np.ndarray:
        """``(N, 3)`` mm."""
        return landmark_arrays(self.landmarks)[0]

    @property
    def pixels(self) -> np.ndarray:
        """``(N, 2)`` as clicked."""
        return landmark_arrays(self.landmarks)[1]


def complete_landmarks(landmarks: Sequence[Landmark]) -> dict[int, Landmark]:
    """Place in the list -> landmark, of those that take part: enabled, with point and pixel."""
    return {
        index: landmark
        for index, landmark in enumerate(landmarks)
        if landmark.enabled and landmark.point is not None and landmark.pixel is not None
    }


def landmark_arrays(landmarks: Sequence[Landmark]) -> tuple[np.ndarray, np.ndarray]:
    """``(N, 3)`` points in mm and ``(N, 2)`` pixels of complete landmarks."""
    return (
        np.array([landmark.point for landmark in landmarks], np.float64).reshape(-1, 3),
        np.array([landmark.pixel for landmark in landmarks], np.float64).reshape(-1, 2),
    )


def align_landmarks(
    landmarks: Sequence[Landmark],
    camera: PinholeCamera,
    *,
    click_sigma_px: float,
    start: np.ndarray | None = None,
) -> Alignment:
    """The pose from landmarks; those that are disabled or incomplete take no part.

    Parameters
    ----------
    landmarks
        Any number, in one frame of the surface.
    camera
        Intrinsics of the undistorted frame.
    click_sigma_px
        Standard deviation of a click, in each image direction.
    start
        ``(4, 4)`` the present pose, from the frame of the landmarks. It only decides between poses that fit equally
        well: where the landmarks determine one pose, the result does not depend on it.

    Raises
    ------
    UndeterminedPose
        The landmarks do not determine a pose: see :mod:`.degeneracy`.
    InputError
        Numbers that are not finite, a click noise that is not positive.
    """
    used = complete_landmarks(landmarks)
    points, pixels = landmark_arrays(tuple(used.values()))

    def solve(start: np.ndarray | None) -> PoseEstimate:
        names = [landmark.name for landmark in used.values()]
        return solve_pose(points, pixels, camera, click_sigma_px=click_sigma_px, start=start, names=names)

    try:
        estimate = solve(None)
    except UndeterminedPose as refusal:
        if start is None or not is_ambiguous(refusal):
            raise
        estimate = solve(start)
    return Alignment(tuple(used.values()), tuple(used), camera, estimate, click_sigma_px)


def is_ambiguous(refusal: UndeterminedPose) -> bool:
    """Whether several poses fit, so that a present pose may decide."""
    return len(refusal.probabilities) > 1
