"""Score the views of several methods against real photographs, and estimate what could be reached.

Methods are opened one after the other, so that only one scene is in memory; scoring runs in threads beside the renders.
"""

import math
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field

import numpy as np

from ...dataset.options import DatasetOptions
from ...evaluation.record.evaluation_record import ALL, Bound, Distribution, Row
from ...evaluation.scores.distribution_distance import (
    FEWEST_IMAGES,
    FID_IMAGES,
    frechet_distance,
    kernel_distance,
    mean_interval,
)
from ...evaluation.scores.inception import Inception
from ...evaluation.scores.reachable_scores import JITTERS, perfect_view
from ...evaluation.scores.view_scores import SCORES, scores_of
from ...files.machine import available_cores
from ...poses.distributions import Cone, ReferencePose
from ..colour.reference_view import ReferenceView, reference_view_of
from .evaluation_case import EvaluationCase, ShownSurface, shown_surfaces
from .methods import Method, opened

NOVEL_POSES = 6
"""Pairs of the gallery for each case."""
UNBOUNDED = ("surface_px", "observed_px", "gain_red", "gain_green", "gain_blue", "flow_px", "flow_high_px")
"""Scores without a bound: what they measure is what the bound is given."""


@dataclass(frozen=True)
class View:
    """A view beside its photograph, for pictures: ``(H, W, 3)`` code values 0..1 and ``(H, W)`` bool."""

    case: EvaluationCase
    number: int
    method: Method
    real: np.ndarray
    rendered: np.ndarray
    shown: ShownSurface


@dataclass(frozen=True)
class NovelView:
    """A view of a novel pose, for the gallery."""

    case: EvaluationCase
    number: int
    method: Method
    rendered: np.ndarray


@dataclass(frozen=True)
class Settings:
    """How to evaluate.

    Attributes
    ----------
    methods
        Those that can run.
    seed
        Of the bootstrap, the novel poses and the errors of poses.
    pose_error_px
        Error of the poses for the bound; ``None`` takes the residual displacement that was measured.
    inception
        Network for FID and KID, if there is one.
    """

    methods: Sequence[Method]
    seed: int
    pose_error_px: float | None
    inception: Inception | None


@dataclass
class Findings:
    """What was found so far; ``features`` are those of photographs and views by case and method."""

    rows: list[Row] = field(default_factory=list)
    features: dict[tuple[str, str], tuple[np.ndarray, np.ndarray]] = field(default_factory=dict)
    bound: dict[str, list[dict[str, float]]] = field(default_factory=dict)
    jitter_px: dict[str, float] = field(default_factory=dict)
    without_overlap: list[tuple[str, str]] = field(default_factory=list)


def steps_px(case: EvaluationCase, methods: int) -> list[int]:
    """Pixels of the photograph of each step of :func:`evaluate_case`."""
    return [math.prod(case.loaded.frame.camera.size_wh)] * len(case.photographs) * (methods + 2)


def evaluate_case(
    case: EvaluationCase,
    settings: Settings,
    findings: Findings,
    *,
    advance: Callable[[], None],
    show: Callable[[View], None],
    show_novel: Callable[[NovelView], None],
) -> None:
    """Evaluate one case and add the results to ``findings``.

    Parameters
    ----------
    case, settings, findings
        What, how, and where to put it.
    advance
        Called after each step.
    show, show_novel
        Get the views, in the order of the photographs for each method.

    Raises
    ------
    InputError
        A photograph cannot be used, or the case shows no surface.
    """
    source = reference_view_of(case.loaded)
    shown = []
    for each in shown_surfaces(case, source):
        shown.append(_Packed(each))
        advance()
    hidden = [number for number, each in enumerate(shown) if not each.overlaps]
    findings.without_overlap += [(case.name, case.images[number]) for number in hidden]
    novel = _novel_poses(case, source, settings.seed)
    mesh_from_model = case.loaded.surface.mesh_from_model
    poses = [photograph.cam_from_mesh @ mesh_from_model for photograph in case.photographs]
    real_features: dict[int, np.ndarray] = {}
    for method in settings.methods:
        features: dict[int, np.ndarray] = {}
        with opened(method, source, case.loaded.frame.camera, poses + novel) as render, _Scorer() as scorer:
            for number, pose in enumerate(poses):
                if shown[number].overlaps:
                    real = case.photograph(number).image
                    view = View(case, number, method, real, render(pose), shown[number].surfaces())
                    scorer.submit(number, view.real, view.rendered, view.shown)
                    if settings.inception is not None:
                        features[number] = _features(settings.inception, view.rendered, view.shown)
                        if number not in real_features:
                            real_features[number] = _features(settings.inception, real, view.shown)
                    show(view)
                advance()
            for number, pose in enumerate(novel):
                show_novel(NovelView(case, number, method, render(pose)))
            found = scorer.results()
        nothing = dict.fromkeys(SCORES, float("nan"))
        findings.rows += [
            Row(case.name, image, method.name, found.get(number, nothing)) for number, image in enumerate(case.images)
        ]
        if features:
            order = sorted(features)
            findings.features[case.name, method.name] = (
                np.stack([real_features[number] for number in order]),
                np.stack([features[number] for number in order]),
            )
    _add_bound(case, source, settings, findings, advance)


