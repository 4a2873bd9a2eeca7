"""What simplification promises: fewer faces, both surfaces within the tolerance nearly everywhere, no new borders."""

import numpy as np
import pytest
import trimesh

from oneframe.surface.deviation import deviation
from oneframe.surface.mesh import Ball, TriangleMesh
from oneframe.volume.bone.isosurface import isosurface
from oneframe.volume.bone.simplification import simplified
from oneframe.volume.volume import VoxelGrid


def bumpy_sphere(radius: float = 10.0) -> TriangleMesh:
    sphere = trimesh.creation.icosphere(5)
    bumps = 1 + 0.002 * np.random.default_rng(2).normal(size=(len(sphere.vertices), 1))
    return TriangleMesh(radius * sphere.vertices * bumps, np.asarray(sphere.faces, np.int32))


def blobs() -> TriangleMesh:
    """With holes, tunnels and crumbs, closed, with the slivers of marching cubes."""
    values = np.random.default_rng(5).normal(size=(30,) * 3)
    for axis in range(3):
        for _ in range(9):
            values = (np.roll(values, 1, axis) + 2 * values + np.roll(values, -1, axis)) / 4
    matrix = np.diag([0.2, 0.2, 0.2, 1])
    matrix[2, 3] = 1000
    return isosurface(values, 0.02, VoxelGrid((30,) * 3, matrix)).mesh


def edges(mesh: TriangleMesh) -> tuple[np.ndarray, np.ndarray]:
    """Ends of each edge, and its number of faces."""
    ends = np.sort(mesh.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    return np.unique(ends, axis=0, return_counts=True)


@pytest.mark.parametrize("shape", [bumpy_sphere, blobs])
def test_fewer_faces_within_the_tolerance_and_the_same_bytes_again(shape):
    mesh, tolerance = shape(), 0.06
    reduced = simplified(mesh, tolerance)
    assert len(reduced.faces) < 0.7 * len(mesh.faces)
    corners = reduced.vertices[reduced.faces]
    middles = (corners + np.roll(corners, 1, axis=1)).reshape(-1, 3) / 2
    for points, other in (
        (np.concatenate([reduced.vertices, middles, reduced.face_centres]), mesh),
        (np.concatenate([mesh.vertices, mesh.face_centres]), reduced),
    ):
        distance = deviation(points[:: len(points) // 1500], other)
        assert np.percentile(distance, 99.5) < tolerance
        assert distance.max() < 4 * tolerance
    assert (edges(reduced)[1] % 2 == 0).all()
    assert len(np.unique(reduced.faces)) == len(reduced.vertices)
    again = simplified(mesh, tolerance)
    assert reduced.vertices.tobytes() + reduced.faces.tobytes() == again.vertices.tobytes() + again.faces.tobytes()


def test_the_part_that_matters_has_its_own_tolerance():
    mesh = bumpy_sphere()
    reduced = simplified(mesh, 0.4, Ball(np.array([0.0, 0.0, 10.0]), 2.5), 20)
    fine, coarse = simplified(mesh, 0.02), simplified(mesh, 0.4)
    above, below = (
        [int((side * each.vertices[:, 2] > height).sum()) for each in (reduced, fine, coarse)]
        for side, height in ((1, 9), (-1, 2))
    )
    assert above[0] > 0.8 * above[1] > 2 * above[2]
    assert below[0] < 1.5 * below[2] < 0.5 * below[1]
    assert (edges(reduced)[1] % 2 == 0).all()


def test_a_border_stays():
    mesh = blobs()
    used, corners = np.unique(mesh.faces[mesh.face_centres[:, 0] < 2.5], return_inverse=True)
    opened = TriangleMesh(mesh.vertices[used], corners.reshape(-1, 3).astype(np.int32))
    reduced = simplified(opened, 0.1)
    assert len(reduced.faces) < 0.7 * len(opened.faces)

    def border(surface: TriangleMesh) -> np.ndarray:
        ends, count = edges(surface)
        points = surface.vertices[ends[count == 1]]
        return np.unique(np.sort(points.reshape(len(points), 6), axis=1), axis=0)

    assert np.array_equal(border(reduced), border(opened))
