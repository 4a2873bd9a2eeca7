"""A dragged pin reaches its pixel exactly where that is possible; what the pins do not determine stays."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from oneframe.alignment.manual.pins import MAX_DISTANCE_RATIO, pull_pins
from oneframe.alignment.reprojection import apply_twist
from oneframe.camera.pinhole import PinholeCamera
from oneframe.transforms import (
    nearest_rotation,
    rigid,
    rotation_angle_deg,
    rotation_from_vector,
    rotation_vector,
    transform_points,
)

LONG = PinholeCamera(1920, 1080, 12_800.0, 12_700.0, 930.0, 560.0)
WIDE = PinholeCamera(1920, 1080, 900.0, 910.0, 930.0, 560.0)
DISTANCE = {LONG: 300.0, WIDE: 60.0}
PIVOT = np.array([1.0, -2.0, 3.0])

cameras = st.sampled_from([LONG, WIDE])
seeds = st.integers(0, 2**32 - 1)


def scene(seed, camera, count):
    """Points in a box, a pose, and where the points are seen."""
    rng = np.random.default_rng(seed)
    points = (rng.random((count, 3)) - 0.5) * [30, 20, 12]
    pose = rigid(nearest_rotation(rng.normal(size=(3, 3))), [*rng.normal(size=2), DISTANCE[camera]])
    return rng, points, pose, shown(camera, pose, points)


def shown(camera, pose, points):
    return camera.project(transform_points(pose, points))


@given(seeds, cameras)
def test_one_pin_shifts_parallel_to_the_image(seed, camera):
    rng, points, pose, pixels = scene(seed, camera, 1)
    target = pixels + rng.normal(size=2) * 100
    pulled = pull_pins(points, target, camera, pose, PIVOT)
    assert shown(camera, pulled, points) == pytest.approx(target, abs=1e-6)
    assert np.array_equal(pulled[:3, :3], pose[:3, :3])
    assert pulled[2, 3] == pose[2, 3]


@given(seeds, cameras, st.floats(-3.1, 3.1), st.floats(-0.2, 0.3))
def test_two_pins_shift_roll_and_change_the_distance(seed, camera, roll, nearer):
    rng, points, pose, _ = scene(seed, camera, 2)
    points[1] = points[0] + pose[:3, :3].T @ [8.0, -5.0, 1.0]  # apart in the image
    ray = transform_points(pose, PIVOT) / np.linalg.norm(transform_points(pose, PIVOT))
    twist = np.array([*rng.normal(size=2), -nearer * DISTANCE[camera], *(roll * ray)])
    target = shown(camera, apply_twist(twist, pose, PIVOT), points)
    pulled = pull_pins(points, target, camera, pose, PIVOT)
    assert shown(camera, pulled, points) == pytest.approx(target, abs=0.01)
    # a roll about the view ray only, by the angle that the pins ask for
    rotation = rotation_vector(pulled[:3, :3] @ pose[:3, :3].T)
    assert rotation == pytest.approx((rotation @ ray) * ray, abs=1e-9)
    assert rotation @ ray == pytest.approx(roll, abs=2e-3)


@given(seeds, cameras, st.integers(3, 7))
def test_more_pins_use_all_six_degrees_of_freedom(seed, camera, count):
    rng, points, pose, _ = scene(seed, camera, count)
    # leaning by 40 degrees: seen face-on, three pins have two solutions that meet, and a fit may end between them
    points[:3] = points[0] + np.array([[12, 0, -3], [-9, 9, 7], [0, -9, -9]]) @ pose[:3, :3]
    twist = rng.normal(size=6) * [0.3, 0.3, 3, 0.05, 0.05, 0.05]
    target = shown(camera, apply_twist(twist, pose, PIVOT), points)
    pulled = pull_pins(points, target, camera, pose, PIVOT)
    assert shown(camera, pulled, points) == pytest.approx(target, abs=0.05)
    assert rotation_angle_deg(pulled[:3, :3] @ pose[:3, :3].T) < 60


@given(seeds, cameras)
def test_the_pin_in_the_hand_wins(seed, camera):
    rng, points, pose, pixels = scene(seed, camera, 6)
    pixels[2] += rng.normal(size=2) * 20
    off = [
        np.linalg.norm(shown(camera, pull_pins(points, pixels, camera, pose, PIVOT, held=held), points)[2] - pixels[2])
        for held in (2, None)
    ]
    assert off[0] < 0.1 * off[1] + 0.01


@pytest.mark.parametrize("camera", [LONG, WIDE])
def test_pins_on_a_line_do_not_turn_about_it(camera):
    rng = np.random.default_rng(2)
    pose = rigid(rotation_from_vector(np.array([0.4, 0.1, 0.2])), [0, 0, DISTANCE[camera]])
    points = np.outer([-8.0, -1.0, 9.0], [1, 0.3, 0.2])
    target = shown(camera, pose, points) + rng.normal(size=(3, 2)) * 2
    pulled = pull_pins(points, target, camera, pose, np.zeros(3))
    rotation = rotation_vector(pulled[:3, :3] @ pose[:3, :3].T)
    line = pose[:3, :3] @ [1, 0.3, 0.2]
    assert abs(rotation @ line) / np.linalg.norm(line) < np.radians(0.5)


def test_random_drags_never_lose_the_surface(long_form):
    """Pins set where the surface is seen, dragged anywhere, again, and cleared: it stays whole before the lens."""
    rng = np.random.default_rng(5)
    surface = rng.normal(size=(500, 3))
    surface *= 20 / np.linalg.norm(surface, axis=1, keepdims=True)
    pose, pins = rigid(translation=[0.0, 0.0, DISTANCE[LONG]]), []
    for _ in range(1000 if long_form else 40):
        seen = surface[((shown(LONG, pose, surface) - LONG.size_wh) * shown(LONG, pose, surface) <= 0).all(axis=1)]
        if rng.random() < 0.15:
            pins = []
        if not pins or rng.random() < 0.6:
            pins.append((rng.choice(seen), np.zeros(2)))
            held = len(pins) - 1
        else:
            held = int(rng.integers(len(pins)))
        pins[held] = pins[held][0], rng.random(2) * LONG.size_wh
        points, pixels = (np.array(each) for each in zip(*pins, strict=True))
        pivot, before = seen.mean(axis=0), pose
        pose = pull_pins(points, pixels, LONG, pose, pivot, held=held, radius_mm=40.0)
        farther = transform_points(pose, pivot)[2] / transform_points(before, pivot)[2]
        assert 1 / MAX_DISTANCE_RATIO - 1e-9 <= farther <= MAX_DISTANCE_RATIO + 1e-9
        assert shown(LONG, pose, points)[held] == pytest.approx(pixels[held], abs=1e-6)
        assert (transform_points(pose, surface)[:, 2] > 0).all()
