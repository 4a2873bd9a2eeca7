"""Landmarks drawn over a picture: where each was clicked, how far off the pose is, how sure. Needs ``cv2``."""

import cv2
import numpy as np

from ...transforms import transform_points
from ..pose_uncertainty import ellipse_outlines
from .align_landmarks import Alignment, landmark_arrays

MAGNIFIED = 10.0
"""Residuals are drawn so many times longer than they are: at their own length they could not be seen."""

INLIER, OUTLIER, ELLIPSE = (0.2, 1.0, 0.3), (1.0, 0.25, 0.2), (0.3, 0.8, 1.0)
_CROSS = np.array([[[-1.0, 0], [1, 0]], [[0, -1], [0, 1]]])
_SUBPIXEL = 4
"""Binary digits after the point that OpenCV draws with."""


def marked(picture: np.ndarray, alignment: Alignment) -> np.ndarray:
    """Draw crosses at the clicked pixels, residuals as lines (magnified), 95 % ellipses where the points are to be.

    Parameters
    ----------
    picture
        ``(H, W, 3)`` values 0..1, the undistorted frame or an overlay of it.

    Returns
    -------
    A copy with the marks.
    """
    estimate = alignment.estimate
    covariances = estimate.uncertainty.pixel_covariances(alignment.points, alignment.camera, estimate.cam_from_model)
    outlines = ellipse_outlines(np.nan_to_num(covariances), estimate.uncertainty.ellipse_scale())
    shown = alignment.camera.project(transform_points(estimate.cam_from_model, alignment.points))
    landmarks = alignment.landmarks
    result = np.ascontiguousarray(picture, np.float32).copy()
    size = max(picture.shape[:2]) / 100
    pen = _Pen(result, max(1, round(size / 8)))
    for landmark, pixel, place, outline, inlier in zip(
        landmarks, landmark_arrays(landmarks)[1], shown, outlines, estimate.inliers, strict=True
    ):
        colour = INLIER if inlier else OUTLIER
        pen.lines(list(pixel + size * _CROSS), colour)
        if np.isfinite(place).all():
            pen.lines([place + outline], ELLIPSE, closed=True)
            # an outlier's residual is long enough as it is
            pen.lines([np.stack([pixel, pixel + (MAGNIFIED if inlier else 1.0) * (place - pixel)])], colour)
        pen.text(landmark.name, pixel + size, size / 20, colour)
    return result


class _Pen:
    """Draws on a picture, each stroke with a dark rim that keeps it apart from any ground."""

    def __init__(self, picture: np.ndarray, thickness: int) -> None:
        self._picture = picture
        self._strokes = ((3 * thickness, (0.0, 0.0, 0.0)), (thickness, None))

    def lines(self, lines: list[np.ndarray], colour: tuple[float, float, float], *, closed: bool = False) -> None:
        """``(M, 2)`` pixels each."""
        fixed = [np.rint(_bounded(line) * 2**_SUBPIXEL).astype(np.int32).reshape(-1, 1, 2) for line in lines]
        for thickness, rim in self._strokes:
            cv2.polylines(self._picture, fixed, closed, rim or colour, thickness, cv2.LINE_AA, _SUBPIXEL)

    def text(self, text: str, corner: np.ndarray, scale: float, colour: tuple[float, float, float]) -> None:
        """From its lower left corner; OpenCV's letters are ASCII."""
        x, y = (int(value) for value in _bounded(corner))
        letters = text.encode("ascii", "replace").decode()
        for thickness, rim in self._strokes:
            cv2.putText(
                self._picture, letters, (x, y), cv2.FONT_HERSHEY_SIMPLEX, scale, rim or colour, thickness, cv2.LINE_AA
            )


def _bounded(pixels: np.ndarray) -> np.ndarray:
    """OpenCV draws with 32-bit numbers."""
    return np.clip(pixels, -1e5, 1e5)
