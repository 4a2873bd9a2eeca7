"""Frames say where a surface is wrong, to which side, and nothing of a true one."""

from dataclasses import replace

import numpy as np
import pytest

from oneframe.camera.pinhole import PinholeCamera
from oneframe.case.frame import PosedFrame
from oneframe.projection.z_buffer import rasterise_depth
from oneframe.registration.surface_check import PLACE_PX, check_surface
from oneframe.transforms import inverse_rigid, rigid, rotation_from_vector, transform_points
from tests.conftest import grid_mesh

CAMERA = PinholeCamera(160, 120, fx=740.0, fy=740.0, cx=79.5, cy=59.5)
TURNS = [(0.0, 0.0)] + [(0.3 * np.cos(at), 0.3 * np.sin(at)) for at in np.linspace(0, 2 * np.pi, 10, endpoint=False)]
POSES = [rigid(rotation_from_vector([np.pi, 0, 0]) @ rotation_from_vector([a, b, 0]), [0, 0, 300.0]) for a, b in TURNS]


@pytest.fixture(scope="module")
def surface():
    x, y = np.meshgrid(np.linspace(-36, 36, 90), np.linspace(-28, 28, 70))
    return grid_mesh(x, y, 3 * np.sin(x / 6) * np.cos(y / 7) + 2 * np.sin((x + y) / 9))


@pytest.fixture(scope="module")
def frames(surface):
    """Waves of paint on the surface, and noise."""
    rng = np.random.default_rng(0)
    waves, phases = rng.normal(size=(60, 3)) * 1.1, rng.uniform(0, 2 * np.pi, 60)
    made = []
    for pose in POSES:
        raster = rasterise_depth(surface, CAMERA, pose)
        shown = raster.face >= 0
        rays = CAMERA.rays_cam(CAMERA.pixel_grid()[shown])
        points = transform_points(inverse_rigid(pose), rays / raster.inverse_depth[shown][:, None])
        image = np.zeros((*CAMERA.shape_hw, 3), np.float32)
        codes = 0.5 * np.exp(np.cos(points @ waves.T + phases).sum(axis=1) / 24) + rng.normal(0, 0.008, len(points))
        image[shown] = np.clip(codes, 0, 1)[:, None]
        made.append(PosedFrame(image, np.ones(CAMERA.shape_hw, bool), CAMERA, pose))
    return made


def checked(mesh, frames):
    return check_surface(mesh, np.zeros(3), frames[0], frames[1:])


def test_a_true_surface_is_not_doubted(surface, frames):
    found = checked(surface, frames)
    assert np.isfinite(found.off_mm).mean() > 0.4
    assert (found.share, found.words, found.frames) == (0, "", 10)


@pytest.mark.parametrize("height_mm", [-2.0, 2.0])
def test_a_bump_is_found_where_it_is(surface, frames, height_mm):
    x, y, _ = surface.vertices.T
    heights = height_mm * np.exp(-((x - 4) ** 2 + (y + 3) ** 2) / (2 * 5.0**2))
    found = checked(replace(surface, vertices=surface.vertices + heights[:, None] * [0, 0, 1]), frames)
    assert found.wrong.sum() > 3
    assert "probably wrong" in found.words
    # what the bump raises lies deeper
    assert (np.sign(found.off_mm[found.wrong]) == -np.sign(height_mm)).all()
    top = CAMERA.project(transform_points(POSES[0], surface.vertices[np.abs(heights).argmax()]))
    rows, columns = np.nonzero(found.wrong)
    assert np.linalg.norm(PLACE_PX * np.stack([columns + 0.5, rows + 0.5], axis=1) - top, axis=1).max() < 35
    picture = found.picture(frames[0].image)
    coloured = np.ptp(picture, axis=2) > 0.1
    assert coloured.sum() == PLACE_PX**2 * found.wrong.sum()
    assert (np.argmax(picture[coloured], axis=1) == (2 if height_mm > 0 else 0)).all()


def test_few_frames_and_frames_from_one_side_say_nothing(surface, frames):
    assert checked(surface, frames[:10]) is None
    assert checked(surface, [frames[0]] * 12) is None
