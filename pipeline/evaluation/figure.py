"""The paper's figure: photographs, what they show of the surface, and views of the same poses below each other."""

from collections.abc import Collection, Sequence

import cv2
import numpy as np

from ..images.contact_sheet import contact_sheet
from ..images.pixel_values import mask_box, to_uint8
from ..images.png import encode_png
from .evaluate import ScoredView

MOST_COLUMNS = 6
TILE_WH = (320, 240)
CROP_MARGIN = 0.08
"""Around the surface, as a share of its extent."""


class Figure:
    """Collects the columns of the figure, one for each photograph, while views are scored."""

    def __init__(self, columns: Collection[tuple[str, int]]) -> None:
        """``columns`` are the photographs to show, by case and number."""
        self._tiles: dict[tuple[str, int], list[np.ndarray]] = {column: [] for column in columns}
        self._rows = ["real", "segmented"]

    @property
    def rows(self) -> Sequence[str]:
        """What each row shows, from the top."""
        return self._rows

    def add(self, view: ScoredView) -> None:
        """Add a view to its photograph's column, if that is shown."""
        tiles = self._tiles.get((view.case.name, view.shown.number))
        if tiles is None:
            return
        surface, images = view.shown.surface, [view.rendered]
        if not tiles:
            images = [view.shown.real, np.where(surface[..., None], view.shown.real, np.float32(0)), *images]
        tiles += [_tile(image, surface) for image in images]
        if view.method.name not in self._rows:
            self._rows.append(view.method.name)

    def png(self) -> bytes:
        """The figure as a PNG file."""
        columns = list(self._tiles.values())
        tiles = [column[row] for row in range(len(self._rows)) for column in columns]
        return encode_png(to_uint8(contact_sheet(tiles, columns=len(columns), tile_width=TILE_WH[0])))


def shown_columns(images: Sequence[tuple[str, int]]) -> list[tuple[str, int]]:
    """Which photographs ``(case, number)`` the figure shows: evenly spread, with both ends."""
    places = np.linspace(0, len(images) - 1, min(len(images), MOST_COLUMNS))
    return [images[round(place)] for place in places]


def _tile(image: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """``(H, W, 3)`` -> the part around an ``(H, W)`` bool mask in a tile's size; all of the image if it is empty."""
    height, width = mask.shape
    rows, columns = mask_box(mask) if mask.any() else (slice(0, height), slice(0, width))
    wide, tall = (each.stop - each.start for each in (columns, rows))
    # in the aspect of a tile
    half = (0.5 + CROP_MARGIN) * max(wide, tall * TILE_WH[0] / TILE_WH[1])
    middle = (columns.start + columns.stop - 1) / 2, (rows.start + rows.stop - 1) / 2
    scale = 2 * half / TILE_WH[0]
    image_from_tile = np.array(
        [[scale, 0, middle[0] - half + scale / 2], [0, scale, middle[1] - half * TILE_WH[1] / TILE_WH[0] + scale / 2]]
    )
    blurred = cv2.GaussianBlur(image, (0, 0), scale / 2) if scale > 1 else image
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    return cv2.warpAffine(blurred, image_from_tile, TILE_WH, flags=flags, borderMode=cv2.BORDER_CONSTANT)
