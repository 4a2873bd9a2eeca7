"""A grid of rays at a sphere: points on it, seen where they project to, and a pivot in the middle of what is seen."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from oneframe.camera.pinhole import PinholeCamera
from oneframe.projection.visible_surface import cast_grid, most_central
from oneframe.transforms import rigid, rotation_from_vector, transform_points

CAMERA = PinholeCamera(64, 48, 150.0, 148.0, 30.0, 25.0)
RADIUS = 20.0


def sphere(origin, direction):
    """First hit with a sphere round the model's origin."""
    origin, direction = np.array(origin), np.array(direction) / np.linalg.norm(direction)
    along = -origin @ direction
    inside = RADIUS**2 - origin @ origin + along**2
    if inside < 0:
        return None
    point = origin + (along - np.sqrt(inside)) * direction
    return point, point / RADIUS


poses = st.builds(
    lambda turn, place: rigid(rotation_from_vector(np.array(turn)), np.array(place)),
    st.tuples(*[st.floats(-3, 3)] * 3), st.tuples(st.floats(-30, 30), st.floats(-20, 20), st.floats(60, 300)),
)  # fmt: skip


@given(poses, st.integers(2, 24))
def test_rays_see_the_sphere_where_it_projects(pose, along):
    seen = cast_grid(sphere, CAMERA, pose, along=along)
    assert seen.rays == len(CAMERA.coarse_grid(along))
    assert seen.image_fraction == len(seen.points_model) / seen.rays == len(seen.normals_model) / seen.rays
    if len(seen.pixels) == 0:
        assert seen.pivot_model is None
        return
    np.testing.assert_allclose(np.linalg.norm(seen.points_model, axis=1), RADIUS, rtol=1e-9)
    np.testing.assert_allclose(CAMERA.project(transform_points(pose, seen.points_model)), seen.pixels, atol=1e-6)
    # the pivot is the seen point whose pixel is nearest to the middle
    offsets = np.linalg.norm(seen.pixels - seen.pixels.mean(axis=0), axis=1)
    (central,) = np.flatnonzero((seen.points_model == seen.pivot_model).all(axis=1))
    # of equally near ones, any
    assert offsets[central] == pytest.approx(offsets.min(), rel=1e-12)
    assert seen.radius_mm(seen.pivot_model) <= 2 * RADIUS


def test_a_ring_has_its_pivot_on_it_not_in_its_hole():
    angle = np.linspace(0, 6, 50)
    ring = np.stack([40 + 10 * np.cos(angle), 30 + 9 * np.sin(angle)], axis=1)
    assert np.linalg.norm(ring[most_central(*ring.T)] - ring.mean(axis=0)) == pytest.approx(9, abs=0.5)
