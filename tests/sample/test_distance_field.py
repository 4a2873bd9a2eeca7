"""Implicit solids: shapes, carving and their meshes against closed forms."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from oneframe.sample.distance_field import (
    ImplicitGrid,
    ball,
    subtract_burrs,
)

LOWER, UPPER = np.full(3, -2.0), np.full(3, 2.0)


@given(st.integers(0, 1000))
def test_burrs_agree_with_carving_the_whole_grid(seed):
    rng = np.random.default_rng(seed)
    # some of them outside of the block
    centres, radii = rng.uniform(-2.6, 2.6, (20, 3)), rng.uniform(0.05, 0.8, 20)
    drilled, whole = (ImplicitGrid(LOWER, UPPER, 0.1) for _ in range(2))
    subtract_burrs(drilled, centres, radii)
    for centre, radius in zip(centres, radii, strict=True):
        whole.carve(lambda x, y, z, c=centre, r=radius: ball(x, y, z, c, (r, r, r)))
    np.testing.assert_array_equal(drilled.values > 0, whole.values > 0)
    near = np.abs(whole.values) < 0.1
    np.testing.assert_allclose(drilled.values[near], whole.values[near], atol=1e-5)
