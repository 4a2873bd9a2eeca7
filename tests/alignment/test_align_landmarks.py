"""Which landmarks take part, that the present pose decides only where it must, and what lies off the surface."""

import numpy as np
import pytest

from oneframe.alignment.landmarks.align_landmarks import align_landmarks
from oneframe.alignment.landmarks.solver import UndeterminedPose
from oneframe.camera.pinhole import PinholeCamera
from oneframe.case.landmarks import Landmark
from oneframe.transforms import rigid, rotation_angle_deg, rotation_from_vector, transform_points

CAMERA = PinholeCamera(1920, 1080, 12800.0, 12750.0, 955.0, 545.0)
POSE = rigid(rotation_from_vector(np.array([2.8, 0.3, -0.2])), [1.0, -2.0, 300.0])


def landmarks_at(points, pixels, **settings) -> list[Landmark]:
    return [
        Landmark(f"mark {number}", tuple(point), tuple(pixel), **settings)
        for number, (point, pixel) in enumerate(zip(points.tolist(), pixels.tolist(), strict=True))
    ]


def test_the_present_pose_decides_only_between_poses_that_fit():
    """Four points of a plane seen from far away: two tilts, mirror images of each other, fit."""
    points = np.array([[-10, -8, 0], [10, -8, 0], [10, 8, 0], [-10, 8, 0.0]])
    far = PinholeCamera(1920, 1080, 128000.0, 128000.0, 960.0, 540.0)
    tilted = [rigid(rotation_from_vector(np.array([turn, 0, 0])), [0, 0, 3000.0]) for turn in (0.35, -0.35)]
    landmarks = landmarks_at(points, far.project(transform_points(tilted[0], points)))
    with pytest.raises(UndeterminedPose) as refused:
        align_landmarks(landmarks, far, click_sigma_px=2.0)
    assert len(refused.value.candidates) == 2
    for pose in tilted:
        found = align_landmarks(landmarks, far, click_sigma_px=2.0, start=pose).estimate.cam_from_model
        assert rotation_angle_deg(found[:3, :3] @ pose[:3, :3].T) < 3
    # where they determine the pose, it decides nothing
    solid = landmarks_at(*solid_pairs())
    expected = align_landmarks(solid, CAMERA, click_sigma_px=2.0).estimate.cam_from_model
    for pose in tilted:
        found = align_landmarks(solid, CAMERA, click_sigma_px=2.0, start=pose).estimate.cam_from_model
        assert np.array_equal(found, expected)


def solid_pairs() -> tuple[np.ndarray, np.ndarray]:
    points = (np.random.default_rng(3).random((8, 3)) - 0.5) * [30, 20, 12]
    return points, CAMERA.project(transform_points(POSE, points))


def test_disabled_and_incomplete_landmarks_take_no_part():
    points, pixels = solid_pairs()
    used = landmarks_at(points, pixels)
    given_list = [
        Landmark("half", None, (3.0, 4.0)), *used[:4], Landmark("off", (0.0, 0.0, 0.0), (1.0, 1.0), enabled=False),
        Landmark("other half", (1.0, 2.0, 3.0), None), *used[4:],
    ]  # fmt: skip
    found = align_landmarks(given_list, CAMERA, click_sigma_px=2.0)
    assert found.landmarks == tuple(used)
    assert found.indices == (1, 2, 3, 4, 7, 8, 9, 10)
    expected = align_landmarks(used, CAMERA, click_sigma_px=2.0)
    assert np.array_equal(found.estimate.cam_from_model, expected.estimate.cam_from_model)
    assert np.array_equal(found.points, points)
