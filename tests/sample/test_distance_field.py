"""Implicit solids: shapes, carving and their meshes against closed forms."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from oneframe.sample.distance_field import (
    ImplicitGrid,
    ball,
    largest_component,
    subtract_burrs,
    tube,
)
from tests.volume.solids import enclosed_mm3, is_closed

LOWER, UPPER = np.full(3, -2.0), np.full(3, 2.0)


def test_filled_ball_has_volume_of_ball_and_faces_outward():
    grid = ImplicitGrid(LOWER, UPPER, 0.1, solid=False)
    grid.fill(lambda x, y, z: ball(x, y, z, (0.1, -0.2, 0.3), (1.2, 1.2, 1.2)))
    mesh = largest_component(*grid.surface())
    assert is_closed(mesh)
    assert enclosed_mm3(mesh) == pytest.approx(4 / 3 * np.pi * 1.2**3, rel=0.01)
    np.testing.assert_allclose(np.linalg.norm(mesh.vertices - [0.1, -0.2, 0.3], axis=1), 1.2, atol=0.005)


def test_tube_is_closed_and_has_the_volume_of_its_cylinder():
    mesh = tube(np.linspace([0, 0, 0], [30, 4, 0], 6), 0.5, sides=64)
    assert is_closed(mesh)
    caps = 2 * np.pi * 0.5**2 * 0.25 / 3
    assert enclosed_mm3(mesh) == pytest.approx(np.pi * 0.5**2 * np.hypot(30, 4) + caps, rel=0.005)


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
