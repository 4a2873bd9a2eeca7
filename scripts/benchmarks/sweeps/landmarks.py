"""Sweeps of the pose from landmarks past the point where it fails, by focal length and solver. Needs ``cv2``.

The surface is a box that spans :data:`SPAN_PX` at every focal length, so the distance grows with it: what changes is
the perspective, which is strong at 600 px and next to none at 12 800 px.
"""

import itertools
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import cv2
import numpy as np

from oneframe.alignment.landmarks.degeneracy import MIN_INLIER_FRACTION, UndeterminedPose
from oneframe.alignment.landmarks.hypotheses import UNDISTORTED
from oneframe.alignment.landmarks.solver import FEW_CORRESPONDENCES, LARGE_NOISE_RATIO, solve_pose
from oneframe.camera.pinhole import PinholeCamera
from oneframe.transforms import nearest_rotation, rigid, rotation_from_vector, transform_points

from ..alignment.landmark_trials import LandmarkTrial, pose_error, refined_sqpnp_pose
from .cells import NO_LIMIT, Cell, Limit, Outcome, Task

TOPIC = "pnp"
FOCALS_PX = (600.0, 1600.0, 4200.0, 12_800.0)
SPAN_PX = 600.0
BOX_MM = (30.0, 20.0, 12.0)
SIGMA_PX = 2.0
"""Click noise, stated and, where it is not swept, true."""
WRONG_DEG, WRONG_PX = 10.0, 60.0
"""Rotation error, and displacement of the surface (a tenth of its width), beyond which a pose counts as wrong."""
TRIALS, QUICK_TRIALS = 30, 6
OUTLIER_PX = 80.0
LEVEL = 0.95
"""Probability of the shown regions."""
CALIBRATION_TRIALS = 250


@dataclass(frozen=True)
class Clicks:
    """How the points of a trial lie, and how they are clicked.

    Attributes
    ----------
    count
        Number of correspondences.
    sigma_px
        True click noise.
    outliers
        Fraction of the correspondences that are :data:`OUTLIER_PX` off.
    spread
        Size of the points' box relative to the surface's.
    width, thickness
        Extent of the points along the second and the third axis of the surface's box, relative to the box.
    tilt_deg
        Angle between the third axis and the line of sight; any rotation if NaN.
    """

    count: int = 10
    sigma_px: float = SIGMA_PX
    outliers: float = 0.0
    spread: float = 1.0
    width: float = 1.0
    thickness: float = 1.0
    tilt_deg: float = math.nan


@dataclass(frozen=True)
class Sweep:
    """Values of one attribute of :class:`Clicks`, and the software's limit on it."""

    name: str
    attribute: str
    values: tuple[float, ...]
    others: Clicks
    limit: Limit = NO_LIMIT


SWEEPS = (
    Sweep("number", "count", (3, 4, 5, 6, 8, 12, 20), Clicks(), Limit("FEW_CORRESPONDENCES", FEW_CORRESPONDENCES)),
    Sweep(
        "noise",
        "sigma_px",
        (0.5, 2, 4, 8, 16, 32, 64),
        Clicks(count=10),
        Limit("LARGE_NOISE_RATIO", LARGE_NOISE_RATIO * SIGMA_PX),
    ),
    Sweep(
        "outliers",
        "outliers",
        (0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.8),
        Clicks(count=20),
        Limit("MIN_INLIER_FRACTION", 1 - MIN_INLIER_FRACTION),
    ),
    Sweep("spread", "spread", (1, 0.5, 0.25, 0.12, 0.06, 0.03, 0.01), Clicks()),
    Sweep("coplanarity", "thickness", (1, 0.5, 0.25, 0.12, 0.06, 0.03, 0), Clicks(count=6)),
    Sweep("collinearity", "width", (1, 0.3, 0.1, 0.03, 0.01, 0.003, 0), Clicks(thickness=0.0)),
    Sweep("sign flips", "tilt_deg", (0, 5, 10, 20, 40, 60, 80), Clicks(count=6, thickness=0.03)),
)
CALIBRATION_COUNTS = (4, 6, 10, 20)
CALIBRATION_RATIOS = (0.25, 0.5, 1.0, 2.0, 4.0)


def camera_of(focal_px: float) -> PinholeCamera:
    """A camera of this focal length with an image of 1920x1080 px."""
    return PinholeCamera(1920, 1080, focal_px, focal_px, 959.5, 539.5)


def draw_trial(rng: np.random.Generator, clicks: Clicks, camera: PinholeCamera) -> LandmarkTrial:
    """Draw points in the surface's box, a pose and clicks."""
    box = np.array(BOX_MM)
    if math.isnan(clicks.tilt_deg):
        # the orthogonal polar factor of a Gaussian matrix is uniform; the sign makes it a rotation
        rotation = nearest_rotation(rng.normal(size=(3, 3)))
    else:
        azimuth, roll = rng.uniform(0, 2 * np.pi, 2)
        axis = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
        rotation = rotation_from_vector(np.radians(clicks.tilt_deg) * axis) @ rotation_from_vector(
            np.array([0.0, 0.0, roll])
        )
    pose = rigid(rotation, np.array([0.0, 0.0, camera.fx * BOX_MM[0] / SPAN_PX]))
    size = clicks.spread * box * [1.0, clicks.width, clicks.thickness]
    points = (rng.random((clicks.count, 3)) - 0.5) * size
    true = camera.project(transform_points(pose, points))
    pixels = true + rng.normal(scale=clicks.sigma_px, size=true.shape)
    moved = rng.choice(clicks.count, round(clicks.outliers * clicks.count), replace=False)
    angle = rng.uniform(0, 2 * np.pi, len(moved))
    pixels[moved] += OUTLIER_PX * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return LandmarkTrial(points, pixels, pose, (rng.random((200, 3)) - 0.5) * box)


