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
    rows = _area_weights(height_in, height) @ image.reshape(height_in, -1)
    columns = rows.reshape(height, width_in, -1).transpose(0, 2, 1) @ _area_weights(width_in, width).T
    return np.ascontiguousarray(columns.transpose(0, 2, 1), dtype=np.float32)


def _area_weights(size_in: int, size_out: int) -> np.ndarray:
    """``(size_out, size_in)`` weight of each input cell in each output cell; rows sum to 1."""
    edges = np.arange(size_out + 1) * size_in / size_out
    cells = np.arange(size_in)
    overlap = np.minimum(edges[1:, None], cells + 1) - np.maximum(edges[:-1, None], cells)
    return (np.clip(overlap, 0, None) * size_out / size_in).astype(np.float32)
