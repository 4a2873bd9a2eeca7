"""The focal length from landmarks, together with the pose, where they determine it. Needs ``cv2``.

Size and distance of a surface change its picture alike, but for perspective: through a long lens the landmarks must lie
at very different depths, and be many, before they tell the two apart.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from ...camera.pinhole import PinholeCamera
from ...case.landmarks import Landmark
from ...errors import InputError
from ...transforms import rigid, transform_points
from ..reprojection import zoom_jacobian_at
from .align_landmarks import complete_landmarks, landmark_arrays
from .covariance import SELECTION_PRIOR_DOF, NoiseEstimate, inverse_normal_matrix

FEWEST = 6
"""Complete landmarks: seven unknowns, and something left to find a wrong click by."""

WORST_RELATIVE = 0.05
"""Standard deviation of a focal length from which on it counts as not determined."""

WORST_NOISE = 3.0
"""Click noise, relative to the stated one, from which on a click counts as wrong."""

STARTS = np.geomspace(0.5, 64, 15)
"""Focal lengths that the search starts from, in widths of the frame."""

_FIXED = (
    cv2.CALIB_USE_INTRINSIC_GUESS | cv2.CALIB_FIX_PRINCIPAL_POINT | cv2.CALIB_FIX_ASPECT_RATIO
    | cv2.CALIB_ZERO_TANGENT_DIST | cv2.CALIB_FIX_K1 | cv2.CALIB_FIX_K2 | cv2.CALIB_FIX_K3
)  # fmt: skip


@dataclass(frozen=True)
class FocalLength:
    """A focal length from landmarks.

    Attributes
    ----------
    camera
        The camera with it; principal point and fy / fx are as given.
    relative
        Its standard deviation, relative to it.
    rms_px
        Root mean square reprojection error of the landmarks.
    """

    camera: PinholeCamera
    relative: float
    rms_px: float

    @property
    def text(self) -> str:
        """For the user."""
        return f"focal length: {self.camera.fx:.0f} px ± {self.relative:.1%}, RMS {self.rms_px:.2f} px"


def focal_length(landmarks: Sequence[Landmark], camera: PinholeCamera, *, click_sigma_px: float) -> FocalLength:
    """Find focal length and pose that fit the landmarks best (Zhang 2000, of one view with a known principal point).

    Parameters
    ----------
    landmarks
        Those that are disabled or incomplete take no part.
    camera
        Principal point and fy / fx of the undistorted frame; its focal length does not count.
    click_sigma_px
        Standard deviation of a click, in each image direction.

    Raises
    ------
    InputError
        Too few landmarks, none fits, or they leave it open: its standard deviation exceeds :data:`WORST_RELATIVE`.
    """
    points, pixels = landmark_arrays(tuple(complete_landmarks(landmarks).values()))
    if len(points) < FEWEST:
        raise InputError(
            f"landmarks: expected at least {FEWEST} complete ones for the focal length, found {len(points)}; "
            "click more, at very different depths"
        )
    fits = [fit for start in STARTS * camera.width if (fit := _fitted(points, pixels, camera, start)) is not None]
    rms_px, found, pose = min(fits, key=lambda fit: fit[0], default=(np.inf, camera, np.eye(4)))
    noise = NoiseEstimate.of(len(points) * rms_px**2, 2 * len(points) - 7, click_sigma_px, SELECTION_PRIOR_DOF)
    if noise.sigma_px > WORST_NOISE * click_sigma_px:
        raise InputError(
            f"landmarks: expected clicks that a pose explains within {click_sigma_px:g} px at some focal length, found "
            f"{rms_px:.1f} px at best; correct the wrong ones first"
        )
    jacobian = zoom_jacobian_at(points, found, pose, points.mean(axis=0)).reshape(-1, 7)
    relative = float(np.sqrt(noise.variance * inverse_normal_matrix(jacobian)[6, 6]))
    if relative > WORST_RELATIVE:
        raise InputError(
            f"landmarks: they leave the focal length open: {found.fx:.0f} px ± {relative:.0%}, expected at most "
            f"{WORST_RELATIVE:.0%}; click points nearer and farther, or take K from a calibration, as microscopes need"
        )
    return FocalLength(found, relative, rms_px)


def _fitted(
    points: np.ndarray, pixels: np.ndarray, camera: PinholeCamera, start_px: float
) -> tuple[float, PinholeCamera, np.ndarray] | None:
    """Root mean square error, camera and pose from one start; ``None`` if the search ends behind the camera."""
    pivot = points.mean(axis=0)
    k = np.array(camera.k, np.float64)
    k[0, 0], k[1, 1] = start_px, start_px * camera.fy / camera.fx
    try:
        rms_px, fitted, _, (turn,), (shift,) = cv2.calibrateCamera(
            [(points - pivot).astype(np.float32)],
            [pixels.astype(np.float32)],
            camera.size_wh,
            k,
            np.zeros(5),
            flags=_FIXED,
        )
    except cv2.error:
        return None
    rotation = cv2.Rodrigues(turn)[0]
    pose = rigid(rotation, shift[:, 0] - rotation @ pivot)
    fx, fy = float(fitted[0, 0]), float(fitted[1, 1])
    if not (np.isfinite(fx) and fx > 0) or (transform_points(pose, points)[:, 2] <= 0).any():
        return None
    return float(rms_px), replace(camera, fx=fx, fy=fy), pose
