"""Synthetic views compared with real photographs of the same poses: how good the projection of one frame is."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ...case.loaded_case import LoadedCase
from ...case.posed_frame import UnreadFrame
from ...errors import InputError
from ...evaluation.scores.similarity import Similarity, similarity
from ...projection.rendered_view import RenderedView
from ..case.load_case import load_posed_frame
from ..colour.reference_view import colours_of, reference_view_of
from ..render.engines import opened_engine


@dataclass(frozen=True)
class Comparison:
    """A photograph and the synthetic view at its pose.

    Attributes
    ----------
    photograph, real, synthetic
        The photograph, its ``(H, W, 3)`` code values, and the view.
    compared
        ``(H, W)`` bool: surface that the frame saw, where the photograph's alpha is not 0.
    similarity
        Over these pixels; ``None`` if there are none.
    """

    photograph: UnreadFrame
    real: np.ndarray
    synthetic: RenderedView
    compared: np.ndarray
    similarity: Similarity | None

    def picture(self) -> np.ndarray:
        """``(H, 3 W, 3)``: the photograph, the view over the dimmed photograph, and their absolute difference."""
        compared = self.compared[..., None]
        over = np.where(compared, self.synthetic.rgb, 0.35 * self.real)
        difference = np.where(compared, np.abs(self.synthetic.rgb - self.real), 0)
        return np.concatenate([self.real, over, difference], axis=1)


def compare(loaded: LoadedCase, photographs: list[UnreadFrame], *, colour: str = "projective") -> Iterator[Comparison]:
    """Render the coloured surface at the pose of each photograph with the case's camera, and compare.

    Raises
    ------
    InputError
        A photograph cannot be used or differs from the frame in size; or, after the last one, none of them shows
        anything that the frame saw.
    """
    source = reference_view_of(loaded)
    colours, _ = colours_of(source, colour)
    overlapping = False
    with opened_engine("cycles", source.mesh, loaded.frame.camera, colours) as render:
        for photograph in photographs:
            real = load_posed_frame(photograph, loaded.surface.mesh_from_model, name=loaded.case.path.name)
            view = render(real.cam_from_model)
            compared = view.observed & real.valid
            found = similarity(real.image, view.rgb, compared) if compared.any() else None
            overlapping |= found is not None
            yield Comparison(photograph, real.image, view, compared, found)
    if photographs and not overlapping:
        raise InputError(
            f"{photographs[0].image}: expected a view of surface that the frame saw, neither it nor another photograph "
            "of the list shows any; check the poses"
        )
