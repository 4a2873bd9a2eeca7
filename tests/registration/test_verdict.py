"""A zoom is doubted only where the surface tells it."""

import numpy as np
import pytest

from oneframe.registration.flow_refinement import FlowFit
from oneframe.registration.verdict import LEAST_ACCEPTED, blocks_of
from oneframe.registration.zoom import at_same_focal_length, zoom_of
from tests.registration import test_registration as scene

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
