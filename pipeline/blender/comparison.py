"""Synthetic views beside real photographs of the same poses: what projecting one frame is worth."""

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..errors import InputError
from ..frames import checked_rigid
from ..metrics import Likeness, likeness
from .image import read_image
from .loading import LoadedCase
from .render import RenderedView, render_view
from .scene import SurfaceScene
from .source import colour_of, source_of


@dataclass(frozen=True)
class PosedPhotograph:
    """A real photograph: its file and ``cam_from_model`` (4x4, mm)."""

    path: Path
    cam_from_model: np.ndarray


@dataclass(frozen=True)
class Comparison:
    """A photograph, the synthetic view of its pose, and their likeness over the observed surface."""

    photograph: PosedPhotograph
    real: np.ndarray
    synthetic: RenderedView
    likeness: Likeness

    def picture(self) -> np.ndarray:
        """``(H, 3 W, 3)``: the photograph, the view over the dimmed photograph, their difference on the surface."""
        observed = self.synthetic.observed[..., None]
        over = np.where(observed, self.synthetic.rgb, 0.35 * self.real)
        difference = np.where(observed, np.abs(self.synthetic.rgb - self.real), 0)
        return np.concatenate([self.real, over, difference], axis=1)


def read_photographs(path: Path, loaded: LoadedCase) -> list[PosedPhotograph]:
    """Read a JSON list of ``{"image": file, "cam_from_model": 4x4}``, poses as in the case file.

    Raises
    ------
    InputError
        Missing, not such a list, or a pose that is not rigid.
    """
    try:
        entries = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"{path}: cannot read the list of photographs ({error.strerror})") from None
    except ValueError as error:
        raise InputError(f"{path.name}: expected JSON, found something else ({error})") from None
    if not isinstance(entries, list) or not all(isinstance(e, dict) and "image" in e for e in entries):
        raise InputError(f'{path.name}: expected a list of {{"image": ..., "cam_from_model": ...}}')
    photographs = []
    for number, entry in enumerate(entries):
        pose, _ = checked_rigid(entry.get("cam_from_model"), f"{path.name}: entry {number}: cam_from_model")
        pose[:3, 3] *= loaded.case.mm_per_unit
        photographs.append(PosedPhotograph(path.parent / entry["image"], pose @ loaded.given_from_model))
    return photographs


def compare(
    loaded: LoadedCase, photographs: list[PosedPhotograph], *, colour: str = "projective"
) -> Iterator[Comparison]:
    """Project the case's frame, render each photograph's pose through the same camera and compare.

    Raises
    ------
    InputError
        A photograph cannot be used or has another size than the frame, or shows nothing that the frame saw.
    """
    source = source_of(loaded)
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
            yield Comparison(photograph, real, view, likeness(real, view.rgb, view.observed))
