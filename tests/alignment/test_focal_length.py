"""The focal length from landmarks: as far off as it says, and refused where they leave it open."""

import numpy as np
import pytest

from oneframe.alignment.landmarks.focal_length import focal_length
from oneframe.camera.pinhole import PinholeCamera
from oneframe.case.landmarks import Landmark
from oneframe.errors import InputError
from oneframe.transforms import rigid, rotation_from_vector, transform_points


def clicked(rng, camera, distance_mm, count, noise_px):
    """Landmarks in a ball of 20 mm, seen from a distance."""
    points = rng.normal(size=(count, 3))
    points *= 20 * rng.random((count, 1)) ** (1 / 3) / np.linalg.norm(points, axis=1, keepdims=True)
    pose = rigid(rotation_from_vector(rng.normal(size=3)), [0.0, 0.0, distance_mm])
    pixels = camera.project(transform_points(pose, points)) + noise_px * rng.normal(size=(count, 2))
    return [Landmark(f"L{index}", tuple(point), tuple(pixels[index])) for index, point in enumerate(points)]


@pytest.mark.parametrize("focal_px", [500.0, 3000.0])
def test_exact_clicks_give_it_whatever_k_says(focal_px):
    rng = np.random.default_rng(3)
    true = PinholeCamera(640, 480, focal_px, 1.02 * focal_px, 310.0, 255.0)
    typed = PinholeCamera(640, 480, 900.0, 1.02 * 900.0, 310.0, 255.0)
    found = focal_length(clicked(rng, true, focal_px / 12, 8, 0.0), typed, click_sigma_px=0.1)
    assert found.camera.fx == pytest.approx(focal_px, rel=1e-3)
    assert found.camera.fy / found.camera.fx == pytest.approx(1.02)


@pytest.mark.parametrize("stated", [0.3, 0.2])
def test_it_is_as_far_off_as_it_says(stated):
    rng, camera = np.random.default_rng(4), PinholeCamera(640, 480, 900.0, 900.0, 319.5, 239.5)
    off = []
    for _ in range(60):
        found = focal_length(clicked(rng, camera, 70.0, 10, 0.3), camera, click_sigma_px=stated)
        off.append(np.log(found.camera.fx / 900.0) / found.relative)
    assert 0.88 <= np.mean(np.abs(off) < 1.96) <= 0.99
    assert abs(np.mean(off)) < 0.3


def test_what_leaves_it_open_is_refused():
    rng, long = np.random.default_rng(5), PinholeCamera(640, 480, 5000.0, 5000.0, 319.5, 239.5)
    with pytest.raises(InputError, match="leave the focal length open"):
        focal_length(clicked(rng, long, 400.0, 8, 2.0), long, click_sigma_px=2.0)
    with pytest.raises(InputError, match="at least 6"):
        focal_length(clicked(rng, long, 400.0, 5, 2.0), long, click_sigma_px=2.0)
    wide = PinholeCamera(640, 480, 900.0, 900.0, 319.5, 239.5)
    landmarks = clicked(rng, wide, 70.0, 8, 0.5)
    landmarks[0] = Landmark("wrong", landmarks[0].point, (10.0, 10.0))
    with pytest.raises(InputError, match="correct the wrong ones"):
        focal_length(landmarks, wide, click_sigma_px=0.5)
