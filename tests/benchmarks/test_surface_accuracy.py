"""The benchmark of the surface from CT: errors that are what they should be, a synthetic CT that is one."""

import numpy as np

from oneframe.volume.bone.bone import bone_voxels
from oneframe.volume.bone.isosurface import isosurface
from oneframe.volume.reading.volume_reader import read_volume
from scripts.benchmarks.surface_accuracy import OURS, PEER, SHAPES, measure_shapes, write_synthetic_bone


def test_analytic_surfaces_are_met_to_a_hundredth_of_a_voxel():
    lines = []
    found = measure_shapes(160, 1, lines.append)
    assert len(lines) == len(found) == 2 * len(SHAPES)
    for ours, peer in zip(found[::2], found[1::2], strict=True):
        assert (ours.program, peer.program) == (OURS, PEER)
        assert 0 < ours.mean_voxels < 0.01
        assert ours.mean_voxels <= 1.01 * peer.mean_voxels
        assert ours.p99_voxels < 0.1


def test_the_synthetic_ct_is_bone_with_air_cells(tmp_path):
    write_synthetic_bone(tmp_path / "ct.mha", 96, 0.5, np.random.default_rng(0))
    volume = read_volume(tmp_path / "ct.mha")
    assert volume.values.shape == (96, 96, 96)
    solid = bone_voxels(volume, 300)
    assert 0.02 < solid.mean() < 0.2
    ball = 4 * np.pi * (0.38 * 96 * 0.5) ** 2
    crosses = isosurface(volume.values, 300, volume.grid, solid=solid).mesh.face_cross
    assert np.linalg.norm(crosses, axis=1).sum() / 2 > 2 * ball