def epnp_pose(points_model: np.ndarray, pixels: np.ndarray, camera: PinholeCamera) -> np.ndarray | None:
    """OpenCV's EPnP: fast, without refinement."""
    try:
        found, rvec, tvec = cv2.solvePnP(points_model, pixels, camera.k, UNDISTORTED, flags=cv2.SOLVEPNP_EPNP)
    except cv2.error:  # fewer than 4 points
        return None
    return rigid(cv2.Rodrigues(rvec)[0], np.ravel(tvec)) if found and np.isfinite(rvec).all() else None


OURS = "OneFrame"
PEERS: dict[str, Callable[[np.ndarray, np.ndarray, PinholeCamera], np.ndarray | None]] = {
    "EPnP": epnp_pose,
    "SQPnP + LM": refined_sqpnp_pose,
}


def our_outcome(trial: LandmarkTrial, camera: PinholeCamera) -> Outcome:
    """The answer of :func:`.solve_pose` to a trial; the error is the displacement of the surface, px."""
    try:
        estimate = solve_pose(trial.points_model, trial.pixels, camera, click_sigma_px=SIGMA_PX)
    except UndeterminedPose as error:
        return Outcome("refuses", message=str(error))
    angle_deg, error_px, wrong = _errors(trial, camera, estimate.cam_from_model)
    messages = " ".join(estimate.messages)
    return Outcome("warns" if messages else "works", error_px, wrong, messages, angle_deg)


def peer_outcome(name: str, trial: LandmarkTrial, camera: PinholeCamera) -> Outcome:
    """The result of one of :data:`PEERS`."""
    pose = PEERS[name](trial.points_model, trial.pixels, camera)
    if pose is None or not np.isfinite(pose).all():
        return Outcome("refuses", message="no solution")
    angle_deg, error_px, wrong = _errors(trial, camera, pose)
    return Outcome("works", error_px, wrong, value=angle_deg)


def _errors(trial: LandmarkTrial, camera: PinholeCamera, pose: np.ndarray) -> tuple[float, float, bool]:
    angle_deg, error_px = pose_error(trial, camera, pose)
    # a point behind the camera has no pixel
    error_px = error_px if np.isfinite(error_px) else np.inf
    return angle_deg, error_px, bool(angle_deg > WRONG_DEG or error_px > WRONG_PX)


def measure(sweep: Sweep, number: int, focal_px: float, seed: int, *, quick: bool) -> list[Cell]:
    """The cells of a sweep at one focal length: ours and every peer's; ``y`` is the focal length."""
    camera, cells = camera_of(focal_px), []
    for index, value in enumerate(sweep.values):
        swept: dict[str, Any] = {sweep.attribute: value}
        clicks = replace(sweep.others, **swept)
        rng = np.random.default_rng([seed, number, int(focal_px), index])
        trials = [draw_trial(rng, clicks, camera) for _ in range(QUICK_TRIALS if quick else TRIALS)]
        outcomes = {OURS: [our_outcome(trial, camera) for trial in trials]}
        outcomes |= {name: [peer_outcome(name, trial, camera) for trial in trials] for name in PEERS}
        cells += [
            Cell.of(sweep.name, name, value, each, y=focal_px, limit=sweep.limit if name == OURS else NO_LIMIT)
            for name, each in outcomes.items()
        ]
    return cells


def measure_calibration(count: int, seed: int, *, quick: bool) -> list[Cell]:
    """Coverage of the shown regions against the ratio of true to stated noise.

    ``series`` is the number of pairs, ``y`` the region's probability, ``value`` the fraction that holds the truth. A
    truth outside counts as wrong, and is silent if the software did not warn either.
    """
    camera, cells = camera_of(FOCALS_PX[-1]), []
    for index, ratio in enumerate(CALIBRATION_RATIOS):
        rng, outcomes = np.random.default_rng([seed, len(SWEEPS), count, index]), list[Outcome]()
        for _ in range(CALIBRATION_TRIALS // 10 if quick else CALIBRATION_TRIALS):
            trial = draw_trial(rng, Clicks(count=count, sigma_px=ratio * SIGMA_PX), camera)
            try:
                estimate = solve_pose(trial.points_model, trial.pixels, camera, click_sigma_px=SIGMA_PX)
            except UndeterminedPose as error:
                outcomes.append(Outcome("refuses", message=str(error)))
                continue
            inside = estimate.uncertainty.contains(trial.cam_from_model, estimate.cam_from_model, LEVEL)
            said = " ".join(estimate.messages)
            outcomes.append(Outcome("warns" if said else "works", float(not inside), not inside, said))
        cell = Cell.of("calibration", f"{count} pairs", ratio, outcomes, y=LEVEL)
        cells.append(replace(cell, value=_part_inside(outcomes)))
    return cells


def _part_inside(outcomes: list[Outcome]) -> float:
    """Fraction of the regions that hold the truth; NaN if all trials were refused."""
    inside = [not outcome.wrong for outcome in outcomes if outcome.answer != "refuses"]
    return float(np.mean(inside)) if inside else math.nan


def tasks(seed: int, *, quick: bool) -> Iterator[Task]:
    """All measurements of the topic; ``quick`` takes fewer focal lengths and trials."""
    focals = FOCALS_PX[:: len(FOCALS_PX) - 1] if quick else FOCALS_PX
    for (number, sweep), focal_px in itertools.product(enumerate(SWEEPS), focals):
        yield partial(measure, sweep, number, focal_px, seed, quick=quick)
    for count in CALIBRATION_COUNTS:
        yield partial(measure_calibration, count, seed, quick=quick)
