"""Rotations and twists: the exponential map against its series, one and many alike."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from oneframe.errors import InputError
from oneframe.transforms import (
    BLOCK,
    NOTED_DEVIATION,
    ORTHONORMAL_TO_ROUNDING,
    ORTHONORMAL_TOLERANCE,
    checked_rigid,
    cross_matrices,
    rigid,
    rotation_from_vector,
    se3_exp,
    transform_points,
)

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


@given(VECTORS)
def test_rotations_are_the_exponential_of_their_cross_matrix(vector):
    np.testing.assert_allclose(rotation_from_vector(vector), exponential(cross_matrices(vector)), atol=1e-12)


@given(VECTORS, VECTORS)
def test_poses_are_the_exponential_of_their_twist(translation, vector):
    generator = np.zeros((4, 4))
    generator[:3, :3], generator[:3, 3] = cross_matrices(vector), translation
    np.testing.assert_allclose(se3_exp(np.concatenate([translation, vector])), exponential(generator), atol=1e-11)


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


@given(VECTORS, st.integers(0, 2), st.floats(-1, 1), st.sampled_from([0.0096, ORTHONORMAL_TOLERANCE, NOTED_DEVIATION]))
def test_rotations_become_the_nearest_up_to_a_limit_or_are_refused(vector, axis, shear, limit):
    """Both sides of both limits: a published pose off by 0.0096 is taken, one off by more than 0.01 is not."""
    rotation = rotation_from_vector(vector)
    change = np.zeros((3, 3))
    change[axis, axis], change[axis, axis - 1] = 1.0, shear
    change += change.T
    # R Rt = 1 + 2 e C + e^2 C^2 for R = (1 + e C) Q
    for fraction in (0.98, 1.03):
        size = fraction * limit / (2 * np.abs(change).max())
        given_pose = rigid((np.eye(3) + size * change) @ rotation, np.array([1.0, 2.0, 300.0]))
        if limit == ORTHONORMAL_TOLERANCE and fraction > 1:
            with pytest.raises(InputError, match=r"^here: .*deviates from orthonormal by 0\.01.*\(allowed 0\.01\)"):
                checked_rigid(given_pose, "here")
            continue
        pose, message = checked_rigid(given_pose, "here")
        assert (message is None) == (limit == NOTED_DEVIATION and fraction < 1)
        assert message is None or message.startswith("here: rotation off by ")
        # a symmetric positive factor: its polar decomposition has the rotation as the nearest one
        np.testing.assert_allclose(pose[:3, :3], rotation, atol=1e-12)
        again, message = checked_rigid(pose, "here")
        assert message is None
        if np.abs(pose[:3, :3] @ pose[:3, :3].T - np.eye(3)).max() <= ORTHONORMAL_TO_ROUNDING:
            assert np.array_equal(again, pose)
