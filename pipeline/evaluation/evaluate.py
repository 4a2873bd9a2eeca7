"""Score the views of several methods against real photographs.

Methods are opened one after the other, and photographs are read one after the other, so that only one scene and one
photograph are in memory.
"""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ..case.frame import PosedFrame, UnreadFrame, load_posed_frame
from ..case.loaded_case import LoadedCase
from ..colour.lens_shading import lens_shading_of
from ..colour.ray_tracer import RayTracer
from ..colour.reference_view import reference_view, traced_surface
from ..colour.shading import ColouredSurface
from ..dataset.options import NONE, SHADOWS
from ..projection.rendered_view import Render
from ..transforms import camera_centre
from .methods import ChosenMethods, Method, opened
from .scores.inception import Inception
from .scores.view_scores import scores_of


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
    """

    number: int
    real: np.ndarray
    surface: np.ndarray
    observed: np.ndarray


@dataclass(frozen=True)
class ScoredView:
    """A view beside its photograph.

    Attributes
    ----------
    case, method, shown
        What was rendered, how, and the photograph of its pose.
    rendered
        ``(H, W, 3)`` code values 0..1.
    scores
        See :mod:`oneframe.evaluation.scores.view_scores`; NaN for those that it does not have.
    features
        Of the photograph and of the view, ``(2048,)`` float32 each, black outside the surface; ``None`` without a
        network.
    """

    case: EvaluationCase
    method: Method
    shown: ShownSurface
    rendered: np.ndarray
    scores: dict[str, float]
    features: tuple[np.ndarray, np.ndarray] | None

    @property
    def image(self) -> str:
        """Name of the photograph."""
        return self.case.images[self.shown.number]

    @property
    def shows_surface(self) -> bool:
        """Whether there is anything to compare."""
        return not math.isnan(self.scores["ssim_whole"])


def named_cases(given: Sequence[tuple[LoadedCase, Sequence[UnreadFrame]]]) -> tuple[EvaluationCase, ...]:
    """Give each case the name of its surface, and each photograph its number: names of files may name the patient."""
    cases: list[EvaluationCase] = []
    for place, (loaded, photographs) in enumerate(given, start=1):
        name = loaded.case.object_name or "case"
        if name in {case.name for case in cases}:
            name = f"{name} {place}"
        images = tuple(f"photograph_{number}" for number in range(1, len(photographs) + 1))
        cases.append(EvaluationCase(name, loaded, tuple(photographs), images))
    return tuple(cases)


def scored_views(case: EvaluationCase, methods: ChosenMethods, inception: Inception | None) -> Iterator[ScoredView]:
    """Render and score every photograph's view by every method, method by method.

    A photograph that cannot be used is an ``InputError``, as is a case without surface in view, or without the light at
    the lens that a method needs.
    """
    reference = reference_view(case.loaded, traced_surface)
    references = {NONE: reference}
    for light in {method.light for method in methods.running} - {NONE}:
        shading = lens_shading_of(case.loaded, shadows=light == SHADOWS)
        references[light] = reference_view(case.loaded, traced_surface, shading)
    camera, mesh_from_model = case.loaded.frame.camera, case.loaded.surface.mesh_from_model
    trace = RayTracer(ColouredSurface(reference.mesh, reference.views), camera).render
    poses = [photograph.cam_from_mesh @ mesh_from_model for photograph in case.photographs]
    real_features: dict[int, np.ndarray] = {}
    for method in methods.running:
        with opened(method, methods.renderers, references[method.light], camera, poses) as render:
            for shown in _shown_surfaces(case, trace, range(len(poses))):
                pose, both = poses[shown.number], None
                rendered = render(pose)
                if inception is not None and shown.surface.any():
                    if shown.number not in real_features:
                        real_features[shown.number] = _features(inception, shown.real, shown)
                    both = real_features[shown.number], _features(inception, rendered, shown)
                scores = scores_of(shown.real, rendered, shown.surface, shown.observed)
                scores["angle_deg"] = _angle_deg(case.loaded.frames, pose, reference.pivot_model)
                yield ScoredView(case, method, shown, rendered, scores, both)


def _angle_deg(frames: Sequence[PosedFrame], pose: np.ndarray, pivot_model: np.ndarray) -> float:
    """How far the lens of a pose (4x4, mm) has gone around a surface point from the nearest of the frames' lenses."""
    towards = np.array([camera_centre(each) - pivot_model for each in (pose, *(f.cam_from_model for f in frames))])
    towards /= np.linalg.norm(towards, axis=1, keepdims=True)
    return float(np.degrees(np.arccos(np.clip((towards[1:] @ towards[0]).max(), -1, 1))))


def _shown_surfaces(case: EvaluationCase, trace: Render, numbers: Iterable[int]) -> Iterator[ShownSurface]:
    for number in numbers:
        photograph = case.photographs[number]
        frame = load_posed_frame(photograph, case.loaded.surface.mesh_from_model, name=case.loaded.case.path.name)
        view = trace(frame.cam_from_model)
        yield ShownSurface(number, frame.image, view.mask & frame.valid, view.observed & frame.valid)


def _features(inception: Inception, image: np.ndarray, shown: ShownSurface) -> np.ndarray:
    """Features of the whole image, black outside the surface."""
    return inception(np.where(shown.surface[..., None], image, np.float32(0)))
