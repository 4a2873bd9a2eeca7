"""Lens distortion against OpenCV's own implementation."""

import cv2
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from oneframe.camera.distortion import Distortion, checked_distortion, lens_doubts, undistort
from oneframe.camera.pinhole import PinholeCamera
from oneframe.errors import InputError

CAMERA = PinholeCamera(160, 120, 150.0, 140.0, 70.5, 62.25)

coefficients = st.tuples(
    st.floats(-0.4, 0.4), st.floats(-0.2, 0.2), st.floats(-0.02, 0.02), st.floats(-0.02, 0.02), st.floats(-0.1, 0.1)
)


@given(coefficients)
def test_distortion_is_opencvs(values):
    points = np.random.default_rng(0).uniform(-0.6, 0.6, (50, 2))
    expected = cv2.projectPoints(np.c_[points, np.ones(50)], np.zeros(3), np.zeros(3), np.eye(3), np.array(values))
    assert np.abs(Distortion(*values).distort(points) - expected[0][:, 0]).max() < 1e-9


@pytest.mark.parametrize(
    "values", [(-0.25, 0.08, 0.0, 0.0, 0.0), (0.2, -0.05, 0.004, -0.003, 0.02)], ids=["barrel", "pincushion"]
)
def test_undistorted_frame_is_opencvs(values):
    v, u = np.mgrid[: CAMERA.height, : CAMERA.width]
    image = np.stack([np.sin(u / 9) * np.cos(v / 7), np.cos(u / 11), np.sin(v / 8)], -1).astype(np.float32)
    undistorted, inside = undistort(image, CAMERA, Distortion(*values))
    expected = cv2.undistort(image, CAMERA.k, np.array(values))
    assert undistorted.dtype == image.dtype
    assert inside.mean() > 0.75
    content = cv2.undistort(np.ones(CAMERA.shape_hw, np.float32), CAMERA.k, np.array(values)) > 1 - 1e-6
    assert np.count_nonzero(inside != content) < 10
    # OpenCV rounds its map to 1/32 pixel
    assert np.abs(undistorted - expected)[inside].max() < 1 / 32
    assert np.abs(undistorted - image)[inside].max() > 0.3


@given(coefficients)
def test_accepted_distortions_can_be_inverted(values):
    """Within its reach a distortion is one to one: OpenCV's iterative inverse recovers every pixel."""
    camera = PinholeCamera(64, 48, 60.0, 60.0, 31.5, 23.5)
    assume(any(values))
    try:
        distortion = checked_distortion(values, camera, "K")
    except InputError:
        assume(False)
    ideal = camera.rays_cam(camera.pixel_grid().reshape(-1, 2))[:, :2]
    ideal = ideal[np.hypot(*ideal.T) < distortion.reach(camera)]
    distorted = distortion.distort(ideal)
    criteria = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 200, 1e-12)
    back = cv2.undistortPointsIter(distorted[:, None], np.eye(3), np.array(values), np.eye(3), np.eye(3), criteria)
    error = np.abs(distortion.distort(back[:, 0]) - distorted).max(axis=1)
    # where its iteration converges, it returns the initial point
    assert np.abs(back[:, 0] - ideal)[error < 1e-12].max(initial=0) < 1e-6


def test_beyond_a_fold_outside_the_picture_the_frame_is_masked():
    """A laparoscope's lens, whose coefficients hold within its round view alone."""
    camera = PinholeCamera(480, 270, 238.0, 238.0, 220.6, 137.9)
    lens = checked_distortion([-0.23185, 0.34051, 0, 0, -0.2386], camera, "K")
    _, inside = undistort(np.ones((*camera.shape_hw, 3), np.float32), camera, lens)
    radii = np.hypot(*(camera.pixel_grid() - [camera.cx, camera.cy]).reshape(-1, 2).T).reshape(camera.shape_hw)
    steps = np.linspace(0, 1.5, 1001)
    fold_px = camera.fx * steps[lens.distort(np.stack([steps, 0 * steps], -1))[:, 0].argmax()]
    assert not inside[radii > fold_px].any()
    assert inside[radii < 0.97 * fold_px].mean() > 0.99
    assert "what lies beyond, 5% of the frame, is masked" in lens_doubts(lens, camera)[0]
