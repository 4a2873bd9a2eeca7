"""Rotations and twists: the exponential map against its series, one and many alike."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from pipeline.transforms import BLOCK, cross_matrices, rigid, rotation_from_vector, se3_exp, transform_points

VECTORS = hnp.arrays(np.float64, (3,), elements=st.floats(-4, 4) | st.floats(-1e-7, 1e-7))
MANY = hnp.arrays(
    np.float64, hnp.array_shapes(max_dims=2, max_side=4).map(lambda shape: (*shape, 3)), elements=st.floats(-4, 4)
)


def exponential(generator: np.ndarray) -> np.ndarray:
    """The matrix exponential by its power series."""
    total = term = np.eye(len(generator))
    for order in range(1, 80):
        term = term @ generator / order
        total = total + term
    return total


@given(VECTORS, VECTORS)
def test_cross_matrices_multiply_like_the_cross_product(a, b):
    np.testing.assert_allclose(cross_matrices(a) @ b, np.cross(a, b), atol=1e-14)


@given(VECTORS)
def test_rotations_are_the_exponential_of_their_cross_matrix(vector):
    np.testing.assert_allclose(rotation_from_vector(vector), exponential(cross_matrices(vector)), atol=1e-12)


@given(VECTORS, VECTORS)
def test_poses_are_the_exponential_of_their_twist(translation, vector):
    generator = np.zeros((4, 4))
    generator[:3, :3], generator[:3, 3] = cross_matrices(vector), translation
    np.testing.assert_allclose(se3_exp(np.concatenate([translation, vector])), exponential(generator), atol=1e-11)


@settings(deadline=None)
@given(MANY)
def test_many_rotations_are_those_of_each_vector_to_the_last_bit(vectors):
    """So that a figure does not depend on how many rotations are made at once."""
    rotations = rotation_from_vector(vectors)
    assert rotations.shape == (*vectors.shape, 3)
    for index in np.ndindex(vectors.shape[:-1]):
        assert np.array_equal(rotations[index], rotation_from_vector(vectors[index]))


def test_points_are_transformed_alike_one_by_one_and_in_blocks(rng):
    b_from_a = rigid(rotation_from_vector(rng.normal(size=3)), rng.normal(size=3) * 100)
    points = rng.normal(size=(2 * BLOCK + 5, 3)) * 50
    expected = np.array([b_from_a[:3, :3] @ point + b_from_a[:3, 3] for point in points])
    np.testing.assert_allclose(transform_points(b_from_a, points), expected, rtol=0, atol=1e-12)
    assert np.array_equal(transform_points(b_from_a, points)[BLOCK:], transform_points(b_from_a, points[BLOCK:]))
