"""Taubin's filter: noise goes, volume and drilled vertices stay."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from oneframe.volume.bone.bone_surface import smoothed
from oneframe.volume.bone.isosurface import Isosurface, isosurface
from oneframe.volume.volume import VoxelGrid
from tests.volume.solids import enclosed_mm3


def noisy_ball(radius: float, noise_hu: float, offset: float = 0.0) -> tuple[Isosurface, np.ndarray]:
    """A ball of ``radius`` voxels in a CT with noise, 1200 HU a voxel at its surface; and its centre."""
    count = int(2 * radius + 8)
    centre = np.full(3, (count - 1) / 2 + 0.13)
    z, y, x = np.ix_(*[np.arange(count) - centre[0]] * 3)
    values = np.clip((radius - np.sqrt(x * x + y * y + z * z)) * 1200, -1000, 1000)
    values += np.random.default_rng(0).normal(0, noise_hu, values.shape)
    matrix = np.eye(4)
    matrix[:3, 3] = offset
    return isosurface(values, 0, VoxelGrid((count, count, count), matrix)), centre + offset


@settings(max_examples=8)
@given(st.floats(5, 25), st.integers(1, 20))
def test_volume_of_a_ball_stays_within_half_a_percent(radius, steps):
    rough, _ = noisy_ball(radius, 0)
    assert abs(enclosed_mm3(smoothed(rough, steps).mesh) / enclosed_mm3(rough.mesh) - 1) < 0.005


def test_noise_goes_and_a_far_origin_changes_nothing():
    rough, centre = noisy_ball(20, 100)
    fine = smoothed(rough)
    error = [np.linalg.norm(s.mesh.vertices - centre, axis=1) - 20 for s in (rough, fine)]
    assert np.abs(error[1]).mean() < 0.65 * np.abs(error[0]).mean()
    assert abs(error[1].mean()) < 0.005
    far, _ = noisy_ball(20, 100, offset=1e6)
    np.testing.assert_allclose(smoothed(far).mesh.vertices - 1e6, fine.mesh.vertices, atol=1e-8)


def test_drilled_vertices_stay_to_the_last_bit_and_the_rest_moves():
    rough, centre = noisy_ball(12, 50)
    drilled = rough.mesh.vertices[:, 0] > centre[0]
    fine = smoothed(Isosurface(rough.mesh, drilled))
    moved = (fine.mesh.vertices != rough.mesh.vertices).any(axis=1)
    assert not moved[drilled].any()
    assert moved[~drilled].all()
    assert smoothed(rough, 0) is rough
