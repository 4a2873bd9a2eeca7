"""Voxels inside a mesh: those of which the mesh was made."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from oneframe.errors import InputError
from oneframe.surface.mesh import TriangleMesh
from oneframe.volume.bone.isosurface import isosurface
from oneframe.volume.drill.virtual_drill import filled
from oneframe.volume.volume import VoxelGrid


@given(st.integers(0, 2**32 - 1))
def test_surface_of_noise_is_filled_with_its_material(seed):
    rng = np.random.default_rng(seed)
    values = rng.normal(size=rng.integers(1, 9, 3))
    matrix = np.eye(4)
    matrix[:3, :3] = np.linalg.qr(rng.normal(size=(3, 3)))[0] * rng.uniform(0.2, 1, 3)
    matrix[:3, 3] = rng.normal(size=3) * 100
    grid = VoxelGrid(values.shape[::-1], matrix)
    mesh = isosurface(values, 0, grid).mesh
    if len(mesh.faces) == 0:
        return
    # seen from a smaller volume too
    cut = rng.integers(0, values.shape)
    for at, material in (((0, 0, 0), values > 0), (cut, (values > 0)[cut[0] :, cut[1] :, cut[2] :])):
        part = grid.shifted(np.array(at[::-1]), material.shape[::-1])
        first, inside = filled(mesh, part)
        found = np.zeros(material.shape, np.bool_)
        found[tuple(slice(a, a + n) for a, n in zip(first[::-1], inside.shape, strict=True))] = inside
        np.testing.assert_array_equal(found, material)


def test_mesh_with_a_hole_is_refused():
    grid = VoxelGrid((6, 6, 6), np.eye(4))
    mesh = isosurface(np.pad(np.ones((4, 4, 4)), 1), 0.5, grid).mesh
    side = mesh.face_centres[:, 0] < mesh.vertices[:, 0].max() - 1e-6
    with pytest.raises(InputError, match="expected a closed mesh"):
        filled(TriangleMesh(mesh.vertices, mesh.faces[side]), grid)
