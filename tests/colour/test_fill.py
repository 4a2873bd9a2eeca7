"""The fill: the observed colours and nothing else, along the surface, smooth, always the same."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from oneframe.colour.fill import filled_colours


def tube(rows: int, around: int, low: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and faces of an open tube along z from ``low`` to ``low`` + 10, radius 1."""
    z, angle = np.meshgrid(np.linspace(low, low + 10, rows), np.arange(around) * 2 * np.pi / around, indexing="ij")
    index = np.arange(rows * around).reshape(rows, around)
    beside = np.roll(index, -1, axis=1)
    a, b, c, d = index[:-1].ravel(), beside[:-1].ravel(), beside[1:].ravel(), index[1:].ravel()
    faces = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    return np.stack([np.cos(angle), np.sin(angle), z], axis=-1).reshape(-1, 3), faces.astype(np.int32)


@given(seed=st.integers(0, 2**32 - 1), rows=st.integers(2, 40), around=st.integers(3, 20))
def test_known_colours_stay_and_the_others_are_within_their_range(seed, rows, around):
    rng = np.random.default_rng(seed)
    vertices, faces = tube(rows, around)
    rgb = rng.uniform(0, 1, (len(vertices), 3)).astype(np.float32)
    known = rng.uniform(size=len(vertices)) < rng.uniform(0.01, 0.9)
    known[rng.integers(len(known))] = True
    found = filled_colours(vertices, faces, rgb, known)
    assert found.dtype == np.float32
    assert np.array_equal(found[known], rgb[known])
    assert (found >= rgb[known].min(axis=0) - 1e-6).all()
    assert (found <= rgb[known].max(axis=0) + 1e-6).all()
    # what was at unknown vertices does not matter
    rgb[~known] = np.nan
    assert np.array_equal(filled_colours(vertices, faces, rgb, known), found)


def test_between_two_colours_the_fill_is_nearly_harmonic():
    """Along a tube with two coloured ends: linear."""
    vertices, faces = tube(101, 24)
    height = vertices[:, 2] / 10
    known = (height == 0) | (height == 1)
    found = filled_colours(vertices, faces, np.repeat(height[:, None], 3, axis=1).astype(np.float32), known)
    assert np.abs(found[:, 0] - height).max() < 0.12
    # and smooth: no neighbours differ by much more than a linear function's
    steps = np.abs(np.diff(found[:, 0].reshape(101, 24), axis=0))
    assert steps.max() < 0.04


def test_colours_travel_along_the_surface_and_not_through_space():
    """Two tubes, one in the other's shell at a hair's distance: only the first has colours."""
    vertices, faces = tube(40, 20)
    both = np.concatenate([vertices, vertices * [1.001, 1.001, 1]])
    joined = np.concatenate([faces, faces + len(vertices)])
    rng = np.random.default_rng(1)
    rgb = rng.uniform(0, 1, both.shape).astype(np.float32)
    known = np.arange(len(both)) < len(vertices) // 2
    found = filled_colours(both, joined, rgb, known)
    mean = np.broadcast_to(rgb[known].mean(axis=0), vertices.shape)
    np.testing.assert_allclose(found[len(vertices) :], mean, atol=1e-5)


def test_a_seam_of_doubled_vertices_is_no_border():
    vertices, faces = tube(40, 20)
    loose, loose_faces = vertices[faces].reshape(-1, 3), np.arange(faces.size, dtype=np.int32).reshape(-1, 3)
    rgb = np.clip(vertices * 0.3 + 0.4, 0, 1).astype(np.float32)
    known = vertices[:, 2] < 2
    whole = filled_colours(vertices, faces, rgb, known)
    apart = filled_colours(loose, loose_faces, rgb[faces].reshape(-1, 3), known[faces].ravel())
    np.testing.assert_allclose(apart, whole[faces].reshape(-1, 3), atol=1e-6)
