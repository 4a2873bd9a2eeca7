"""From a list of landmarks to a pose: which take part, whether they lie on the surface, what decides between poses."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ...camera.pinhole import PinholeCamera
from ...case.landmarks import Landmark
from ...case.pose_record import PoseRecord
from ...errors import InputError
from ...surface.deviation import deviation
from ...surface.mesh import TriangleMesh
from .degeneracy import UndeterminedPose
from .solver import PoseEstimate, solve_pose

OFF_SURFACE_MM = 0.5
"""A landmark farther from the surface is reported: of the order of a voxel of a CT."""
ELSEWHERE = 0.03
"""If all landmarks lie farther from the surface than this part of its diagonal, they belong to something else."""


@dataclass(frozen=True)
class Alignment:
    """A pose, and the landmarks that it was found from, in one frame of the surface.

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

    def record(self, tool: str, date: str) -> PoseRecord:
        """The record of the pose; day in ISO 8601."""
        return PoseRecord(
            method="landmarks",
            tool=tool,
            date=date,
            pairs=int(self.estimate.inliers.sum()),
            rms_px=self.estimate.rms_px,
            click_sigma_px=self.click_sigma_px,
            **self.estimate.uncertainty.deviations(),
        )


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


def landmark_distances(landmarks: Sequence[Landmark], mesh: TriangleMesh) -> dict[str, float]:
    """Name -> distance from the surface, mm, of the landmarks that are enabled and have a point.

    Parameters
    ----------
    landmarks
        In the frame of ``mesh``, mm.
    mesh
        The surface, mm.
    """
    points = {each.name: each.point for each in landmarks if each.enabled and each.point is not None}
    return dict(zip(points, deviation(np.array([*points.values()]).reshape(-1, 3), mesh).tolist(), strict=True))


def off_surface(distances: Mapping[str, float]) -> tuple[str, ...]:
    """A warning that names the landmarks off the surface, or nothing, from :func:`landmark_distances`."""
    off = [f"{name!r} ({distance:.1f} mm)" for name, distance in distances.items() if distance > OFF_SURFACE_MM]
    if not off:
        return ()
    return (f"landmarks off the surface: {', '.join(off)}; check the mesh they were picked on, its frame and its unit",)


def check_landmarks_belong(distances: Mapping[str, float], mesh: TriangleMesh, name: str) -> None:
    """Refuse landmarks that all lie far from the surface ``name``, by their :func:`landmark_distances` from it."""
    nearest = min(distances.values(), default=0.0)
    if nearest > ELSEWHERE * float(np.linalg.norm(np.ptp(mesh.bounds, axis=0))):
        raise InputError(
            f"landmarks: expected points on {name}, all lie beside it, {nearest:.3g} mm and more off; were they picked "
            "on this mesh, in this frame and unit?"
        )
