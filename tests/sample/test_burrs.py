"""Burrs remove exactly their balls, in any order, and change the field only near them."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from oneframe.sample.distance_field import ImplicitGrid, ball, largest_component, subtract_burrs

LOWER, UPPER = np.full(3, -2.0), np.full(3, 2.0)
SPACING = 0.1


def block() -> ImplicitGrid:
    return ImplicitGrid(LOWER, UPPER, SPACING)


def some_burrs(seed: int, count: int = 20) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    # some of them outside of the block
    return rng.uniform(-2.6, 2.6, (count, 3)), rng.uniform(0.05, 0.8, count)


def test_one_burr_leaves_a_cavity_of_its_volume_that_faces_inward():
    grid = block()
    subtract_burrs(grid, np.zeros((1, 3)), np.array([1.0]))
    mesh = largest_component(*grid.surface())
    volume = np.einsum("ij,ij->", mesh.vertices[mesh.faces[:, 0]], mesh.face_cross) / 6
    assert volume == pytest.approx(-4 / 3 * np.pi, rel=0.01)


@given(st.integers(0, 1000))
def test_burrs_agree_with_carving_the_whole_grid(seed):
    centres, radii = some_burrs(seed)
    drilled, whole = block(), block()
    subtract_burrs(drilled, centres, radii)
    for centre, radius in zip(centres, radii, strict=True):
        whole.carve(lambda x, y, z, c=centre, r=radius: ball(x, y, z, c, (r, r, r)))
    np.testing.assert_array_equal(drilled.values > 0, whole.values > 0)
    near = np.abs(whole.values) < SPACING
    np.testing.assert_allclose(drilled.values[near], whole.values[near], atol=1e-5)


@given(st.integers(0, 1000))
def test_drilling_only_removes_and_order_and_repetition_do_not_matter(seed):
    centres, radii = some_burrs(seed)
    once, again = block(), block()
    before = once.values.copy()
    subtract_burrs(once, centres, radii)
    assert (once.values <= before).all()
    shuffled = np.random.default_rng(seed).permutation(np.tile(np.arange(len(radii)), 2))
    subtract_burrs(again, centres[shuffled], radii[shuffled])
    np.testing.assert_array_equal(once.values, again.values)
