"""Laws of the lens: what each effect keeps, whose its random numbers are, and that truths move with the image."""

import cv2
import numpy as np
import pytest

from oneframe.errors import InputError
from oneframe.reader import (
    Background,
    Defocus,
    DistortedView,
    Exposure,
    RoundView,
    SensorNoise,
    open_dataset,
    through_lens,
)
from tests.dataset.synthetic_dataset import CAMERA

GRID = CAMERA.pixel_grid()
ALL = (Defocus((0.2, 0.4)), RoundView((0.3, 0.4)), Exposure(), SensorNoise())


@pytest.fixture
def view(dataset):
    return open_dataset(dataset)[0]


def test_the_same_view_and_seed_give_the_same_whatever_else_is_asked_for(dataset, packed):
    views = open_dataset(dataset)
    first = [through_lens(each, ALL, seed=3)[0] for each in views]
    again = [through_lens(each, ALL, seed=3)[0] for each in reversed(open_dataset(packed))][::-1]
    assert all((one == other).all() for one, other in zip(first, again, strict=True))
    assert (through_lens(views[0], ALL, seed=4)[0] != first[0]).any()
    # an effect draws the same with others before it
    alone, dark = through_lens(views[0], ALL[1:2], 3)[1], through_lens(views[0], ALL, 3)[1]
    assert (alone == dark).all()
    assert not first[0][~dark].any()
    assert 0.1 < dark.mean() < 0.9


def test_nothing_in_front_of_the_view_leaves_it(view):
    rgb, shown = through_lens(view, (), seed=0)
    assert (rgb == view.rgb).all()
    assert shown.all()


@pytest.mark.parametrize("size", [(30, 500), (200, 20)])
def test_a_background_shows_where_the_view_has_nothing(view, rng, size):
    image = rng.integers(0, 256, (*size, 3)).astype(np.uint8)
    for effect in (Background(), Background([image, image])):
        rgb, shown = through_lens(view, [effect], seed=5)
        assert shown.all()
        assert 0.05 < view.mask.mean() < 0.95
        np.testing.assert_array_equal(rgb[view.mask], view.rgb[view.mask])
        assert rgb[~view.mask].std(axis=0).min() > 5
    flat = np.full((*size, 3), [10, 120, 240], np.uint8)
    assert (through_lens(view, [Background([flat])], seed=5)[0][~view.mask] == flat[0, 0]).all()


def test_what_is_no_range_and_no_picture_is_refused(view):
    for effect, ends in (
        (Defocus, (1, 0)),
        (RoundView, (0, 1)),
        (Exposure, (0, 0)),
        (SensorNoise, (-1, 0)),
        (SensorNoise, (0, np.nan)),
        (Defocus, 2),
    ):
        with pytest.raises(InputError, match=f"^{effect.__name__}: .*: expected two numbers"):
            effect(ends)
    for image in (np.ones((4, 4, 3)), np.ones((4, 4), np.uint8), np.ones((4, 4, 4), np.uint8)):
        with pytest.raises(InputError, match=r"^Background: expected images \(h, w, 3\) of uint8 RGB"):
            through_lens(view, [Background([image])], seed=5)


def test_an_exposure_is_undone_by_the_inverse_one(view, rng):
    linear = rng.random((*CAMERA.shape_hw, 3), np.float32)
    brighter = Exposure((1.7, 1.7), (1.1, 1.1))(linear, view, rng)
    np.testing.assert_allclose(brighter[..., 1], 1.7 * linear[..., 1], rtol=1e-6)
    np.testing.assert_allclose(Exposure((1 / 1.7,) * 2, (1 / 1.1,) * 2)(brighter, view, rng), linear, rtol=1e-5)


def test_noise_has_the_variance_that_is_stated(view, rng):
    shot, read = 0.004, 0.02
    for light in (0.05, 0.4):
        noise = SensorNoise((shot, shot), (read, read))(np.full((400, 400, 3), light, np.float32), view, rng) - light
        assert abs(noise.mean()) < 3e-4
        assert noise.var() == pytest.approx(shot * light + read**2, rel=0.02)


def test_defocus_keeps_focus_and_light_and_is_gaussian_on_a_plane(view, rng):
    linear = cv2.GaussianBlur(rng.random((*CAMERA.shape_hw, 3), np.float32), (0, 0), 1)
    height, width = CAMERA.shape_hw
    # a near half and a far one, 10 mm apart
    depth_mm = np.where(np.arange(width) < width // 2, 300, 310) * np.ones((height, 1))
    view.__dict__["depth_mm"] = depth_mm.astype(np.float32)
    near_sharp = Defocus((0.3, 0.3), (0, 0))(linear, view, rng)
    np.testing.assert_allclose(near_sharp[:, : width // 2], linear[:, : width // 2], atol=1e-4)
    far = np.s_[12:-12, width // 2 + 12 : -12]
    np.testing.assert_allclose(near_sharp[far], cv2.GaussianBlur(linear, (0, 0), 3)[far], atol=2e-3)
    far_sharp = Defocus((0.3, 0.3), (1, 1))(linear, view, rng)
    np.testing.assert_allclose(far_sharp[far], linear[far], atol=1e-4)
    assert np.abs(far_sharp[:, width // 2] - linear[:, width // 2]).max() > 0.05
    for blurred in (near_sharp, far_sharp):
        assert blurred.mean() == pytest.approx(linear.mean(), rel=0.005)


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
    with pytest.raises(InputError, match="view 0: expected coefficients, as the frame had no distortion"):
        DistortedView(view)
    with pytest.raises(AttributeError, match="flow_to: expected an array"):
        _ = DistortedView(view, [0.1, 0, 0, 0, 0]).flow_to
