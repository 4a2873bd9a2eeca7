"""A step has the stated size in pixels, keeps the pivot in place where it should, and can be undone."""

from typing import get_args

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from oneframe.alignment.manual.nudge import Axis, nudged
from oneframe.camera.pinhole import PinholeCamera
from oneframe.transforms import nearest_rotation, rigid, transform_points

CAMERAS = [PinholeCamera(1920, 1080, 12_800.0, 12_700.0, 930.0, 560.0), PinholeCamera(900, 700, 500.0, 510.0, 440, 360)]
PIVOT, RADIUS = np.array([4.0, -7.0, 3.0]), 12.0

cameras, steps = st.sampled_from(CAMERAS), st.sampled_from([10.0, -10.0, 1.0, -0.1, 0.1, 35.0])


@st.composite
def poses(draw):
    """The pivot anywhere in view, at 40 to 300 mm."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    rotation, depth = nearest_rotation(rng.normal(size=(3, 3))), rng.uniform(40, 300)
    return rigid(rotation, [*(rng.uniform(-0.05, 0.05, 2) * depth), depth] - rotation @ PIVOT)


def rim_shift(camera, pose, moved, offset_cam):
    """Pixels before and after of the point at an offset from the pivot along the axes of the camera."""
    point = PIVOT + pose[:3, :3].T @ offset_cam
    return tuple(camera.project(transform_points(each, point[None]))[0] for each in (pose, moved))


def pivot_pixel(camera, pose):
    return camera.project(transform_points(pose, PIVOT[None]))[0]


@given(poses(), cameras, st.sampled_from(get_args(Axis)), steps)
def test_a_step_back_returns(pose, camera, axis, step):
    rim_px = camera.fx * RADIUS / transform_points(pose, PIVOT)[2]
    assume(axis != "depth" or step <= rim_px / 2)  # longer steps away from the camera are shortened
    moved = nudged(pose, camera, PIVOT, axis, step, RADIUS)
    assert nudged(moved, camera, PIVOT, axis, -step, RADIUS) == pytest.approx(pose, abs=1e-10)
    assert moved[:3, :3] @ moved[:3, :3].T == pytest.approx(np.eye(3), abs=1e-12)


@given(poses(), cameras, st.sampled_from([("x", (1, 0)), ("y", (0, 1))]), steps)
def test_a_shift_moves_the_pivot_by_the_step(pose, camera, axis, step):
    name, direction = axis
    moved = nudged(pose, camera, PIVOT, name, step, RADIUS)
    assert pivot_pixel(camera, moved) - pivot_pixel(camera, pose) == pytest.approx(step * np.array(direction), abs=1e-8)
    assert np.array_equal(moved[:3, :3], pose[:3, :3])
    assert moved[2, 3] == pose[2, 3]


@given(poses(), cameras, st.sampled_from(["depth", "pitch", "yaw", "roll"]), steps)
def test_other_steps_keep_the_pixel_of_the_pivot(pose, camera, axis, step):
    moved = nudged(pose, camera, PIVOT, axis, step, RADIUS)
    assert pivot_pixel(camera, moved) == pytest.approx(pivot_pixel(camera, pose), abs=1e-8)
    moves = transform_points(moved, PIVOT[None]) - transform_points(pose, PIVOT[None])
    if axis == "depth":
        assert np.array_equal(moved[:3, :3], pose[:3, :3])
        assert np.sign(moves[0, 2]) == np.sign(step)
    else:
        assert moves == pytest.approx(np.zeros((1, 3)), abs=1e-10)


@given(poses(), cameras, st.sampled_from([10.0, -10.0, 1.0, -0.1]))
def test_a_step_in_depth_moves_the_rim_by_the_step(pose, camera, step):
    moved = nudged(pose, camera, PIVOT, "depth", step, RADIUS)
    before, after = rim_shift(camera, pose, moved, [RADIUS, 0, 0])
    assert after - before == pytest.approx([-step, 0], abs=1e-8)


@given(poses(), cameras, steps)
def test_a_roll_moves_the_rim_along_itself_by_the_step(pose, camera, step):
    moved = nudged(pose, camera, PIVOT, "roll", step, RADIUS)
    before, after = rim_shift(camera, pose, moved, [RADIUS, 0, 0])
    centre = pivot_pixel(camera, pose)
    before, after = (before - centre) / camera.fx, (after - centre) / [camera.fx, camera.fy]
    angle = np.arctan2(after[1], after[0])
    assert angle * np.linalg.norm(before) * camera.fx == pytest.approx(step, rel=1e-6)


@given(poses(), cameras, st.sampled_from([("pitch", 1, 1), ("yaw", 0, -1)]), st.sampled_from([0.1, -0.1, 1.0]))
def test_a_pitch_or_yaw_moves_points_in_front_of_the_pivot_by_the_step(pose, camera, axis, step):
    """To first order; perspective enlarges the shift of a point nearer than the pivot."""
    name, coordinate, sign = axis
    moved = nudged(pose, camera, PIVOT, name, step, RADIUS)
    before, after = rim_shift(camera, pose, moved, [0, 0, -RADIUS])
    depth = transform_points(pose, PIVOT[None])[0, 2]
    focal = (camera.fx, camera.fy)[coordinate] / camera.fx
    expected = sign * step * focal * depth / (depth - RADIUS)
    assert (after - before)[coordinate] == pytest.approx(expected, rel=0.02)
    assert abs((after - before)[1 - coordinate]) < 0.05 * abs(step)


def test_no_step_leads_through_the_camera_or_to_infinity():
    pose = rigid(translation=[0, 0, 100.0])
    for step in (-1e6, 1e6):
        depth = transform_points(nudged(pose, CAMERAS[0], PIVOT, "depth", step, RADIUS), PIVOT)[2]
        assert 0 < depth <= 2 * transform_points(pose, PIVOT)[2] + 1e-9
