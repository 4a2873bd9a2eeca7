"""Synthetic views compared with real photographs of the same poses: how good the projection of one frame is.

As files: a table of similarities, a picture of each pair, a sheet of all pairs.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...case.loaded_case import LoadedCase
from ...case.posed_frame import UnreadFrame
from ...colour.ray_tracer import best_traced
from ...errors import InputError
from ...evaluation.scores.similarity import Similarity, similarity
from ...files.content import write_bytes_atomically
from ...files.outputs import check_outputs, check_own_folder, made_folder, writing
from ...files.tables import write_csv
from ...images.contact_sheet import contact_sheet
from ...images.pixel_values import to_uint8
from ...images.png import encode_png
from ...projection.rendered_view import RenderedView
from ..case.load_case import load_posed_frame
from ..colour.reference_view import colours_of, reference_view_of

TABLE, SHEET = "likeness.csv", "sheet.png"
COLUMNS = ("image", "picture", "ssim", "mean_error_of_255", "correlation", "pixels")
_NAMES = rf"photograph_\d+\.png|{re.escape(TABLE)}|{re.escape(SHEET)}"
TILE_WIDTH = 900
"""Width of a picture in the sheet, px."""


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
    source = reference_view_of(loaded, "raster")
    render = best_traced(source.mesh, loaded.frame.camera, colours_of(source, colour)[0], rays=source.rays)
    overlapping = False
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


def check_comparisons(out: Path, photographs: Sequence[UnreadFrame], inputs: Mapping[str, Path]) -> None:
    """Check before any work that the files of a comparison can be written.

    Parameters
    ----------
    out, photographs
        As for :func:`write_comparisons`.
    inputs
        Files that must not be replaced, by what they are; the photographs are added.

    Raises
    ------
    InputError
        The folder holds something else, or a file must not be replaced.
    RunError
        The files cannot be written.
    """
    shown = {f"photograph {number}": photograph.image for number, photograph in enumerate(photographs, start=1)}
    check_own_folder(out, _NAMES)
    check_outputs([out / name for name in (*_picture_names(photographs), SHEET, TABLE)], {**inputs, **shown})


def write_comparisons(
    loaded: LoadedCase, photographs: Sequence[UnreadFrame], out: Path, *, colour: str
) -> Iterator[Comparison]:
    """Compare (see :func:`.compare`) and write the results.

    Parameters
    ----------
    loaded
        The case.
    photographs
        The photographs to compare views with.
    out
        Folder, created if it does not exist; the files of an earlier comparison are replaced.
    colour
        How the frame colours the surface: one of :data:`.COLOURS`.

    Yields
    ------
    Each comparison once its picture is on disk; the table and the sheet follow the last one. A photograph that shows
    nothing that the frame saw has empty similarities in the table.

    Raises
    ------
    InputError
        As :func:`.compare` and :func:`check_comparisons`.
    RunError
        A file cannot be written.
    """
    check_comparisons(out, photographs, loaded.case.input_files())
    comparisons, pictures = [], []
    names = _picture_names(photographs)
    for name, comparison in zip(names, compare(loaded, list(photographs), colour=colour), strict=True):
        comparisons.append(comparison)
        pictures.append(comparison.picture())
        _write_picture(out / name, pictures[-1])
        yield comparison
    with writing(out / TABLE):
        write_csv(out / TABLE, COLUMNS, map(_row, names, comparisons))
    _write_picture(out / SHEET, contact_sheet(pictures, columns=2, tile_width=TILE_WIDTH))


def _picture_names(photographs: Sequence[UnreadFrame]) -> list[str]:
    # not those of the files, which may name the patient
    return [f"photograph_{number}.png" for number in range(1, len(photographs) + 1)]


def _write_picture(path: Path, picture: np.ndarray) -> None:
    data = encode_png(to_uint8(picture))
    with writing(made_folder(path)):
        write_bytes_atomically(path, data)


def _row(picture: str, comparison: Comparison) -> tuple[object, ...]:
    found, names = comparison.similarity, (Path(picture).stem, picture)
    if found is None:
        return (*names, "", "", "", 0)
    return (
        *names,
        f"{found.ssim:.4f}",
        f"{found.mean_error:.2f}",
        f"{found.correlation:.4f}",
        found.pixels,
    )
