"""The light at the lens: its law, and tables that are read or refused with a sentence."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from oneframe.errors import InputError
from oneframe.light.lens_light import LensLight, checked_lens_light, shading, working_distance_mm
from oneframe.transforms import rigid, rotation_from_vector, transform_points

LIGHT = LensLight((-13.0, -16.0, 4.0), 0.05)
POSE = rigid(rotation_from_vector(np.array([0.2, -0.4, 0.7])), np.array([5.0, -3.0, 290.0]))
RNG = np.random.default_rng(5)
POINTS = RNG.normal(0, 15, (200, 3))
NORMALS = (lambda n: n / np.linalg.norm(n, axis=1, keepdims=True))(RNG.normal(0, 1, (200, 3)))


def test_the_law_is_lamberts_in_the_cameras_axes():
    points = transform_points(POSE, POINTS)
    towards = np.array(LIGHT.lamp_cam_mm) - points
    r = np.linalg.norm(towards, axis=1)
    cosine = np.einsum("nk,nk->n", towards / r[:, None], NORMALS @ POSE[:3, :3].T)
    expected = 0.05 + np.maximum(cosine, 0) * (290 / r) ** 2
    off_axis = points[:, 2] / np.linalg.norm(points, axis=1)
    for law, lamp in ((replace(LIGHT, vignetting=30.0), expected), (LensLight(None, 1.0, vignetting=30.0), 1.0)):
        np.testing.assert_allclose(shading(law, POINTS, NORMALS, POSE, 290.0), lamp * off_axis**30, rtol=1e-9)
    np.testing.assert_allclose(shading(LIGHT, POINTS, NORMALS, POSE, 290.0), expected, rtol=1e-12)
    single = shading(LIGHT, POINTS.astype(np.float32), NORMALS.astype(np.float32), POSE, 290.0)
    assert single.dtype == np.float32
    np.testing.assert_allclose(single, expected, atol=2e-6)


def test_a_lens_in_the_middle_of_the_surface_has_light():
    at = rigid(rotation_from_vector(np.array([0.2, -0.4, 0.7])))
    lit = shading(LIGHT, POINTS, NORMALS, at, working_distance_mm(at, np.zeros(3)))
    assert np.isfinite(lit).all()
    assert (lit >= LIGHT.ambient).all()


@given(falloff=st.floats(0, 4), ambient=st.floats(0, 1))
def test_a_surface_that_faces_the_lamp_gets_one_more_than_in_shadow(falloff, ambient):
    light = LensLight((0.0, 0.0, 0.0), ambient, falloff)
    pose = rigid(translation=np.array([0.0, 0.0, 300.0]))
    both = np.zeros((2, 3)), np.array([[0.0, 0.0, -1.0], [0.0, 0.0, 1.0]])
    np.testing.assert_allclose(
        shading(light, *both, pose, working_distance_mm(pose, np.zeros(3))), [1 + ambient, ambient]
    )
    np.testing.assert_allclose(shading(light, *both, pose, 300.0, lit=np.zeros(2)), ambient)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"lamp_cam_mm": [0, 0]}, "lamp_cam_mm: expected three numbers"),
        ({"lamp_cam_mm": [0, 0, float("nan")]}, "lamp_cam_mm: expected three numbers"),
        ({"lamp_cam_mm": [0, 900, 0]}, "lamp_cam_mm: expected a lamp at the lens"),
        ({"ambient": -0.01}, "ambient: expected a number from 0 to 1"),
        ({"falloff": 7}, "falloff: expected a number from 0 to 4"),
        ({"vignetting": -1}, "vignetting: expected a number from 0 to 1000"),
        ({"lamp": 1}, "unknown key 'lamp'; did you mean 'lamp_cam_mm'"),
        ({"method": 3}, "method: expected text"),
        ({"transfer": 2.2}, "transfer: expected one of srgb, bt709, linear, found 2.2"),
        ({"transfer": "gamma"}, "transfer: expected one of srgb, bt709, linear"),
        ({"standard_deviation_mm": [1, -1, 1]}, "standard_deviation_mm: expected three numbers"),
    ],
)
def test_a_table_that_no_lamp_can_have_is_refused(change, words):
    table = {"lamp_cam_mm": [-13, -16, 0], "ambient": 0.05, "falloff": 2}
    assert checked_lens_light(table, "case.toml: [light]") == LensLight((-13.0, -16.0, 0.0), 0.05)
    assert checked_lens_light({"vignetting": 4}, "case.toml: [light]") == LensLight(None, 1.0, vignetting=4.0)
    with pytest.raises(InputError, match=r"^case.toml: \[light\] ") as refused:
        checked_lens_light({**table, **change}, "case.toml: [light]")
    assert words in str(refused.value)
