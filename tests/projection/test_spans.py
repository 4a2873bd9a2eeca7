"""Spans of triangles: the pixels whose centres are inside, and in a region each once."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from oneframe.projection.spans import filled, spans_of

SIZE_WH = 23, 17


def pixels_of(triangles_px: np.ndarray) -> list[tuple[int, int, int]]:
    """(triangle, row, column) of the pixels that the spans fill."""
    spans = spans_of(triangles_px[..., 0].T, triangles_px[..., 1].T, SIZE_WH)
    found = []
    for span, offset, pixel in filled(spans, SIZE_WH[0]):
        row, column = np.divmod(pixel, SIZE_WH[0])
        assert (row == spans.row[span]).all()
        assert (column == spans.first[span] + offset).all()
        found += list(zip(spans.triangle[span].tolist(), row.tolist(), column.tolist(), strict=True))
    return found


def distance_to_edges(triangle_px: np.ndarray, point: np.ndarray) -> float:
    """Of a point to the nearest of three lines, px."""
    start, along = triangle_px, np.roll(triangle_px, -1, axis=0) - triangle_px
    away = point - start
    cross = along[:, 0] * away[:, 1] - along[:, 1] * away[:, 0]
    return float(np.min(np.abs(cross) / np.maximum(np.hypot(*along.T), 1e-12)))


@given(seed=st.integers(0, 2**32 - 1), whole=st.booleans())
def test_spans_fill_the_pixels_inside(seed, whole):
    """All but centres on an edge within rounding; whole numbers put corners and edges on centres."""
    rng = np.random.default_rng(seed)
    triangles = rng.uniform(-6, 28, (40, 3, 2))
    triangles = np.round(triangles) if whole else np.round(triangles * 64) / 64
    y, x = np.mgrid[: SIZE_WH[1], : SIZE_WH[0]]
    along = np.roll(triangles, -1, axis=1) - triangles
    away = np.stack([x, y], axis=-1)[None, ..., None, :] - triangles[:, None, None]
    sides = along[:, None, None, :, 0] * away[..., 1] - along[:, None, None, :, 1] * away[..., 0]
    inside = (sides > 0).all(axis=-1) | (sides < 0).all(axis=-1)
    expected = set(map(tuple, np.argwhere(inside).tolist()))
    found = pixels_of(triangles)
    assert len(set(found)) == len(found)
    for triangle, y, x in expected.symmetric_difference(found):
        assert distance_to_edges(triangles[triangle], np.array([x, y])) < 1e-9


@given(seed=st.integers(0, 2**32 - 1), whole=st.booleans())
def test_triangles_of_a_region_share_no_pixel_and_leave_none_out(seed, whole):
    """A fan around a point, which covers the image: every pixel exactly once, also those on its edges."""
    rng = np.random.default_rng(seed)
    angle = np.sort(np.append(rng.uniform(0, 2 * np.pi, 9), np.linspace(0, 2 * np.pi, 7)))
    rim, centre = 300 * np.stack([np.cos(angle), np.sin(angle)], axis=1), rng.uniform(0, 16, 2)
    if whole:
        rim, centre = np.round(rim), np.round(centre)
    fan = np.stack([np.broadcast_to(centre, rim.shape), rim, np.roll(rim, -1, axis=0)], axis=1)
    fan[::2] = fan[::2, ::-1]
    counted = np.zeros(SIZE_WH[::-1], int)
    for _, row, column in pixels_of(fan):
        counted[row, column] += 1
    assert (counted == 1).all()
