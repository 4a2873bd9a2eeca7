"""A contact sheet: many small views in one picture, for a first look at a dataset."""

from collections.abc import Sequence

import numpy as np

GAP_PX = 4
BACKGROUND = 1.0


def contact_sheet(images: Sequence[np.ndarray], *, columns: int, tile_width: int) -> np.ndarray:
    """Lay ``(H, W, 3)`` images of one size (values 0..1) out in rows -> ``(h, w, 3)``."""
    tiles = [downscaled(image, tile_width) for image in images]
    tile_height, tile_width = tiles[0].shape[:2]
    rows = -(-len(tiles) // columns)
    pitch = np.array([tile_height, tile_width]) + GAP_PX
    sheet = np.full((rows * pitch[0] + GAP_PX, columns * pitch[1] + GAP_PX, 3), BACKGROUND, np.float32)
    for number, tile in enumerate(tiles):
        top, left = np.array(divmod(number, columns)) * pitch + GAP_PX
        sheet[top : top + tile_height, left : left + tile_width] = tile
    return sheet


def downscaled(image: np.ndarray, width: int) -> np.ndarray:
    """Resize to a width by averaging over areas (exact for any ratio); a smaller image stays as it is."""
    height_in, width_in = image.shape[:2]
    if width >= width_in:
        return image
    height = max(1, round(height_in * width / width_in))
    rows = _area_means(image, height)
    return np.ascontiguousarray(_area_means(rows.swapaxes(0, 1), width).swapaxes(0, 1))


def _area_means(values: np.ndarray, count: int) -> np.ndarray:
    """Means of ``(N, M, C)`` over ``count`` equal parts of the first axis -> ``(count, M, C)`` float32."""
    # the sum before a place inside a value's cell is linear in it
    edges = np.arange(count + 1) * len(values) / count
    cells = np.minimum(edges.astype(np.int64), len(values) - 1)
    sums = np.cumsum(values, axis=0, dtype=np.float64)[cells]
    sums += (edges - cells - 1)[:, None, None] * values[cells]
    return (np.diff(sums, axis=0) * count / len(values)).astype(np.float32)
