import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from oneframe.projection.rasteriser import barycentric, rasterise


def covered(triangles, **options):
    pieces = list(rasterise(np.asarray(triangles, float), **options))
    if not pieces:
        return np.zeros(0, int), np.zeros((0, 2), int), np.zeros((0, 3))
    triangle, x, y, weights = (np.concatenate(column) for column in zip(*pieces, strict=True))
    return triangle, np.stack([x, y], axis=1), weights


def triangulated_box(rng, low, high, cells, grid):
    """A box split in cells with moved corners, random diagonals and orientations; inner corners rounded to ``grid``."""
    columns, rows = cells
    u, v = np.meshgrid(np.arange(columns + 1.0), np.arange(rows + 1.0))
    inner_u, inner_v = (u > 0) & (u < columns), (v > 0) & (v < rows)
    moved_u, moved_v = (rng.uniform(-0.24, 0.24, u.shape) * inner for inner in (inner_u, inner_v))
    points = np.stack([u + moved_u, v + moved_v], axis=-1)
    points = low + points / [columns, rows] * (np.asarray(high) - low)
    if grid:
        inner = (inner_u & inner_v)[..., None]
        points = np.where(inner, np.round(points / grid) * grid, points)
    a, b, c, d = points[:-1, :-1], points[:-1, 1:], points[1:, 1:], points[1:, :-1]
    first = np.stack([a, b, c, a, c, d], axis=2).reshape(-1, 2, 3, 2)
    second = np.stack([a, b, d, b, c, d], axis=2).reshape(-1, 2, 3, 2)
    triangles = np.where(rng.random((len(first), 1, 1, 1)) < 0.5, first, second).reshape(-1, 3, 2)
    flip = rng.random(len(triangles)) < 0.5
    triangles[flip] = triangles[flip, ::-1]
    return np.stack(
        [np.roll(t, s, axis=0) for t, s in zip(triangles, rng.integers(3, size=len(triangles)), strict=True)]
    )


@given(
    seed=st.integers(0, 2**32),
    corner=st.tuples(st.integers(-400, 400), st.integers(-400, 400)),
    quarters=st.tuples(st.integers(4, 160), st.integers(4, 160)),
    cells=st.tuples(st.integers(1, 12), st.integers(1, 12)),
    grid=st.sampled_from([0, 0, 0.125, 1.0]),
    chunk=st.sampled_from([7, 300, 1 << 20]),
)
def test_triangulation_partitions_pixel_centres(seed, corner, quarters, cells, grid, chunk):
    low = np.array(corner) / 4
    high = low + np.array(quarters) / 4
    if grid:  # rounding must not fold cells over
        cells = tuple(int(max(1, min(n, size // (3 * grid)))) for n, size in zip(cells, high - low, strict=True))
    triangles = triangulated_box(np.random.default_rng(seed), low, high, cells, grid)
    _, pixels, _ = covered(triangles, chunk=chunk)
    # left and upper border belong to the box, right and lower do not
    first, end = np.ceil(low).astype(int), np.ceil(high).astype(int)
    expected = np.stack(np.meshgrid(*(np.arange(a, b) for a, b in zip(first, end, strict=True))), -1).reshape(-1, 2)
    assert sorted(map(tuple, pixels.tolist())) == sorted(map(tuple, expected.tolist()))


def chebyshev_distance(triangle, points):
    """Largest-coordinate distance from points to a triangle, from its definition: 0 inside, else the nearest edge."""
    best = np.full(len(points), np.inf)
    sides = []
    for a, b in zip(triangle, np.roll(triangle, -1, axis=0), strict=True):
        d, r = b - a, points - a
        sides.append(d[0] * r[:, 1] - d[1] * r[:, 0])
        with np.errstate(divide="ignore", invalid="ignore"):
            # max(|rx - t dx|, |ry - t dy|) is convex in t: its minimum is at an end or where two of the lines meet
            crossings = [np.zeros(len(r)), np.ones(len(r)), r[:, 0] / d[0], r[:, 1] / d[1]]
            crossings += [(r[:, 0] - r[:, 1]) / (d[0] - d[1]), (r[:, 0] + r[:, 1]) / (d[0] + d[1])]
        for t in crossings:
            t = np.clip(np.nan_to_num(t), 0, 1)[:, None]
            best = np.minimum(best, np.abs(r - t * d).max(axis=1))
    inside = (np.min(sides, axis=0) > 0) | (np.max(sides, axis=0) < 0)
    return np.where(inside, 0, best)


@given(seed=st.integers(0, 2**32), size=st.sampled_from([0.2, 3, 20]), margin=st.sampled_from([0.0, 0.5, 1.0, 2.3]))
def test_margin_is_a_square_round_the_triangle(seed, size, margin):
    rng = np.random.default_rng(seed)
    triangles = rng.uniform(-50, 50, (6, 1, 2)) + rng.normal(0, size, (6, 3, 2))
    triangle, pixels, weights = covered(triangles, margin=margin)
    reproduced = np.einsum("nk,nkd->nd", weights, triangles[triangle])
    np.testing.assert_allclose(reproduced, pixels, atol=1e-7)
    for index, corners in enumerate(triangles):
        first, end = np.floor(corners.min(axis=0)).astype(int) - 5, np.ceil(corners.max(axis=0)).astype(int) + 6
        x, y = np.meshgrid(np.arange(first[0], end[0]), np.arange(first[1], end[1]))
        found = np.zeros(x.shape, dtype=int)
        np.add.at(found, tuple((pixels[triangle == index] - first).T[::-1]), 1)
        distance = chebyshev_distance(corners, np.stack([x, y], -1).reshape(-1, 2)).reshape(x.shape)
        # corners are rounded to less than 1e-3 px, which may move pixels at the very border
        assert (found[distance < margin - 1e-3] == 1).all()
        assert (found[distance > margin + 1e-3] == 0).all()


def test_triangles_without_area():
    flat = np.array([[[1, 1], [4, 1], [2, 1]], [[3, 3], [3, 3], [3, 3]]], float)
    assert len(covered(flat)[0]) == 0
    triangle, _, weights = covered(flat, margin=1.0)
    assert np.isfinite(weights).all()
    assert np.bincount(triangle).tolist() == [6 * 3, 9]
    assert np.isfinite(barycentric(flat, np.zeros((2, 2)))).all()
    assert len(covered(np.zeros((0, 3, 2)))[0]) == 0
