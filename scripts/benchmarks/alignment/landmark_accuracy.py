"""Poses from landmarks: accuracy, coverage, outlier rejection and time.

Every row has its own random generator, seeded by its settings, so it does not depend on the other rows.
"""

import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np

from oneframe.alignment.landmarks.solver import UndeterminedPose, solve_pose
from oneframe.camera.pinhole import PinholeCamera

from .landmark_trials import MICROSCOPE, LandmarkTrial, PoseErrors, box_trial, run_trials, surface_trial

ASSUMED_SIGMA_PX = 2.0
"""Click noise that the solver assumes, whatever the true one is."""
COUNTS = (4, 6, 8, 10)
"""Numbers of correspondences."""
OUTLIER_SETTINGS = ((6, 0, 0), (6, 1, 40), (8, 2, 60), (10, 3, 60), (20, 0, 0), (20, 8, 80))
"""Number of correspondences, number of wrong ones, and their error in px."""
TIME_SETTINGS = ((4, 0), (6, 0), (10, 0), (20, 0), (10, 2), (20, 4))
"""Number of correspondences, and number of wrong ones."""
TIMED_SOLVES = 60

DrawTrial = Callable[[np.random.Generator, int, float], LandmarkTrial]
"""Draws a trial from a generator, a number of correspondences and the click noise in px."""


@dataclass(frozen=True)
class ErrorQuantiles:
    """Median and 95 % quantile of the rotation error and of the mean displacement of the surface in the image."""

    rotation_deg: tuple[float, float]
    surface_px: tuple[float, float]

    @classmethod
    def of(cls, errors: PoseErrors, *, accepted: bool) -> "ErrorQuantiles":
        """The quantiles over the accepted trials, or over all."""
        return cls(
            errors.quantiles(errors.rotation_deg, accepted=accepted),
            errors.quantiles(errors.mesh_px, accepted=accepted),
        )

    def __str__(self) -> str:
        (angle, most_angle), (shift, most_shift) = self.rotation_deg, self.surface_px
        return f"{angle:.2f} ({most_angle:.2f}) / {shift:.2f} ({most_shift:.2f})"


@dataclass(frozen=True)
class LandmarkAccuracy:
    """Accuracy for one number of correspondences (``pairs``) and one true click noise ``sigma_px``.

    Attributes
    ----------
    accepted, all
        Errors of the accepted trials; errors of all trials, where a refused one counts with its best candidate.
    peers
        Errors of the other solvers on the same clicks, by name.
    refused
        Number of refused trials by kind of refusal.
    coverage
        Fraction of the accepted trials whose 95 % region contained the true pose.
    """

    pairs: int
    sigma_px: float
    accepted: ErrorQuantiles
    all: ErrorQuantiles
    peers: dict[str, ErrorQuantiles]
    refused: dict[str, int]
    coverage: float

    @classmethod
    def of(cls, row: Mapping[str, Any]) -> "LandmarkAccuracy":
        """A row of the file of figures."""
        errors = {name: ErrorQuantiles(**row[name]) for name in ("accepted", "all")}
        peers = {name: ErrorQuantiles(**each) for name, each in row["peers"].items()}
        return cls(**{**row, **errors, "peers": peers})

    def __str__(self) -> str:
        return (
            f"{self.pairs:2d} pairs, {self.sigma_px:g} px: accepted {self.accepted}; all {self.all}; "
            + "".join(f"{name} {errors}; " for name, errors in self.peers.items())
            + f"coverage {self.coverage:.1%}; refused {sum(self.refused.values())} {self.refused}"
        )


@dataclass(frozen=True)
class OutlierRejection:
    """How often the solver rejects exactly the ``wrong`` correspondences; ``outcomes`` counts trials."""

    pairs: int
    wrong: int
    shift_px: float
    outcomes: dict[str, int]

    def __str__(self) -> str:
        total = sum(self.outcomes.values())
        return f"{self.wrong} of {self.pairs} pairs wrong by {self.shift_px:g} px: {self.outcomes} of {total}"


@dataclass(frozen=True)
class SolveTime:
    """Processor time of one solve: median and 95 % quantile in milliseconds."""

    pairs: int
    wrong: int
    median_ms: float
    most_ms: float

    def __str__(self) -> str:
        return f"{self.pairs} pairs, {self.wrong} wrong: {self.median_ms:.1f} ms, 95 % below {self.most_ms:.1f} ms"


@dataclass(frozen=True)
class VisibleSurface:
    """The visible points of a surface, ``(M, 3)`` mm in the model frame, and the frame's camera and pose.

    ``description`` names them in the report.
    """

    description: str
    camera: PinholeCamera
    cam_from_model: np.ndarray
    points: np.ndarray

    def draw(self, rng: np.random.Generator, count: int, sigma_px: float) -> LandmarkTrial:
        """Draw a trial with correspondences on this surface."""
        return surface_trial(
            rng,
            count,
            sigma_px,
            camera=self.camera,
            cam_from_model=self.cam_from_model,
            visible_points=self.points,
        )


