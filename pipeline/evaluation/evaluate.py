"""Score the views of several methods against real photographs, and estimate what could be reached.

Methods are opened one after the other, and photographs are read one after the other, so that only one scene and one
photograph are in memory.
"""

import math
import time
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..case.frame import PosedFrame, UnreadFrame, load_posed_frame
from ..case.loaded_case import LoadedCase
from ..colour.lens_shading import lens_shading_of
from ..colour.ray_tracer import RayTracer
from ..colour.reference_view import ReferenceView, traced_view_of
from ..colour.shading import ColouredSurface
from ..dataset.description import distribution_of
from ..dataset.options import NONE, SHADOWS, DatasetOptions
from ..poses.distributions import ReferencePose
from ..projection.rendered_view import Render
from ..transforms import camera_centre
from .findings import Findings
from .finished_scores import BOUND
from .methods import ChosenMethods, Method, opened
from .record.evaluation_record import Row
from .scores.inception import Inception
from .scores.reachable_scores import JITTERS, perfect_views
from .scores.view_scores import SCORES, scores_of

NOVEL_POSES = 6
"""Pairs of the gallery for each case."""


@dataclass(frozen=True)
class EvaluationCase:
    """A case in memory and its photographs; ``images`` are their names, which differ."""

    name: str
    loaded: LoadedCase
    photographs: tuple[UnreadFrame, ...]
    images: tuple[str, ...]


@dataclass(frozen=True)
class ShownSurface:
    """A photograph and what it shows where its alpha is not 0.

    Attributes
    ----------
    number, real
        Its place in the case, and ``(H, W, 3)`` code values 0..1.
    surface, observed
        ``(H, W)`` bool: surface, and surface that the frame saw.
    depth_mm
        ``(H, W)`` of the surface; 0 without surface.
    """

    number: int
    real: np.ndarray
    surface: np.ndarray
    observed: np.ndarray
    depth_mm: np.ndarray


@dataclass(frozen=True)
class View:
    """A view beside its photograph, or of a novel pose of this number, for pictures: ``(H, W, 3)`` code values 0..1."""

    case: EvaluationCase
    number: int
    method: Method
    rendered: np.ndarray
    shown: ShownSurface | None = None


@dataclass(frozen=True)
class Settings:
    """How to evaluate.

    Attributes
    ----------
    methods
        What to compare.
    seed
        Of the bootstrap, the novel poses and the errors of poses.
    pose_error_px
        Error of the poses for the bound; ``None`` takes the residual displacement that was measured.
    inception
        Network for FID and KID, if there is one.
    """

    methods: ChosenMethods
    seed: int
    pose_error_px: float | None
    inception: Inception | None

    @property
    def compared(self) -> list[Method]:
        """The leading method and a peer, else the second: the methods of the figure and of the gallery."""
        leading, *others = self.methods.running
        return [leading, *sorted(others, key=lambda method: not method.peer)[:1]]


@dataclass(frozen=True)
class EvaluationRun:
    """What to evaluate, and where to write it.

    Attributes
    ----------
    out, inputs
        The folder, and all files that are read but the photographs, by what they are.
    cases, settings
        The cases; methods and seeds.
    pictures
        Number of photographs of each case of which pictures are written.
    """

    out: Path
    inputs: Mapping[str, Path]
    cases: Sequence[EvaluationCase]
    settings: Settings
    pictures: int


def named_cases(
    given: Sequence[tuple[LoadedCase, Sequence[UnreadFrame]]],
) -> tuple[EvaluationCase, ...]:
    """Give each case the name of its surface, and each photograph its number: names of files may name the patient."""
    cases: list[EvaluationCase] = []
    for place, (loaded, photographs) in enumerate(given, start=1):
        name = loaded.case.object_name or "case"
        if name in {case.name for case in cases}:
            name = f"{name} {place}"
        images = tuple(f"photograph_{number}" for number in range(1, len(photographs) + 1))
        cases.append(EvaluationCase(name, loaded, tuple(photographs), images))
    return tuple(cases)


