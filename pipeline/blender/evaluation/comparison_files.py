"""A comparison with photographs as files: a table of similarities, a picture of each pair, a sheet of all pairs."""

from collections.abc import Iterator, Sequence
from pathlib import Path

from ...case.loaded_case import LoadedCase
from ...evaluation.photographs import PosedPhotograph
from ...files.content import write_bytes_atomically
from ...files.tables import write_csv
from ...images.contact_sheet import contact_sheet
from ...images.pixel_values import to_uint8
from ...images.png import encode_png
from .comparison import Comparison, compare

TABLE, SHEET = "likeness.csv", "sheet.png"
COLUMNS = ("image", "ssim", "mean_error_of_255", "correlation", "pixels")
TILE_WIDTH = 900
"""Width of a picture in the sheet, px."""


def write_comparisons(
    loaded: LoadedCase, photographs: Sequence[PosedPhotograph], out: Path, *, colour: str
) -> Iterator[Comparison]:
    """Compare (see :func:`.compare`) and write the results.

    Parameters
    ----------
    loaded
        The case.
    photographs
        The photographs to compare views with.
    out
        Folder, created if it does not exist; files of the same names are replaced.
    colour
        How the frame colours the surface: one of :data:`.COLOURS`.

    Yields
    ------
    Each comparison once its picture is on disk; the table and the sheet follow the last one.

    Raises
    ------
    InputError
        As :func:`.compare`.
    """
    out.mkdir(parents=True, exist_ok=True)
    comparisons, pictures = [], []
    for comparison in compare(loaded, list(photographs), colour=colour):
        comparisons.append(comparison)
        pictures.append(comparison.picture())
        name = f"{comparison.photograph.path.stem}.png"
        write_bytes_atomically(out / name, encode_png(to_uint8(pictures[-1])))
        yield comparison
    write_csv(out / TABLE, COLUMNS, map(_row, comparisons))
    sheet = contact_sheet(pictures, columns=2, tile_width=TILE_WIDTH)
    write_bytes_atomically(out / SHEET, encode_png(to_uint8(sheet)))


def _row(comparison: Comparison) -> tuple[object, ...]:
    found, name = comparison.similarity, comparison.photograph.path.name
    return name, f"{found.ssim:.4f}", f"{found.mean_error:.2f}", f"{found.correlation:.4f}", found.pixels
