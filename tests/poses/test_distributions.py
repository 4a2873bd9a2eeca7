"""The distributions obey their laws: tilt, roll, distance and shift of drawn poses are distributed as stated.

Poses are taken apart with formulas of this file, not with those that made them. Laws are Kolmogorov-Smirnov tests at
the 1e-6 level on the first frames of a fixed seed.
"""

from dataclasses import replace
from functools import cache
from math import erf

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from oneframe.camera.pinhole import PinholeCamera
from oneframe.errors import InputError
from oneframe.poses.distributions import Cone, Gaussian, ReferencePose, Shell, Trajectory
from oneframe.transforms import camera_centre, rigid, rotation_from_vector

COUNT = 3000
KS_BOUND = np.sqrt(np.log(2 / 1e-6) / (2 * COUNT))
CORRELATION_BOUND = 5 / np.sqrt(COUNT)

PIVOT = np.array([4.0, -7.0, 3.0])
PIVOT_CAM = np.array([60.0, -35.0, 240.0])  # off the optical axis, so that a turn about the wrong ray shows
DISTANCE = float(np.linalg.norm(PIVOT_CAM))
RAY = PIVOT_CAM / DISTANCE
ROTATION = rotation_from_vector(np.array([0.7, -1.9, 0.8]))
REFERENCE = ReferencePose(rigid(ROTATION, PIVOT_CAM - ROTATION @ PIVOT), PIVOT)
CAMERA = PinholeCamera(1280, 960, 2900.0, 2750.0, 600.0, 510.0)
AXIS = np.array([0.0, 0.0, 1.0])

DISTRIBUTIONS = {
    "cone": Cone(reference=REFERENCE, cone_deg=35, roll_deg=50, distance_min=0.7, distance_max=1.6, shift_mm=12),
    "gaussian": Gaussian(reference=REFERENCE, sigma_deg=9, sigma_mm=4),
    "shell": Shell(reference=REFERENCE, distance_min=1, distance_max=2),
    "cap": Shell(reference=REFERENCE, distance_min=0.5, distance_max=0.8, polar_deg=70, roll_deg=20),
}
TRAJECTORY = Trajectory(reference=REFERENCE, cone_deg=25, roll_deg=10, distance_min=0.8, distance_max=1.1)


def frame_pose(distribution, seed, index):
    return distribution.draw(np.random.default_rng([seed, index]))


@cache
def drawn(name):
    return np.stack([frame_pose(DISTRIBUTIONS[name], 5, index) for index in range(COUNT)])


def ks_distance(values, distribution_function):
    """Largest distance between the empirical and the stated distribution function."""
    expected = distribution_function(np.sort(values))
    steps = np.arange(len(values) + 1) / len(values)
    return max((steps[1:] - expected).max(), (expected - steps[:-1]).max())


def uniform(lower, upper):
    return lambda values: np.clip((values - lower) / (upper - lower), 0, 1)


def half_turn(axis):
    axis = axis / np.linalg.norm(axis, axis=-1, keepdims=True)
    return 2 * axis[..., :, None] * axis[..., None, :] - np.eye(3)


def swing(start, end):
    """The rotation between two unit vectors without twist, as two half turns."""
    return half_turn(start + end) @ half_turn(start)


def parts(poses, look=RAY):
    """Take apart poses that have the pivot on the unit ray ``look``: radians, mm, factors of the distance."""
    turn = poses[:, :3, :3] @ ROTATION.T
    towards = np.swapaxes(turn, 1, 2) @ look  # where the ray points in the reference's axes
    in_ray_axes = towards @ swing(AXIS, RAY)
    twist = turn @ np.swapaxes(swing(RAY, look) @ swing(towards, RAY), 1, 2)
    skew = twist - np.swapaxes(twist, 1, 2)
    sine = np.stack([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]], axis=1) @ look / 2
    pivot = poses[:, :3, :3] @ PIVOT + poses[:, :3, 3]
    depth_ratio = pivot[:, 2] / look[2]
    shift = pivot[:, :2] - depth_ratio[:, None] * look[:2]
    radius = np.linalg.norm(camera_centre(poses) - PIVOT, axis=1) / DISTANCE
    return {
        "cos_tilt": in_ray_axes[:, 2],
        "azimuth": np.arctan2(in_ray_axes[:, 1], in_ray_axes[:, 0]),
        "roll": np.arctan2(sine, (np.trace(twist, axis1=1, axis2=2) - 1) / 2),
        "factor": depth_ratio / DISTANCE,
        "shift_squared": (shift**2).sum(axis=1),
        "shift_direction": np.arctan2(shift[:, 1], shift[:, 0]),
        "radius_cubed": radius**3,
    }


