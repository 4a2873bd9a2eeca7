"""The cases of an evaluation: each with its photographs, and what these show of its surface."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ...case.loaded_case import LoadedCase
from ...case.posed_frame import PosedFrame
from ...errors import InputError
from ...evaluation.photographs import PosedPhotograph
from ..bridge.image import read_image
from ..colour.reference_view import ReferenceView
from ..render.engines import render_view
from ..render.surface_scene import SurfaceScene


@dataclass(frozen=True)
class EvaluationCase:
    """A case in memory and its photographs; ``images`` are their names, which differ."""

    name: str
    loaded: LoadedCase
    photographs: tuple[PosedPhotograph, ...]
    images: tuple[str, ...]


@dataclass(frozen=True)
class ShownSurface:
    """What a photograph shows: ``(H, W)`` bool surface, and surface that the frame saw; ``(H, W)`` depth in mm."""

    surface: np.ndarray
    observed: np.ndarray
    depth_mm: np.ndarray


def named_cases(
    given: Sequence[tuple[LoadedCase, Sequence[PosedPhotograph]]],
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


def read_photograph(photograph: PosedPhotograph, loaded: LoadedCase) -> PosedFrame:
    """The photograph of a list in memory; it is not valid where its alpha is 0.

    Raises
    ------
    InputError
        It cannot be read, or differs from the frame in size.
    """
    image, valid = read_image(photograph.path)
    camera = loaded.frame.camera
    if image.shape[:2] != camera.shape_hw:
        raise InputError(
            f"{photograph.path}: expected {camera.width}x{camera.height} px as the frame has, "
            f"found {image.shape[1]}x{image.shape[0]}; give photographs of the case's camera"
        )
    return PosedFrame(image, valid, camera, photograph.cam_from_model, path=photograph.path)


def shown_surfaces(case: EvaluationCase, source: ReferenceView) -> Iterator[ShownSurface]:
    """What each photograph shows of the surface, where its alpha is not 0."""
    with SurfaceScene(source.mesh, case.loaded.frame.camera, source.view) as scene:
        for photograph in case.photographs:
            valid = read_photograph(photograph, case.loaded).valid
            view = render_view(scene, photograph.cam_from_model)
            depth_mm = np.where(valid, view.depth_mm, np.float32(0))
            yield ShownSurface(view.mask & valid, view.observed & valid, depth_mm)
