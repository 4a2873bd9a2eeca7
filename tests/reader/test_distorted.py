"""A view with a background and through a distorting lens: what each keeps, and that truths move with the image."""

import cv2
import numpy as np
import pytest

from oneframe.errors import InputError
from oneframe.reader import DistortedView, open_dataset, with_background
from tests.dataset.synthetic_dataset import CAMERA

GRID = CAMERA.pixel_grid()


@pytest.fixture
def view(dataset):
    return open_dataset(dataset)[0]


@pytest.mark.parametrize("size", [(30, 500), (200, 20)])
def test_a_background_shows_where_the_view_has_nothing(view, rng, size):
    image = rng.integers(0, 256, (*size, 3)).astype(np.uint8)
    for images in ((), (image, image)):
        rgb = with_background(view, rng, images)
        assert rgb.dtype == np.uint8
        assert 0.05 < view.mask.mean() < 0.95
        np.testing.assert_array_equal(rgb[view.mask], view.rgb[view.mask])
        assert rgb[~view.mask].std(axis=0).min() > 5
    flat = np.full((*size, 3), [10, 120, 240], np.uint8)
    assert (with_background(view, rng, [flat])[~view.mask] == flat[0, 0]).all()
    for image in (np.ones((4, 4, 3)), np.ones((4, 4), np.uint8), np.ones((4, 4, 4), np.uint8)):
        with pytest.raises(InputError, match=r"^background: expected images \(h, w, 3\) of uint8 RGB"):
            with_background(view, rng, [image])


@pytest.mark.parametrize("coefficients", [(-0.2, 0.05, 0.002, -0.001, 0.0), (0.15, 0.0, 0.0, 0.003, 0.02)])
def test_truths_move_as_opencv_distorts_points(view, coefficients):
    distorted = DistortedView(view, coefficients)
    seen, pose = distorted.mask, distorted.cam_from_model
    assert (seen == ~np.isnan(distorted.points_model).any(axis=2)).all()
    assert ((distorted.depth_mm > 0) == seen).all()
    turn = cv2.Rodrigues(pose[:3, :3])[0]
    places = cv2.projectPoints(
        distorted.points_model[seen].astype(float), turn, pose[:3, 3], distorted.k, np.array(coefficients)
    )[0][:, 0]
    # the nearest pixel's
    assert np.abs(places - GRID[seen]).max() < 0.75
    assert np.abs((places - GRID[seen]).mean(axis=0)).max() < 0.05
    back = cv2.undistort(distorted.rgb, view.k, np.array(coefficients))
    inside = cv2.erode(view.mask.astype(np.uint8), np.ones((9, 9))) > 0
    inside[:20], inside[-20:], inside[:, :20], inside[:, -20:] = False, False, False, False
    assert np.abs(back.astype(int) - view.rgb)[inside].mean() < 3


def test_a_distortion_is_checked_and_found_in_the_dataset(view):
    with pytest.raises(InputError, match="view 0: distortion: expected five finite numbers"):
        DistortedView(view, "no")  # type: ignore[arg-type]
    with pytest.raises(InputError, match="or moves it by more than its size"):
        DistortedView(view, (1000.0, 0.0, 0.0, 0.0, 0.0))
    with pytest.raises(InputError, match="view 0: expected coefficients, as the frame had no distortion"):
        DistortedView(view)
