"""The initial pose shows the surface, whatever its place; with a focus, through the opening, with the head up."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from oneframe.camera.pinhole import PinholeCamera
from oneframe.projection.initial_pose import FILL, HEAD, initial_pose, opening_of
from oneframe.surface.mesh import Ball, TriangleMesh
from oneframe.transforms import nearest_rotation, transform_points
from tests.conftest import grid_mesh

CAMERAS = [PinholeCamera(1920, 1080, 12_800.0, 12_700.0, 930.0, 560.0), PinholeCamera(600, 900, 500.0, 510.0, 300, 440)]


def bone_with_cavity(direction: np.ndarray) -> TriangleMesh:
    """A closed ball of bone of 30 mm with a bowl of 10 mm that opens in a direction; triangles of about 1 mm."""
    v, u = np.mgrid[0 : np.pi : 97j, 0 : 2 * np.pi : 192j]
    unit = np.stack([np.sin(v) * np.cos(u), np.sin(v) * np.sin(u), np.cos(v)], -1)
    # distance from the centre to the bone's surface along each ray; where the bowl is, to its floor
    along = unit[..., 2] * 26
    depth = along**2 - (26**2 - 10**2)
    floor = along - np.sqrt(np.maximum(depth, 0))
    radius = np.where((depth > 0) & (unit[..., 2] > 0), np.minimum(30.0, floor), 30.0)
    points = unit * radius[..., None]
    other = np.eye(3)[np.argmin(np.abs(direction))]
    x = np.cross(other, direction) / np.linalg.norm(np.cross(other, direction))
    turn = np.stack([x, np.cross(direction, x), direction])
    return grid_mesh(*np.moveaxis(points @ turn, -1, 0)).flipped()


directions = st.integers(0, 2**32 - 1).map(
    lambda seed: nearest_rotation(np.random.default_rng(seed).normal(size=(3, 3)))[0]
)


@given(directions, st.sampled_from(CAMERAS), st.floats(0.3, 1.5))
def test_the_camera_looks_into_the_cavity_from_where_it_is_open(direction, camera, scale):
    mesh = bone_with_cavity(direction)
    focus = Ball(26 * direction, 10.0 * scale)
    opening = opening_of(mesh, focus)
    assert opening @ direction > np.cos(np.radians(2))
    pose = initial_pose(mesh, camera, focus)
    np.testing.assert_allclose(pose[:3, :3] @ pose[:3, :3].T, np.eye(3), atol=1e-12)
    assert np.linalg.det(pose[:3, :3]) == pytest.approx(1)
    assert -pose[2, :3] @ direction > np.cos(np.radians(2))
    # the focus is in the middle of the image, and its sphere spans the stated part of the shorter side
    (centre,) = transform_points(pose, focus.centre[None])
    np.testing.assert_allclose(camera.project(centre[None])[0], (np.array(camera.size_wh) - 1) / 2, atol=1e-6)
    half_angle = np.arcsin(focus.radius_mm / np.linalg.norm(centre))
    assert np.tan(half_angle) * min(camera.fx, camera.fy) == pytest.approx(FILL * min(camera.size_wh) / 2)
    if abs(opening @ HEAD) < 0.94:
        assert pose[1, :3] @ HEAD < -0.3
        assert pose[0, :3] @ HEAD == pytest.approx(0, abs=1e-12)


@pytest.mark.parametrize("camera", CAMERAS)
def test_without_a_focus_the_whole_surface_is_in_the_frame(bumpy_mesh, camera):
    pose = initial_pose(bumpy_mesh, camera)
    assert camera.contains(camera.project(transform_points(pose, bumpy_mesh.vertices))).all()
    assert (pose[:3, :3] @ bumpy_mesh.face_cross.sum(axis=0))[2] < 0