def _novel_poses(case: EvaluationCase, source: ReferenceView, seed: int) -> list[np.ndarray]:
    """Poses from the default distribution of datasets."""
    options = DatasetOptions()
    cone = Cone(
        reference=ReferencePose(case.loaded.frame.cam_from_model, source.pivot_model),
        cone_deg=options.cone_deg,
        roll_deg=options.roll_deg,
        distance_min=options.distance_min,
        distance_max=options.distance_max,
        shift_mm=options.shift_mm,
    )
    return [cone.draw(np.random.default_rng([seed, number])) for number in range(NOVEL_POSES)]


def _features(inception: Inception, image: np.ndarray, shown: ShownSurface) -> np.ndarray:
    """Of the whole image, black outside the surface."""
    return inception(np.where(shown.surface[..., None], image, np.float32(0)))


def _add_bound(
    case: EvaluationCase,
    source: ReferenceView,
    settings: Settings,
    findings: Findings,
    advance: Callable[[], None],
) -> None:
    """Score perfect views with the measured exposure, and with the measured or the stated error of the poses."""
    leading = settings.methods[0].name
    rows = {row.image: row.scores for row in findings.rows if (row.case, row.method) == (case.name, leading)}
    measured = [scores["flow_px"] for scores in rows.values() if np.isfinite(scores["flow_px"])]
    jitter = settings.pose_error_px
    if jitter is None:
        jitter = float(np.median(measured)) if measured else 0.0
    findings.jitter_px[case.name] = jitter
    camera, reached = case.loaded.frame.camera, findings.bound.setdefault(case.name, [])
    with _Scorer() as scorer:
        for number, shown in enumerate(shown_surfaces(case, source)):
            if shown.surface.any():
                real = case.photograph(number).image
                scores = rows[case.images[number]]
                gain = np.array([scores[f"gain_{name}"] for name in ("red", "green", "blue")])
                gain = np.where(np.isfinite(gain), gain, 1.0)
                for draw in range(JITTERS):
                    rng = np.random.default_rng([settings.seed, number, draw])
                    view = perfect_view(real, shown.depth_mm, camera, gain, jitter, rng)
                    scorer.submit(JITTERS * number + draw, real, view, shown)
            advance()
        found = scorer.results()
    for number in range(len(case.photographs)):
        draws = [found[key] for key in range(JITTERS * number, JITTERS * (number + 1)) if key in found]
        if draws:
            reached.append({score: float(np.mean([each[score] for each in draws])) for score in SCORES})


def bounds(findings: Findings, rng: np.random.Generator) -> Iterator[Bound]:
    """The bound of every score, for each case and for all."""
    everything = [scores for reached in findings.bound.values() for scores in reached]
    jitters = [findings.jitter_px[case] for case, reached in findings.bound.items() for _ in reached]
    groups = [(case, reached, findings.jitter_px[case]) for case, reached in findings.bound.items()]
    for case, reached, jitter in [*groups, (ALL, everything, float(np.mean(jitters)) if jitters else 0.0)]:
        for score in SCORES:
            if score not in UNBOUNDED:
                found = mean_interval(np.array([scores[score] for scores in reached]), rng)
                yield Bound(case, score, found.mean, found.low, found.high, jitter)


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


class _Packed:
    """The masks of a photograph in an eighth of the memory."""

    def __init__(self, shown: ShownSurface) -> None:
        self._shape = shown.surface.shape
        self._bits = [np.packbits(mask) for mask in (shown.surface, shown.observed)]
        self.overlaps = bool(shown.surface.any())

    def surfaces(self) -> ShownSurface:
        count = self._shape[0] * self._shape[1]
        surface, observed = (np.unpackbits(b, count=count).astype(bool).reshape(self._shape) for b in self._bits)
        return ShownSurface(surface, observed, np.zeros((0, 0), np.float32))


class _Scorer:
    """Scores views in threads while the next one is rendered, with a bounded number in memory."""

    def __init__(self) -> None:
        self._threads = available_cores()
        self._pool = ThreadPoolExecutor(self._threads, "score")
        self._waiting: deque[tuple[int, Future[dict[str, float]]]] = deque()
        self._found: dict[int, dict[str, float]] = {}

    def __enter__(self) -> "_Scorer":
        return self

    def __exit__(self, *_: object) -> None:
        self._pool.shutdown(cancel_futures=True)

    def submit(self, key: int, real: np.ndarray, rendered: np.ndarray, shown: ShownSurface) -> None:
        """Score a view; waits while too many are waiting."""
        self._waiting.append((key, self._pool.submit(scores_of, real, rendered, shown.surface, shown.observed)))
        self._collect(2 * self._threads)

    def results(self) -> dict[int, dict[str, float]]:
        """All scores by key, once they are complete."""
        self._collect(0)
        return self._found

    def _collect(self, leave: int) -> None:
        while len(self._waiting) > leave:
            key, future = self._waiting.popleft()
            self._found[key] = future.result()


def shown_numbers(count: int, most: int) -> Iterable[int]:
    """Which of ``count`` photographs are shown if at most ``most`` may be: evenly spread, with both ends."""
    if count <= most:
        return range(count)
    return sorted({round(number) for number in np.linspace(0, count - 1, most)}) if most else ()