COS_35, COS_70 = np.cos(np.radians([35, 70]))
ROLL_50, ROLL_20 = np.radians([50, 20])
TURN = uniform(-np.pi, np.pi)
LAWS = [
    # distribution, ray of the pivot in the image, value of the parts, its law
    ("cone", RAY, "cos_tilt", uniform(COS_35, 1)),
    ("cone", RAY, "azimuth", TURN),
    ("cone", RAY, "roll", uniform(-ROLL_50, ROLL_50)),
    ("cone", RAY, "factor", uniform(0.7, 1.6)),
    ("cone", RAY, "shift_squared", uniform(0, 144)),
    ("cone", RAY, "shift_direction", TURN),
    ("shell", AXIS, "radius_cubed", uniform(1, 8)),
    ("shell", AXIS, "cos_tilt", uniform(-1, 1)),
    ("shell", AXIS, "azimuth", TURN),
    ("shell", AXIS, "roll", TURN),
    ("cap", AXIS, "radius_cubed", uniform(0.125, 0.512)),
    ("cap", AXIS, "cos_tilt", uniform(COS_70, 1)),
    ("cap", AXIS, "roll", uniform(-ROLL_20, ROLL_20)),
]


@pytest.mark.parametrize(("name", "ray", "part", "law"), LAWS)
def test_law(name, ray, part, law):
    assert ks_distance(parts(drawn(name), ray)[part], law) < KS_BOUND


def test_parts_are_independent_of_one_another():
    for name, ray in (("cone", RAY), ("shell", AXIS)):
        taken = parts(drawn(name), ray)
        keys = ["cos_tilt", "azimuth", "roll", "factor"] + ["shift_squared", "shift_direction"] * (name == "cone")
        correlation = np.corrcoef([taken[key] for key in keys])
        assert np.abs(correlation - np.eye(len(keys))).max() < CORRELATION_BOUND


def test_more_shift_leaves_the_rest_of_a_dataset_alone():
    still = replace(DISTRIBUTIONS["cone"], shift_mm=0)
    for index in range(20):
        assert np.array_equal(frame_pose(still, 5, index)[:3, :3], drawn("cone")[index, :3, :3])


# --- Gaussian -----------------------------------------------------------------------------------------------------


def log_at_pivot(poses):
    """``(N, 6)`` twists (mm, degrees) of poses relative to the reference, by the closed form of the logarithm."""
    to_pivot = rigid(translation=-PIVOT)
    motion = to_pivot @ np.linalg.inv(REFERENCE.cam_from_model) @ poses @ np.linalg.inv(to_pivot)
    rotation = motion[:, :3, :3]
    angle = np.arccos((np.trace(rotation, axis1=1, axis2=2) - 1) / 2)[:, None, None]
    cross = angle / (2 * np.sin(angle)) * (rotation - np.swapaxes(rotation, 1, 2))
    inverse_jacobian = (
        np.eye(3) - cross / 2 + (1 / angle**2 - (1 + np.cos(angle)) / (2 * angle * np.sin(angle))) * cross @ cross
    )
    upsilon = (inverse_jacobian @ motion[:, :3, 3, None])[..., 0]
    return np.hstack([upsilon, np.degrees(np.stack([cross[:, 2, 1], cross[:, 0, 2], cross[:, 1, 0]], axis=1))])


def test_gaussian_twists_are_standard_normal():
    standard = log_at_pivot(drawn("gaussian")) / [4, 4, 4, 9, 9, 9]
    covariance = standard.T @ standard / COUNT
    assert np.abs(standard.mean(0)).max() < CORRELATION_BOUND
    assert np.abs(covariance - np.eye(6)).max() < np.sqrt(2) * CORRELATION_BOUND
    normal = np.vectorize(lambda x: 0.5 * (1 + erf(x / np.sqrt(2))))
    assert ks_distance(standard.ravel(), normal) < KS_BOUND / np.sqrt(6)
    box = np.random.default_rng(1).uniform(-np.sqrt(3), np.sqrt(3), standard.size)  # the same covariance
    assert ks_distance(box, normal) > 2 * KS_BOUND / np.sqrt(6)


def test_draws_are_the_same_for_every_version_of_numpy():
    expected = {
        "cone": [45.389586935, -33.635438794, 210.258741231],
        "gaussian": [59.461846944, -25.70879979, 235.5194635],
        "shell": [-7.341491955, -2.954031747, 339.8969113],
    }
    for name, translation in expected.items():
        assert np.allclose(frame_pose(DISTRIBUTIONS[name], 20, 7)[:3, 3], translation, rtol=0, atol=1e-6), name


# --- trajectory ---------------------------------------------------------------------------------------------------