def steps_px(case: EvaluationCase, methods: int) -> list[int]:
    """Pixels of the photograph of each step of :func:`evaluate_case`."""
    return [math.prod(case.loaded.frame.camera.size_wh)] * len(case.photographs) * (methods + 1)


def evaluate_case(
    case: EvaluationCase,
    settings: Settings,
    findings: Findings,
    *,
    novel: int,
    pictured: Collection[int],
    advance: Callable[[], None],
) -> Iterator[View]:
    """Evaluate one case and add the results to ``findings``.

    Parameters
    ----------
    case, settings, findings
        What, how, and where to put it.
    novel
        Number of novel poses at which the compared methods are shown.
    pictured
        Numbers of photographs whose views are rendered even if their scores are finished.
    advance
        Called after each step.

    Yields
    ------
    The views that are rendered, in the order of the photographs for each method, then its views of novel poses.

    Raises
    ------
    InputError
        A photograph cannot be used, or the case shows no surface, or has no light at the lens that a method needs.
    """
    began = time.perf_counter()
    reference = traced_view_of(case.loaded)
    sources = {NONE: reference}
    for light in {method.light for method in settings.methods.running} - {NONE}:
        shading = lens_shading_of(case.loaded, shadows=light == SHADOWS)
        sources[light] = traced_view_of(case.loaded, shading)
    trace = RayTracer(ColouredSurface(reference.mesh, reference.views), case.loaded.frame.camera).render
    novel_poses = _novel_poses(case, reference, settings.seed)[:novel]
    mesh_from_model = case.loaded.surface.mesh_from_model
    poses = [photograph.cam_from_mesh @ mesh_from_model for photograph in case.photographs] + novel_poses
    numbers, finished = range(len(case.photographs)), findings.finished
    real_features: dict[int, np.ndarray] = {}
    for method in settings.methods.running:
        keys = [(case.name, method.name, number) for number in numbers]
        known = [number for number in numbers if keys[number] in finished]
        # the first view that there is stands for the case in the figure
        again = {*pictured, *[number for number in known if _shows_surface(finished.scores(keys[number]))][:1]}
        rendered = [number for number in numbers if number in again or number not in known]
        for _ in known:
            advance()
        with opened(
            method, settings.methods.renderers, sources[method.light], case.loaded.frame.camera, poses
        ) as render:
            findings.preparation_seconds += time.perf_counter() - began
            for shown in _shown_surfaces(case, trace, rendered):
                key, both = keys[shown.number], None
                if not shown.surface.any():
                    if key not in finished:
                        finished.add(key, dict.fromkeys(SCORES, float("nan")))
                        advance()
                    continue
                view = View(case, shown.number, method, render(poses[shown.number]), shown)
                if key not in finished:
                    if settings.inception is not None:
                        if shown.number not in real_features:
                            real_features[shown.number] = _features(settings.inception, shown.real, shown)
                        both = real_features[shown.number], _features(settings.inception, view.rendered, shown)
                    scores = scores_of(shown.real, view.rendered, shown.surface, shown.observed)
                    scores["angle_deg"] = _angle_deg(case.loaded.frames, poses[shown.number], reference.pivot_model)
                    finished.add(key, scores, both)
                    advance()
                yield view
            if method in settings.compared:
                for number, pose in enumerate(novel_poses):
                    yield View(case, number, method, render(pose))
        began = time.perf_counter()
        rows = [Row(case.name, case.images[number], method.name, finished.scores(keys[number])) for number in numbers]
        findings.rows += rows
        features = [both for key in keys if (both := finished.features(key)) is not None]
        if features:
            real, views = (np.stack(each) for each in zip(*features, strict=True))
            findings.features[case.name, method.name] = real, views
        if method == settings.methods.running[0]:
            leading = rows
            nothing = (row.image for row in rows if not _shows_surface(row.scores))
            findings.without_overlap += [(case.name, image) for image in nothing]
    _add_bound(case, trace, leading, settings, findings, advance)