@dataclass(frozen=True)
class LandmarkFigures:
    """All measured figures: ``box`` on random points, ``case`` on the surface of a case (empty without a case)."""

    trials: int
    box: tuple[LandmarkAccuracy, ...]
    case: tuple[LandmarkAccuracy, ...]
    outliers: tuple[OutlierRejection, ...] = ()
    times: tuple[SolveTime, ...] = ()

    @classmethod
    def of(cls, content: Mapping[str, Any]) -> "LandmarkFigures":
        """The accuracies from the file of figures, which are what is drawn."""
        box, case = (tuple(map(LandmarkAccuracy.of, content.get(name, ()))) for name in ("box", "case"))
        return cls(content["trials"], box, case)


def measure_landmarks(
    trials: int, noise_px: Sequence[float], surface: VisibleSurface | None, report: Callable[[str], None]
) -> LandmarkFigures:
    """Measure everything.

    Parameters
    ----------
    trials
        Number of trials for each number of correspondences and each click noise.
    noise_px
        Standard deviations of the click noise, along each image axis.
    surface
        A case's surface to measure on as well, or ``None``.
    report
        Called with one line for each measured row.
    """

    def reported(rows: Iterator) -> tuple:
        kept = []
        for row in rows:
            report(f"  {row}")
            kept.append(row)
        return tuple(kept)

    report(f"accuracy, {trials} trials each: rotation ° / surface px, median (95 %)")
    box = reported(accuracies(box_trial, MICROSCOPE, trials, noise_px))
    case: tuple[LandmarkAccuracy, ...] = ()
    if surface is not None:
        report(f"the same for {surface.description}")
        case = reported(accuracies(surface.draw, surface.camera, trials, noise_px))
    few = min(trials, 20)
    rejections = (
        outlier_rejection(np.random.default_rng([pairs, wrong]), pairs, wrong, shift_px, max(trials // 10, few))
        for pairs, wrong, shift_px in OUTLIER_SETTINGS
    )
    solves = min(trials, TIMED_SOLVES)
    times = (solve_time(np.random.default_rng(pairs), pairs, wrong, solves) for pairs, wrong in TIME_SETTINGS)
    return LandmarkFigures(trials, box, case, reported(rejections), reported(times))


def accuracies(
    draw: DrawTrial, camera: PinholeCamera, trials: int, noise_px: Sequence[float]
) -> Iterator[LandmarkAccuracy]:
    """Accuracy and coverage for every true click noise and each of :data:`COUNTS`."""
    for sigma_px in noise_px:
        for count in COUNTS:
            yield accuracy(np.random.default_rng([count, int(10 * sigma_px)]), draw, camera, trials, count, sigma_px)


def accuracy(
    rng: np.random.Generator, draw: DrawTrial, camera: PinholeCamera, trials: int, count: int, sigma_px: float
) -> LandmarkAccuracy:
    """Accuracy and coverage of ``trials`` trials with ``count`` correspondences and click noise ``sigma_px``."""
    ours, peers = run_trials(lambda: draw(rng, count, sigma_px), trials, camera=camera, click_sigma_px=ASSUMED_SIGMA_PX)
    return LandmarkAccuracy(
        pairs=count,
        sigma_px=sigma_px,
        accepted=ErrorQuantiles.of(ours, accepted=True),
        all=ErrorQuantiles.of(ours, accepted=False),
        peers={name: ErrorQuantiles.of(errors, accepted=False) for name, errors in peers.items()},
        refused=dict(Counter(refusal for refusal in ours.refusals if refusal is not None)),
        coverage=ours.coverage,
    )


def outlier_rejection(
    rng: np.random.Generator, pairs: int, wrong: int, shift_px: float, trials: int
) -> OutlierRejection:
    """Move ``wrong`` of the clicks by ``shift_px`` in random directions; count how often the solver rejects them."""
    outcomes = Counter[str]()
    for _ in range(trials):
        trial = box_trial(rng, pairs, ASSUMED_SIGMA_PX)
        bad = rng.choice(pairs, wrong, replace=False)
        pixels, angle = trial.pixels.copy(), rng.uniform(0, 2 * np.pi, wrong)
        pixels[bad] += shift_px * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        try:
            inliers = solve_pose(trial.points_model, pixels, MICROSCOPE).inliers
        except UndeterminedPose as refusal:
            outcomes[f"refused: {refusal.kind}"] += 1
        else:
            outcomes["exact" if set(np.flatnonzero(~inliers)) == set(bad) else "not exact"] += 1
    return OutlierRejection(pairs, wrong, shift_px, dict(outcomes))


def solve_time(rng: np.random.Generator, pairs: int, wrong: int, solves: int) -> SolveTime:
    """Measure the time of solves with ``wrong`` clicks that are 80 px off along both image axes."""
    times_ms = []
    for _ in range(solves):
        trial = box_trial(rng, pairs, ASSUMED_SIGMA_PX)
        trial.pixels[:wrong] += 80
        start = time.process_time()
        with suppress(UndeterminedPose):
            solve_pose(trial.points_model, trial.pixels, MICROSCOPE)
        times_ms.append((time.process_time() - start) * 1e3)
    return SolveTime(pairs, wrong, float(np.median(times_ms)), float(np.quantile(times_ms, 0.95)))
