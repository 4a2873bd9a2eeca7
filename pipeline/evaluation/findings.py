"""What an evaluation has found so far, and what follows of it: the bound of each score, FID and KID."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from .finished_scores import FinishedScores
from .record.evaluation_record import ALL, Bound, Distribution, EvaluatedCase, Row, clusters
from .scores.distribution_distance import FEWEST_IMAGES, FID_IMAGES, frechet_distance, kernel_distance
from .scores.mean_intervals import Resampling
from .scores.view_scores import SCORES

UNBOUNDED = (
    "angle_deg", "surface_px", "observed_px", "gain_red", "gain_green", "gain_blue", "flow_px", "flow_high_px",
)  # fmt: skip
"""Scores without a bound: what they measure is what the bound is given."""


@dataclass
class Findings:
    """What was found so far; ``features`` are those of photographs and views by case and method.

    ``finished`` has the scores of views, of an interrupted evaluation too.
    """

    finished: FinishedScores
    rows: list[Row] = field(default_factory=list)
    features: dict[tuple[str, str], tuple[np.ndarray, np.ndarray]] = field(default_factory=dict)
    bound: dict[str, list[tuple[str, dict[str, float]]]] = field(default_factory=dict)
    jitter_px: dict[str, float] = field(default_factory=dict)
    without_overlap: list[tuple[str, str]] = field(default_factory=list)
    preparation_seconds: float = 0.0


def bounds(findings: Findings, cases: Sequence[EvaluatedCase], rng: np.random.Generator) -> Iterator[Bound]:
    """The bound of every score, for each case and for all."""
    everything = [(case, *each) for case, reached in findings.bound.items() for each in reached]
    for name in (*findings.bound, ALL):
        own = [each for each in everything if name in (ALL, each[0])]
        if not own:
            continue
        resampling = Resampling(clusters([(case, image) for case, image, _ in own], cases), rng)
        jitter_px = resampling.interval(np.array([findings.jitter_px[case] for case, _, _ in own])).mean
        for score in SCORES:
            if score not in UNBOUNDED:
                found = resampling.interval(np.array([scores[score] for _, _, scores in own]))
                yield Bound(name, score, found.mean, found.low, found.high, jitter_px)


def distributions(findings: Findings) -> Iterator[Distribution]:
    """FID and KID for each case and method, and for all cases."""
    groups = dict(findings.features)
    for method in dict.fromkeys(method for _, method in findings.features):
        sets = [both for (_, name), both in findings.features.items() if name == method]
        groups[ALL, method] = (np.concatenate([real for real, _ in sets]), np.concatenate([view for _, view in sets]))
    for (case, method), (real, rendered) in groups.items():
        if len(real) >= FEWEST_IMAGES:
            kernel = kernel_distance(real, rendered)
            yield Distribution(
                case, method, frechet_distance(real, rendered), len(real) < FID_IMAGES, kernel.kid,
                kernel.standard_error, len(real),
            )  # fmt: skip