def second_difference(path, count):
    """Largest second difference over the squared step all round the closed path, seam included."""
    poses = np.stack([path(index / count) for index in range(count)])
    return np.abs(np.roll(poses, 1, axis=0) - 2 * poses + np.roll(poses, -1, axis=0)).max() * count**2


def test_trajectory_is_closed_smooth_and_starts_at_the_reference():
    assert np.allclose(TRAJECTORY.pose_at(0), REFERENCE.cam_from_model, rtol=0, atol=1e-12)
    assert np.array_equal(TRAJECTORY.pose_at(1), TRAJECTORY.pose_at(0))
    assert np.allclose(TRAJECTORY.pose_at(1 - 1e-9), TRAJECTORY.pose_at(0), rtol=0, atol=1e-5)
    # the second derivative is bounded, thus the first is continuous; with a kink it grows like the number of steps
    assert second_difference(TRAJECTORY.pose_at, 1600) < 1.1 * second_difference(TRAJECTORY.pose_at, 400)


def test_trajectory_reaches_and_keeps_its_limits_without_jumps():
    poses = TRAJECTORY.poses(600)
    taken = parts(poses)
    tilt = np.degrees(np.arccos(np.clip(taken["cos_tilt"], -1, 1)))
    assert 24.9 < tilt.max() < 25 + 1e-6
    assert 9.9 < np.degrees(taken["roll"]).max() < 10 + 1e-9
    assert 0.8 - 1e-12 < taken["factor"].min() < 0.801
    assert 1.099 < taken["factor"].max() < 1.1 + 1e-12
    assert taken["shift_squared"].max() < 1e-18
    step = np.swapaxes(poses[:, :3, :3], 1, 2) @ np.roll(poses, -1, axis=0)[:, :3, :3]
    angle = np.degrees(np.arccos((np.trace(step, axis1=1, axis2=2) - 1) / 2))
    assert angle.max() < 2 * angle.mean()
    assert np.array_equal(frame_pose(TRAJECTORY, 0, 9), TRAJECTORY.pose_at(np.random.default_rng([0, 9]).random()))


# --- exact transforms and limits, whatever the parameters ---------------------------------------------------------

degrees = st.floats(0, 180)
factors = st.tuples(st.floats(0.05, 5), st.floats(0.05, 5)).map(sorted)
vectors = st.tuples(*[st.floats(-3, 3)] * 3).map(np.array)


@given(
    *(st.sampled_from([Cone, Gaussian, Shell, Trajectory]), degrees, degrees, factors, st.floats(0, 500)),
    *(vectors, vectors, st.tuples(st.floats(-80, 80), st.floats(-80, 80), st.floats(20, 900)), st.integers(0, 2**40)),
)
def test_poses_are_rigid_and_keep_the_pivot_on_its_pixel(kind, cone, roll, factor, mm, turn, pivot, pivot_cam, seed):
    rotation = rotation_from_vector(turn)
    reference = ReferencePose(rigid(rotation, np.array(pivot_cam) - rotation @ pivot), pivot)
    low, high = (min(factor[0], 1), max(factor[1], 1)) if kind is Trajectory else factor
    limits = {"distance_min": low, "distance_max": high, "roll_deg": roll}
    parameters = {
        Cone: {"cone_deg": cone, **limits},
        Gaussian: {"sigma_deg": cone, "sigma_mm": mm},
        Shell: {"polar_deg": cone, **limits},
        Trajectory: {"cone_deg": cone, **limits},
    }[kind]
    pose = frame_pose(kind(reference=reference, **parameters), seed, 3)
    assert np.abs(pose[:3, :3] @ pose[:3, :3].T - np.eye(3)).max() < 1e-12
    assert abs(np.linalg.det(pose[:3, :3]) - 1) < 1e-12
    assert pose[3].tolist() == [0, 0, 0, 1]
    if kind is Gaussian:
        return
    distance = np.linalg.norm(pivot_cam)
    to_camera, towards = camera_centre(pose) - pivot, camera_centre(reference.cam_from_model) - pivot
    assert distance * (low - 1e-9) < np.linalg.norm(to_camera) < distance * (high + 1e-9)
    assert to_camera @ towards >= np.linalg.norm(to_camera) * distance * (np.cos(np.radians(cone)) - 1e-9)
    if kind is not Shell:
        pixels = CAMERA.project(np.stack([pose[:3, :3] @ pivot + pose[:3, 3], pivot_cam]))
        assert np.abs(pixels[0] - pixels[1]).max() < 1e-6


def test_a_pivot_behind_the_camera_is_refused():
    with pytest.raises(InputError, match="in front of the camera, found z = -90 mm"):
        ReferencePose(rigid(translation=[0, 0, -90.0]), np.zeros(3))
