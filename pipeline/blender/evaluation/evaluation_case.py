"""The cases of an evaluation: each with its photographs, and what these show of its surface."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ...case.loaded_case import LoadedCase
from ...case.posed_frame import PosedFrame, UnreadFrame
from ..case.load_case import load_posed_frame
from ..colour.reference_view import ReferenceView
from ..render.engines import opened_engine


@dataclass(frozen=True)
class EvaluationCase:
    """A case in memory and its photographs; ``images`` are their names, which differ."""

    name: str
    loaded: LoadedCase
    photographs: tuple[UnreadFrame, ...]
    images: tuple[str, ...]

    def photograph(self, number: int) -> PosedFrame:
        """A photograph in memory; InputError if it cannot be read, or differs from the frame in size."""
        mesh_from_model, name = self.loaded.surface.mesh_from_model, self.loaded.case.path.name
        return load_posed_frame(self.photographs[number], mesh_from_model, name=name)


@dataclass(frozen=True)
class ShownSurface:
    """What a photograph shows: ``(H, W)`` bool surface, and surface that the frame saw; ``(H, W)`` depth in mm."""

    surface: np.ndarray
    observed: np.ndarray
    depth_mm: np.ndarray


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


def shown_surfaces(case: EvaluationCase, source: ReferenceView) -> Iterator[ShownSurface]:
    """What each photograph shows of the surface, where its alpha is not 0."""
    with opened_engine("cycles", source.mesh, case.loaded.frame.camera, source.views) as render:
        for number in range(len(case.photographs)):
            photograph = case.photograph(number)
            view, valid = render(photograph.cam_from_model), photograph.valid
            depth_mm = np.where(valid, view.depth_mm, np.float32(0))
            yield ShownSurface(view.mask & valid, view.observed & valid, depth_mm)
