"""Frames of one surface in other exposures and light agree once these are matched; those that share nothing stay."""

from dataclasses import replace

import numpy as np
import pytest

from oneframe.camera.pinhole import PinholeCamera
from oneframe.colour.seen_frame import SeenFrame
from oneframe.light.exposure import matched_exposures
from oneframe.projection.z_buffer import rasterise_depth
from oneframe.transforms import inverse_rigid, rigid, rotation_from_vector, transform_points
from tests.alignment.test_refinement import hills

CAMERA = PinholeCamera(160, 120, 750.0, 750.0, 79.5, 59.5)
GAINS = np.array([[1, 1, 1], [0.7, 0.8, 0.9], [1.2, 1.1, 0.8]])


def view(mesh, tilt_deg: float, rng: np.random.Generator) -> SeenFrame:
    """A painted surface from a side, with noise and a highlight."""
    pose = rigid(rotation_from_vector(np.radians([180 + tilt_deg, 0, 0])), np.array([0, 0, 300.0]))
    inverse = rasterise_depth(mesh, CAMERA, pose).inverse_depth
    points_cam = CAMERA.rays_cam(CAMERA.pixel_grid()) / np.maximum(inverse, 1e-9)[..., None]
    places = transform_points(inverse_rigid(pose), points_cam.reshape(-1, 3)).reshape(*CAMERA.shape_hw, 3)
    image = 0.45 + 0.2 * np.sin(places[..., [0, 1, 0]] / [3.0, 4.0, 5.0]) + rng.normal(0, 0.02, (*CAMERA.shape_hw, 3))
    image = np.where(inverse[..., None] > 0, image, 0.0).astype(np.float32)
    image[20:40, 30:60] = 1.0
    return SeenFrame(image, np.ones(CAMERA.shape_hw, bool), CAMERA, pose, inverse_depth=inverse.astype(np.float32))


def test_exposures_are_matched_to_the_first_frame():
    rng, mesh = np.random.default_rng(0), hills(1)
    views = [view(mesh, tilt, rng) for tilt in (0, 20, -20)]
    across = (np.arange(CAMERA.width) / CAMERA.width - 0.5)[:, None]
    apart = [
        replace(each, image=(each.image * gain * np.exp(slope * across)).astype(np.float32))
        for each, gain, slope in zip(views, GAINS, [0, 0.3, -0.2], strict=True)
    ]
    # nothing is in front of this one
    away = replace(apart[1], inverse_depth=np.zeros(CAMERA.shape_hw, np.float32))
    matched = matched_exposures([*apart, away])
    assert matched[0] is apart[0]
    for found, true in zip(matched, views, strict=False):
        for part in (np.s_[50:110, 70:90], np.s_[50:110, 130:150]):
            assert np.median(found.image[part] / true.image[part]) == pytest.approx(1, abs=0.02)
    assert np.array_equal(matched[3].image, away.image)


@pytest.mark.parametrize(("brightest", "darkest"), [(1.0, 0.0), (2.5, -0.055)])
def test_matching_leaves_colours_their_range(brightest, darkest):
    """Codes end at 0 and 1, albedos do not."""
    rng, mesh = np.random.default_rng(2), hills(1)
    own, other = view(mesh, 0, rng), view(mesh, 20, rng)
    other.image[:10] = brightest
    other.image[10:20] = darkest
    _, matched = matched_exposures([own, other])
    assert matched.image.max() == pytest.approx(brightest, rel=0.02)
    assert matched.image.min() == pytest.approx(darkest, abs=0.005)
    assert matched.image.max() <= brightest
