"""The poses of a dataset: drawn by rejection sampling under constraints, or read from the user's list.

A *probe* measures what a pose shows: a callable ``cam_from_model -> ViewStatistics``. Accepted poses follow the
distribution conditioned on the constraints (rejection sampling, von Neumann, 1951). Poses from a list are the user's
own choice, so they are never rejected; those that break constraints are counted and reported.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from ..errors import InputError

MAX_ATTEMPTS = 5000
"""Poses tried for one view."""

LEAST_ACCEPTANCE = 16 / MAX_ATTEMPTS
"""Fraction of the poses that must meet the constraints: then a view finds none with a probability of exp(-16) = 1e-7,
so all views of a run of 100 000 find one with a probability of 99 %."""


@dataclass(frozen=True)
class ViewStatistics:
    """What a camera would see from a pose.

    Attributes
    ----------
    surface_fraction
        Fraction of the image that the surface covers, 0..1.
    observed_fraction
        Fraction of the surface in view that the source frame observed, 0..1; 0 if no surface is in view.
    clearance_mm
        Distance from the centre of projection to the nearest point of the surface.
    """

    surface_fraction: float
    observed_fraction: float
    clearance_mm: float


class Drawn(Protocol):
    """A distribution of camera poses."""

    def draw(self, rng: np.random.Generator) -> np.ndarray:
        """Draw one ``(4, 4)`` rigid ``cam_from_model``, mm."""
        ...


Probe = Callable[[np.ndarray], ViewStatistics]


@dataclass(frozen=True)
class Rejections:
    """How many poses broke each constraint; a pose that breaks two is counted in both."""

    surface: int = 0
    observed: int = 0
    clearance: int = 0

    def __add__(self, other: "Rejections") -> "Rejections":
        return Rejections(
            self.surface + other.surface, self.observed + other.observed, self.clearance + other.clearance
        )

    def __bool__(self) -> bool:
        return bool(self.surface or self.observed or self.clearance)


@dataclass(frozen=True, kw_only=True)
class Constraints:
    """What a view must show to be part of the dataset.

    Attributes
    ----------
    min_surface
        Smallest fraction of the image that the surface covers, 0..1, relative to ``reference_surface``.
    min_observed
        Smallest fraction of the surface in view that the source frame observed, 0..1.
    min_clearance_mm
        Smallest distance from the centre of projection to the surface.
    reference_surface
        Fraction of the image that the surface covers in the frame, 0..1: a small surface stays small in every view.
    max_attempts
        Poses tried per view before giving up.
    """

    min_surface: float = 0.0
    min_observed: float = 0.0
    min_clearance_mm: float = 0.0
    reference_surface: float = 1.0
    max_attempts: int = MAX_ATTEMPTS

    def broken_by(self, statistics: ViewStatistics) -> Rejections:
        """Count 1 for each constraint that a view breaks; a statistic that is NaN breaks its constraint."""
        return Rejections(
            surface=int(not statistics.surface_fraction >= self.min_surface * self.reference_surface),
            observed=int(not statistics.observed_fraction >= self.min_observed),
            clearance=int(not statistics.clearance_mm >= self.min_clearance_mm),
        )


@dataclass(frozen=True)
class PlannedPose:
    """The pose of one view and how it was found.

    Attributes
    ----------
    cam_from_model
        ``(4, 4)`` rigid, mm.
    statistics
        What this pose shows.
    attempts
        Number of poses tried, including this one.
    rejections
        Constraints that the rejected poses broke; for a pose from a list, those that it breaks itself.
    """

    cam_from_model: np.ndarray
    statistics: ViewStatistics
    attempts: int
    rejections: Rejections


def plan_pose(distribution: Drawn, constraints: Constraints, probe: Probe, *, seed: int, index: int) -> PlannedPose:
    """Draw poses of view ``index`` until one meets the constraints; the random numbers depend on (seed, index) only."""
    rng = np.random.default_rng([seed, index])
    rejections, rejected = Rejections(), []
    for attempt in range(1, constraints.max_attempts + 1):
        cam_from_model = distribution.draw(rng)
        statistics = probe(cam_from_model)
        broken = constraints.broken_by(statistics)
        if not broken:
            return PlannedPose(cam_from_model, statistics, attempt, rejections)
        rejections += broken
        rejected.append(statistics)
    raise InputError(_found_none(constraints, rejections, rejected, index))


def sampling_doubt(attempts: Sequence[int]) -> str:
    """A message if so few poses meet the constraints that a long run may fail; empty otherwise.

    ``attempts`` are the poses tried for each of some views that found one.
    """
    tried = sum(attempts)
    if not tried or len(attempts) >= LEAST_ACCEPTANCE * tried:
        return ""
    return (
        f"poses: about 1 of {tried / len(attempts):.0f} meets the constraints (expected: 1 of "
        f"{1 / LEAST_ACCEPTANCE:.0f} or more), so every view takes long, and a run ends at the first view that finds "
        f"none in {MAX_ATTEMPTS} tries; loosen the constraints, or draw poses nearer to the reference pose"
    )


def plan_given_pose(cam_from_model: np.ndarray, constraints: Constraints, probe: Probe) -> PlannedPose:
    """Plan a pose (4x4, mm) that is not rejected, whatever it shows."""
    statistics = probe(cam_from_model)
    return PlannedPose(cam_from_model, statistics, 1, constraints.broken_by(statistics))


def _found_none(constraints: Constraints, rejections: Rejections, rejected: list[ViewStatistics], index: int) -> str:
    def best(statistic: str) -> float:
        return float(np.nanmax([0.0, *(getattr(view, statistic) for view in rejected)]))

    surface, observed, clearance = constraints.min_surface, constraints.min_observed, constraints.min_clearance_mm
    # with a reference of 0 no view breaks it
    shown = best("surface_fraction") / (constraints.reference_surface or 1.0)
    reasons = [
        (
            rejections.surface, "min_surface",
            f"showed less than {100 * surface:g} % of the surface that the frame shows (the best: {100 * shown:.3g} %)",
        ),
        (
            rejections.observed, "min_observed",
            f"showed a surface of which less than {100 * observed:g} % was observed by the source frame "
            f"(the best: {100 * best('observed_fraction'):.3g} %)",
        ),
        (
            rejections.clearance, "min_clearance_mm",
            f"came nearer than {clearance:g} mm to the surface (the best: {best('clearance_mm'):.3g} mm)",
        ),
    ]  # fmt: skip
    broken = sorted((reason for reason in reasons if reason[0]), key=lambda reason: -reason[0])
    clauses = ", ".join(f"{count} {what}" for count, _, what in broken)
    return (
        f"view {index}: found no pose that meets the constraints: of {len(rejected)} poses tried, {clauses}; "
        f"lower {broken[0][1]}, which was broken most often, or draw poses nearer to the reference pose"
    )
