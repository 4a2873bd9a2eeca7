"""Frames say where a surface is wrong, to which side, and nothing of a true one."""

from dataclasses import replace

import numpy as np
import pytest

from oneframe.surface_correction.surface_check import PLACE_PX, check_surface
from oneframe.transforms import transform_points
from tests.surface_correction.test_surface_correction import CAMERA, POSES, bump, photographs, surface


@pytest.fixture(scope="module")
def frames():
    return photographs(surface())


def checked(mesh, frames):
    return check_surface(mesh, np.zeros(3), frames[0], frames[1:])


def test_a_true_surface_is_not_doubted(frames):
    found = checked(surface(), frames)
    assert np.isfinite(found.off_mm).mean() > 0.4
    assert (found.share, found.words, found.frames) == (0, "", 10)


@pytest.mark.parametrize("height_mm", [-2.0, 2.0])
def test_a_bump_is_found_where_it_is(frames, height_mm):
    mesh = surface()
    heights = bump(mesh, height_mm)
    found = checked(replace(mesh, vertices=mesh.vertices + heights[:, None] * [0, 0, 1]), frames)
    assert found.wrong.sum() > 3
    assert "probably wrong" in found.words
    # what the bump raises lies deeper
    assert (np.sign(found.off_mm[found.wrong]) == -np.sign(height_mm)).all()
    top = CAMERA.project(transform_points(POSES[0], mesh.vertices[np.abs(heights).argmax()]))
    rows, columns = np.nonzero(found.wrong)
    assert np.linalg.norm(PLACE_PX * np.stack([columns + 0.5, rows + 0.5], axis=1) - top, axis=1).max() < 35
    picture = found.picture(frames[0].image)
    coloured = np.ptp(picture, axis=2) > 0.1
    assert coloured.sum() == PLACE_PX**2 * found.wrong.sum()
    assert (np.argmax(picture[coloured], axis=1) == (2 if height_mm > 0 else 0)).all()


def test_few_frames_and_frames_from_one_side_say_nothing(frames):
    assert checked(surface(), frames[:10]) is None
    assert checked(surface(), [frames[0]] * 12) is None
