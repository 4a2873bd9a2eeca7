"""What is doubted: a zoom only where the surface tells it, and a blurred frame only if blurring both does not help."""

import cv2
import numpy as np
import pytest

from oneframe.registration.flow_refinement import FlowFit, refined_by_flow
from oneframe.registration.register import at_same_focal_length, zoom_of
from oneframe.registration.verdict import ACCEPTED, LEAST_ACCEPTED, blocks_of, judge
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


def test_a_frame_under_motion_blur_is_found_by_what_both_show_blurred(registrar, mesh):
    true, length = scene.seen_from(15, 10), 15
    near = scene.se3_exp(np.array([0.3, -0.3, 1.0, 0.01, -0.01, 0.01])) @ true
    shaken = cv2.filter2D(scene.photograph(mesh, true), -1, np.full((1, length), 1 / length))
    fits = [
        refined_by_flow(registrar._views, scene.codes(shaken), scene.everywhere(), near, smooth=smooth)
        for smooth in (False, True)
    ]
    verdicts = [judge(fit, None, scene.PIVOT)[0] for fit in fits]
    assert [verdict.state == ACCEPTED for verdict in verdicts] == [False, True]
    found = registrar.register(scene.codes(shaken), scene.everywhere(), near)
    assert found.verdict == verdicts[1]
    assert np.abs(found.cam_from_model - true).max() < 0.5
    # and less sure than a sharp frame
    sharp = registrar.register(scene.codes(scene.photograph(mesh, true)), scene.everywhere(), near)
    wider = found.uncertainty.covariance - sharp.uncertainty.covariance
    assert np.linalg.eigvalsh(wider)[0] > 0
