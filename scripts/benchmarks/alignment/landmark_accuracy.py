"""Poses from landmarks: accuracy beside OpenCV's solvers, refusals, and coverage of the 95 % region."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from oneframe.camera.pinhole import PinholeCamera

from .landmark_trials import LandmarkTrial, PoseErrors, run_trials, surface_trial

ASSUMED_SIGMA_PX = 2.0
"""Click noise that the solver assumes, whatever the true one is."""
COUNTS = (4, 6, 8, 10)
"""Numbers of correspondences."""
ALL, ACCEPTED = "OneFrame", "OneFrame, accepted"
"""All trials, of which refused ones count with their best candidate; the accepted ones."""

DrawTrial = Callable[[np.random.Generator, int, float], LandmarkTrial]
"""Draws a trial from a generator, a number of correspondences and the click noise in px."""


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


@dataclass(frozen=True)
class VisibleSurface:
    """The visible points of a surface, ``(M, 3)`` mm in the model frame, and the frame's camera and pose."""

    camera: PinholeCamera
    cam_from_model: np.ndarray
    points: np.ndarray

    def draw(self, rng: np.random.Generator, count: int, sigma_px: float) -> LandmarkTrial:
        """Draw a trial with correspondences on this surface."""
        return surface_trial(
            rng, count, sigma_px, camera=self.camera, cam_from_model=self.cam_from_model, visible_points=self.points
        )


def accuracies(
    points: str, draw: DrawTrial, camera: PinholeCamera, trials: int, noise_px: Sequence[float]
) -> Iterator[LandmarkRow]:
    """Rows for every true click noise and each of :data:`COUNTS`; each has its own random generator."""
    for sigma_px in noise_px:
        for count in COUNTS:
            rng = np.random.default_rng([count, int(10 * sigma_px)])
            ours, peers = run_trials(
                lambda: draw(rng, count, sigma_px), trials, camera=camera, click_sigma_px=ASSUMED_SIGMA_PX  # noqa: B023
            )  # fmt: skip
            for solver, errors in {ALL: ours, ACCEPTED: ours, **peers}.items():
                yield LandmarkRow(points, count, sigma_px, solver, trials, *_figures(errors, solver == ACCEPTED))


def _figures(errors: PoseErrors, accepted: bool) -> tuple[float, float, float, float, int, float]:
    angles, shifts = (errors.quantiles(each, accepted=accepted) for each in (errors.rotation_deg, errors.mesh_px))
    return *angles, *shifts, sum(refusal is not None for refusal in errors.refusals), errors.coverage


def line(row: LandmarkRow) -> str:
    """A row in words."""
    return (
        f"  {row.points}, {row.pairs} pairs, {row.sigma_px:g} px, {row.solver}: {row.rotation_deg:.2f} "
        f"({row.rotation_deg_95:.2f})° / {row.surface_px:.2f} ({row.surface_px_95:.2f}) px; refused {row.refused}; "
        f"coverage {row.coverage:.1%}"
    )
