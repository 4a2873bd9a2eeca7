"""Reports of a pose from landmarks, and of one refined against the image: lines, tables and marks. Needs ``cv2``."""

import cv2
import numpy as np

from ..files.numbers import format_two_digits
from ..transforms import inverse_rigid, transform_points
from .landmarks.align_landmarks import Alignment, landmark_arrays
from .pose_uncertainty import ellipse_outlines
from .refinement.verdict import Refinement, known

CONVENTION = (
    "cam_from_mesh maps points of the mesh file (mm) to a camera with OpenCV axes: x right, y down, z forward; "
    "pixel (0, 0) is the centre of the top-left pixel of the undistorted frame"
)

MAGNIFIED = 10.0
"""Residuals are drawn so many times longer than they are: at their own length they could not be seen."""

INLIER, OUTLIER, ELLIPSE = (0.2, 1.0, 0.3), (1.0, 0.25, 0.2), (0.3, 0.8, 1.0)
_CROSS = np.array([[[-1.0, 0], [1, 0]], [[0, -1], [0, 1]]])
_SUBPIXEL = 4
"""Binary digits after the point that OpenCV draws with."""


def pose_lines(cam_from_mesh: np.ndarray) -> list[str]:
    """A pose (4x4, mm) in both directions with all its digits."""
    forth, back = _rows(cam_from_mesh), _rows(inverse_rigid(cam_from_mesh))
    return [CONVENTION, "cam_from_mesh:", *forth, "mesh_from_cam:", *back]


def pose_table(cam_from_mesh: np.ndarray) -> dict[str, object]:
    """The same for JSON."""
    return {
        "convention": CONVENTION,
        "cam_from_mesh": _plain(cam_from_mesh),
        "mesh_from_cam": _plain(inverse_rigid(cam_from_mesh)),
    }


def report_lines(alignment: Alignment) -> list[str]:
    """The pose in both directions with all its digits, the residuals and the uncertainty; landmarks in ``mesh``."""
    estimate, uncertainty = alignment.estimate, alignment.estimate.uncertainty
    lines = pose_lines(estimate.cam_from_model)
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


def report_table(alignment: Alignment) -> dict[str, object]:
    """The same for JSON: lengths in mm, angles in degrees, ``None`` where a pair lies behind the camera."""
    estimate, uncertainty = alignment.estimate, alignment.estimate.uncertainty
    predicted = alignment.camera.project(transform_points(estimate.cam_from_model, alignment.points))
    pairs = [
        {
            "name": landmark.name,
            "surface": _plain(point),
            "pixel": _plain(pixel),
            "predicted": _plain(shown),
            "residual_px": _plain(apart),
            "inlier": bool(inlier),
            "standard_deviation_px": _plain(np.sqrt(np.diag(covariance))),
        }
        for landmark, point, pixel, shown, apart, inlier, covariance in zip(
            alignment.landmarks,
            alignment.points,
            alignment.pixels,
            predicted,
            estimate.residuals_px,
            estimate.inliers,
            uncertainty.pixel_covariances(alignment.points, alignment.camera, estimate.cam_from_model),
            strict=True,
        )
    ]
    return {
        **pose_table(estimate.cam_from_model),
        "K": _plain(alignment.camera.k),
        "size": list(alignment.camera.size_wh),
        "pairs": pairs,
        "rms_px": estimate.rms_px,
        "click_sigma_px": alignment.click_sigma_px,
        "uncertainty": {"noise_px": uncertainty.sigma_px, **uncertainty.table(np.eye(4))},
        "messages": list(estimate.messages),
    }


def refinement_table(refinement: Refinement, mesh_from_model: np.ndarray, *, taken: bool) -> dict[str, object]:
    """Table for JSON: lengths in mm, angles in degrees, ``None`` where a number is unknown.

    Parameters
    ----------
    refinement
        In the frame ``model``.
    mesh_from_model
        ``(4, 4)``; the table is for the frame of the mesh file.
    taken
        Whether the pose is the refined one although that was refused.
    """
    cam_from_mesh = refinement.found @ inverse_rigid(mesh_from_model)
    uncertainty, tests = refinement.uncertainty if refinement.verified else None, refinement.verification
    return {
        "accepted": refinement.accepted,
        "taken_although_refused": taken,
        "message": refinement.message,
        "found_cam_from_mesh": cam_from_mesh.tolist(),
        "moved_px": known(refinement.moved_px),
        "moved_deg": known(refinement.rotation_deg),
        "before": {"explained": refinement.before.score, "error_px": known(refinement.before.error_px)},
        "after": {
            "explained": refinement.after.score,
            "error_px": known(refinement.after.error_px),
            "error_is_lower_bound": not refinement.verified,
        },
        "split_half_px": None if tests is None else known(tests.split_half_px),
        "second_peak_ratio": None if tests is None else known(tests.second_peak_ratio),
        "uncertainty": None if uncertainty is None else uncertainty.table(mesh_from_model),
    }


def _plain(values: np.ndarray) -> object:
    """Lists of Python floats; JSON has no NaN."""
    if values.ndim > 1:
        return [_plain(row) for row in values]
    return [float(value) if np.isfinite(value) else None for value in values]


def _rows(matrix: np.ndarray) -> list[str]:
    # repr of a Python float is the shortest text that reads back to the same number
    return [f"  {row}," for row in matrix.tolist()]


def _three(values: np.ndarray) -> str:
    return ", ".join(map(format_two_digits, values))


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
