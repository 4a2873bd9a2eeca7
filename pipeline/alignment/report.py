"""Reports of a pose from landmarks, and of one refined against the image: lines for a person, tables for a program."""

import numpy as np

from ..files.numbers import format_two_digits
from ..transforms import inverse_rigid, transform_points
from .landmarks.align_landmarks import Alignment
from .refinement.verdict import Refinement

CONVENTION = (
    "cam_from_mesh maps points of the mesh file (mm) to a camera with OpenCV axes: x right, y down, z forward; "
    "pixel (0, 0) is the centre of the top-left pixel of the undistorted frame"
)


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
        "moved_px": _known(refinement.moved_px),
        "moved_deg": _known(refinement.rotation_deg),
        "before": {"explained": refinement.before.score, "error_px": _known(refinement.before.error_px)},
        "after": {
            "explained": refinement.after.score,
            "error_px": _known(refinement.after.error_px),
            "error_is_lower_bound": not refinement.verified,
        },
        "split_half_px": None if tests is None else _known(tests.split_half_px),
        "second_peak_ratio": None if tests is None else _known(tests.second_peak_ratio),
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


def _known(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
