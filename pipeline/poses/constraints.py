"""The poses of a dataset: drawn by rejection sampling under constraints, or read from the user's list.

A *probe* measures what a pose shows: a callable ``cam_from_model -> ViewStatistics``. Accepted poses follow the
distribution conditioned on the constraints (rejection sampling, von Neumann, 1951). Poses from a list are the user's
own choice, so they are never rejected; those that break constraints are counted and reported.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
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
    """Draw poses of view ``index`` until one meets the constraints; the random numbers depend on (seed, index) only.

    Raises
    ------
    InputError
        None of ``max_attempts`` poses meets the constraints; the message says how many poses broke each constraint,
        the best value of each, and which one to loosen.
    """
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

    Parameters
    ----------
    attempts
        Poses tried for each of some views that found one.
    """
    tried = sum(attempts)
    if not tried or len(attempts) >= LEAST_ACCEPTANCE * tried:
        return ""
    return (
        f"poses: about 1 of {tried / len(attempts):.0f} meets the constraints (expected: 1 of "
        f"{1 / LEAST_ACCEPTANCE:.0f} or more), so every view takes long, and a run ends at the first view that finds "
        f"none in {MAX_ATTEMPTS} tries; loosen the constraints, or draw poses nearer to the reference pose"
    )


def plan_given_poses(
    cams_from_model: np.ndarray, constraints: Constraints, probe: Probe
) -> tuple[list[PlannedPose], list[str]]:
    """Plan ``(N, 4, 4)`` poses without rejecting any; also return messages that count those that break constraints."""
    planned = []
    for cam_from_model in cams_from_model:
        statistics = probe(cam_from_model)
        planned.append(PlannedPose(cam_from_model, statistics, 1, constraints.broken_by(statistics)))
    messages = []
    for field in fields(Rejections):
        breaking = [index for index, plan in enumerate(planned) if getattr(plan.rejections, field.name)]
        if breaking:
            option, what, _ = _reason(field.name, constraints, [planned[breaking[0]].statistics])
            messages.append(
                f"pose list: {len(breaking)} of {len(planned)} poses {what} ({option}); "
                f"all are kept, the first is pose {breaking[0]} (counted from 0)"
            )
    return planned, messages


def _found_none(constraints: Constraints, rejections: Rejections, rejected: list[ViewStatistics], index: int) -> str:
    counts = {field.name: getattr(rejections, field.name) for field in fields(rejections)}
    reasons = []
    for name in sorted(counts, key=counts.__getitem__, reverse=True):
        option, what, best = _reason(name, constraints, rejected)
        if counts[name]:
            reasons.append((option.split(" ")[0], f"{counts[name]} {what} (the best: {best})"))
    return (
        f"view {index}: found no pose that meets the constraints: of {len(rejected)} poses tried, "
        f"{', '.join(clause for _, clause in reasons)}; "
        f"lower {reasons[0][0]}, which was broken most often, or draw poses nearer to the reference pose"
    )


def _reason(name: str, constraints: Constraints, views: list[ViewStatistics]) -> tuple[str, str, str]:
    """Option and its value, a clause that says how a view breaks it, and the best value among the views."""
    if name == "surface":
        best = np.nanmax([0.0, *(view.surface_fraction for view in views)])
        wanted = constraints.min_surface
        what = f"showed less than {100 * wanted:g} % of the surface that the frame shows"
        # with a reference of 0 no view breaks it
        share = best / (constraints.reference_surface or 1.0)
        return f"min_surface = {wanted:g}", what, f"{100 * share:.3g} %"
    if name == "observed":
        best = np.nanmax([0.0, *(view.observed_fraction for view in views)])
        wanted = constraints.min_observed
        what = f"showed a surface of which less than {100 * wanted:g} % was observed by the source frame"
        return f"min_observed = {wanted:g}", what, f"{100 * best:.3g} %"
    best = np.nanmax([0.0, *(view.clearance_mm for view in views)])
    wanted = constraints.min_clearance_mm
    return f"min_clearance_mm = {wanted:g}", f"came nearer than {wanted:g} mm to the surface", f"{best:.3g} mm"