def _angle_deg(frames: Sequence[PosedFrame], pose: np.ndarray, pivot_model: np.ndarray) -> float:
    """How far the lens of a pose (4x4, mm) has gone around a surface point from the nearest of the frames' lenses."""
    towards = np.array([camera_centre(each) - pivot_model for each in (pose, *(f.cam_from_model for f in frames))])
    towards /= np.linalg.norm(towards, axis=1, keepdims=True)
    return float(np.degrees(np.arccos(np.clip((towards[1:] @ towards[0]).max(), -1, 1))))


def _shows_surface(scores: Mapping[str, float]) -> bool:
    return not np.isnan(scores["ssim_whole"])


def _shown_surfaces(case: EvaluationCase, trace: Render, numbers: Iterable[int]) -> Iterator[ShownSurface]:
    for number in numbers:
        photograph = case.photographs[number]
        frame = load_posed_frame(photograph, case.loaded.surface.mesh_from_model, name=case.loaded.case.path.name)
        view = trace(frame.cam_from_model)
        depth_mm = np.where(frame.valid, view.depth_mm, np.float32(0))
        yield ShownSurface(number, frame.image, view.mask & frame.valid, view.observed & frame.valid, depth_mm)


def _novel_poses(case: EvaluationCase, reference: ReferenceView, seed: int) -> list[np.ndarray]:
    """Poses from the default distribution of datasets."""
    pose = ReferencePose(case.loaded.frame.cam_from_model, reference.pivot_model)
    poses = distribution_of(DatasetOptions(), pose, case.loaded.frame.camera)
    return [poses.draw(np.random.default_rng([seed, number])) for number in range(NOVEL_POSES)]


def _features(inception: Inception, image: np.ndarray, shown: ShownSurface) -> np.ndarray:
    """Features of the whole image, black outside the surface."""
    return inception(np.where(shown.surface[..., None], image, np.float32(0)))


def _add_bound(
    case: EvaluationCase,
    trace: Render,
    leading: Sequence[Row],
    settings: Settings,
    findings: Findings,
    advance: Callable[[], None],
) -> None:
    """Score perfect views with the measured exposure, and with the measured or the stated error of the poses."""
    measured = [row.scores["flow_px"] for row in leading if np.isfinite(row.scores["flow_px"])]
    jitter = settings.pose_error_px
    if jitter is None:
        jitter = float(np.median(measured)) if measured else 0.0
    findings.jitter_px[case.name] = jitter
    reached = findings.bound.setdefault(case.name, [])
    keys = [(case.name, BOUND, number) for number in range(len(case.photographs))]
    seen = [number for number in range(len(keys)) if _shows_surface(leading[number].scores)]
    rest = [number for number in seen if keys[number] not in findings.finished]
    for _ in range(len(keys) - len(rest)):
        advance()
    for shown in _shown_surfaces(case, trace, rest):
        scores = leading[shown.number].scores
        gain = np.array([scores[f"gain_{name}"] for name in ("red", "green", "blue")])
        gain = np.where(np.isfinite(gain), gain, 1.0)
        rngs = [np.random.default_rng([settings.seed, shown.number, draw]) for draw in range(JITTERS)]
        views = perfect_views(shown.real, shown.depth_mm, case.loaded.frame.camera, gain, jitter, rngs)
        draws = [scores_of(shown.real, view, shown.surface, shown.observed) for view in views]
        means = {score: float(np.mean([each[score] for each in draws])) for score in SCORES}
        findings.finished.add(keys[shown.number], means)
        advance()
    reached += [(case.images[number], findings.finished.scores(keys[number])) for number in seen]


def shown_numbers(count: int, most: int) -> Iterable[int]:
    """Which of ``count`` photographs are shown if at most ``most`` may be: evenly spread, with both ends."""
    if count <= most:
        return range(count)
    return sorted({round(number) for number in np.linspace(0, count - 1, most)}) if most else ()
