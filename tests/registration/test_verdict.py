"""What is doubted: a zoom only where the surface tells it, and a blurred frame less beside a view blurred alike."""

import cv2
import numpy as np
import pytest

from oneframe.registration.flow_refinement import FlowFit, refined_by_flow
from oneframe.registration.frame_blur import Blur, blur_between
from oneframe.registration.verdict import ACCEPTED, LEAST_ACCEPTED, blocks_of, judge
from oneframe.registration.zoom import at_same_focal_length, zoom_of
from tests.registration import test_registration as scene

mesh, registrar = scene.mesh, scene.registrar
CAMERA = scene.CAMERA.resized(640, 480)


@pytest.mark.parametrize(
    ("half_mm", "relief_mm", "tilt", "factor", "shared_px"),
    [(20, 1, 60, 1.0, 1.2), (28, 8, 60, 0.95, 0.2), (28, 15, 20, 1.05, 0.2)],
)
def test_a_zoom_is_doubted_where_the_relief_tells_it(half_mm, relief_mm, tilt, factor, shared_px):
    """Not that of a nearly flat surface at a grazing angle, whose image is not exact."""
    x, y = (each.ravel() for each in np.meshgrid(*[np.linspace(-half_mm, half_mm, 40)] * 2))
    points = np.stack([x, y, relief_mm * np.sin(x / 5) * np.cos(y / 7)], axis=1)
    pose, none = scene.seen_from(tilt, 0), np.zeros((len(points), 2))
    pixels, zoomed = (
        camera.project(scene.transform_points(pose, points)) for camera in (CAMERA, CAMERA.zoomed(factor))
    )
    blocks, block = blocks_of(pixels)
    for seed in range(5):
        rng = np.random.default_rng(seed)
        moved = zoomed + rng.normal(0, shared_px, (blocks, 2))[block] + rng.normal(0, 0.1, pixels.shape)
        fit = FlowFit(pose, CAMERA, pixels, none[:, 0], points, moved, none)
        (same,) = at_same_focal_length([zoom_of(fit, scene.PIVOT)])
        assert (same < LEAST_ACCEPTED) == (factor != 1)


@pytest.mark.parametrize(("focus_px", "motion_px"), [(4.0, (0, 0)), (0.0, (28, 14)), (2.0, (-10, 24))])
def test_spectra_tell_a_blur_whatever_the_gain_noise_and_shift(focus_px, motion_px):
    rng, mask = np.random.default_rng(4), np.zeros((300, 360), bool)
    mask[20:-20, 30:-30] = True
    sharp = sum(octave * cv2.GaussianBlur(rng.normal(0, 1, mask.shape), (0, 0), octave) for octave in (1, 2, 4, 8))
    sharp = np.clip(128 + 40 * sharp / sharp.std(), 0, 255).astype(np.uint8)
    true = Blur(focus_px, np.array(motion_px, float))
    seen = 30 + 0.6 * np.roll(true.of(sharp, np.ones_like(mask)), (3, -2), (0, 1)) + rng.normal(0, 1, mask.shape)
    found = blur_between(sharp, np.rint(seen).astype(np.uint8), mask)
    assert np.allclose(found.covariance_px, true.covariance_px, atol=0.1 * np.trace(true.covariance_px))
    # nothing from outside of a mask blurs into it
    inside, other = (true.of(np.where(mask, sharp, outside), mask)[mask] for outside in (0, 255))
    assert np.array_equal(inside, other)


def test_a_frame_under_motion_blur_is_found_by_a_view_blurred_alike(registrar, mesh):
    true, length = scene.seen_from(15, 10), 35
    near = scene.se3_exp(np.array([0.3, -0.3, 1.0, 0.01, -0.01, 0.01])) @ true
    shaken = cv2.filter2D(scene.photograph(mesh, true), -1, np.full((1, length), 1 / length))
    fits = [
        refined_by_flow(registrar.views, scene.codes(shaken), scene.everywhere(), near, blurred=blurred)
        for blurred in (False, True)
    ]
    verdicts = [judge(fit, None, scene.PIVOT)[0] for fit in fits]
    assert [verdict.state == ACCEPTED for verdict in verdicts] == [False, True]
    found = scene.found_in(registrar, scene.codes(shaken), near)
    assert found.verdict == verdicts[1]
    assert np.abs(found.cam_from_model - true).max() < 0.5
    # and less sure than a sharp frame
    sharp = scene.found_in(registrar, scene.codes(scene.photograph(mesh, true)), near)
    wider = found.uncertainty.covariance - sharp.uncertainty.covariance
    assert np.linalg.eigvalsh(wider)[0] > 0
