"""Synthetic views compared with real photographs of the same poses: how good the projection of one frame is."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ...case.loaded_case import LoadedCase
from ...dataset.view import RenderedView
from ...errors import InputError
from ...evaluation.photographs import PosedPhotograph
from ...evaluation.similarity import Similarity, similarity
from ..bridge.image import read_image
from ..colour.reference_view import colour_of, reference_view_of
from ..render.engines import render_view
from ..render.surface_scene import SurfaceScene


@dataclass(frozen=True)
class Comparison:
    """A photograph, the synthetic view at its pose, and their similarity over the observed surface."""

    photograph: PosedPhotograph
    real: np.ndarray
    synthetic: RenderedView
    similarity: Similarity

    def picture(self) -> np.ndarray:
        """``(H, 3 W, 3)``: the photograph, the view over the dimmed photograph, and their absolute difference."""
        observed = self.synthetic.observed[..., None]
        over = np.where(observed, self.synthetic.rgb, 0.35 * self.real)
        difference = np.where(observed, np.abs(self.synthetic.rgb - self.real), 0)
        return np.concatenate([self.real, over, difference], axis=1)


def compare(
    loaded: LoadedCase, photographs: list[PosedPhotograph], *, colour: str = "projective"
) -> Iterator[Comparison]:
    """Render the coloured surface at the pose of each photograph with the case's camera, and compare.

    Raises
    ------
    InputError
        A photograph cannot be used, differs from the frame in size, or shows nothing that the frame saw.
    """
    source = reference_view_of(loaded)
    surface_colour, _ = colour_of(source, colour)
    camera = loaded.case.camera
    with SurfaceScene(source.mesh, camera, surface_colour) as scene:
        for photograph in photographs:
            real, _ = read_image(photograph.path)
            if real.shape[:2] != camera.shape_hw:
                raise InputError(
                    f"{photograph.path}: expected {camera.width}x{camera.height} px as the frame has, "
                    f"found {real.shape[1]}x{real.shape[0]}"
                )
            view = render_view(scene, photograph.cam_from_model)
            if not view.observed.any():
                raise InputError(f"{photograph.path}: expected a view of surface that the frame saw, it shows none")
            yield Comparison(photograph, real, view, similarity(real, view.rgb, view.observed))
