"""Laws of simplification: both surfaces stay within tolerance of each other, what is closed stays closed."""

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import cKDTree
from skimage.measure import marching_cubes

from oneframe.errors import InputError
from oneframe.surface.deviation import deviation
from oneframe.surface.mesh import TriangleMesh
from oneframe.volume.bone import simplification
from oneframe.volume.bone.simplification import simplified, tolerance_near


def _mesh(vertices: np.ndarray, faces: np.ndarray) -> TriangleMesh:
    return TriangleMesh(np.asarray(vertices, np.float64), np.asarray(faces, np.int32))


def _bumpy_sphere(seed: int, radius: float = 4.0) -> TriangleMesh:
    sphere = trimesh.creation.icosphere(4)
    bumps = 1 + 0.01 * np.random.default_rng(seed).normal(size=(len(sphere.vertices), 1))
    return _mesh(radius * sphere.vertices * bumps, sphere.faces)


def _random_field(seed: int, size: int = 18) -> TriangleMesh:
    """Blobs with holes, tunnels and crumbs, closed, with the slivers of marching cubes."""
    values = np.random.default_rng(seed).normal(size=(size,) * 3)
    for axis in range(3):
        for _ in range(3):
            values = (np.roll(values, 1, axis) + 2 * values + np.roll(values, -1, axis)) / 4
    vertices, faces, _, _ = marching_cubes(np.pad(values, 1, constant_values=-1.0), 0.02)
    return _mesh(vertices * 0.2 + (0, 0, 1000), faces)


def _excess(points: np.ndarray, mesh: TriangleMesh, tolerance: float) -> float:
    """How much farther than the tolerance the farthest point lies, measured from samples all over the mesh."""
    side = tolerance / 2
    samples, _ = trimesh.remesh.subdivide_to_size(mesh.vertices, mesh.faces, side, max_iter=20)
    # no point of a triangle is farther from the nearest corner than that of an equilateral one
    return float(cKDTree(samples).query(points)[0].max() - tolerance - side / np.sqrt(3))


def _check(mesh: TriangleMesh, reduced: TriangleMesh, tolerance: float) -> None:
    corners = reduced.vertices[reduced.faces]
    middles = (corners + np.roll(corners, 1, axis=1)).reshape(-1, 3) / 2
    assert _excess(np.concatenate([mesh.vertices, mesh.face_centres]), reduced, tolerance) <= 0
    assert _excess(np.concatenate([reduced.vertices, reduced.face_centres, middles]), mesh, tolerance) <= 0
    theirs = trimesh.Trimesh(reduced.vertices, reduced.faces, process=False)
    assert theirs.is_watertight
    assert theirs.is_winding_consistent
    assert len(np.unique(reduced.faces)) == len(reduced.vertices)


@settings(max_examples=3)
@given(st.integers(0, 10**6), st.floats(0.15, 0.5), st.sampled_from([_bumpy_sphere, _random_field]))
def test_within_tolerance_both_ways_and_closed(seed: int, tolerance: float, shape) -> None:
    mesh = shape(seed)
    _check(mesh, simplified(mesh, tolerance), tolerance)


def test_blocks_keep_the_laws_and_the_same_mesh_gives_the_same_bytes(monkeypatch: pytest.MonkeyPatch) -> None:
    mesh = _random_field(5, 14)
    monkeypatch.setattr(simplification, "_BLOCK_FACES", 500)
    shares: list[float] = []
    reduced, again = simplified(mesh, 0.1, progress=shares.append), simplified(mesh, 0.1)
    assert shares == sorted(shares)
    assert shares[-1] == 1.0
    assert len(reduced.faces) < 0.7 * len(mesh.faces)
    assert reduced.vertices.tobytes() + reduced.faces.tobytes() == again.vertices.tobytes() + again.faces.tobytes()
    _check(mesh, reduced, 0.1)


def test_each_vertex_has_its_own_tolerance() -> None:
    mesh = _bumpy_sphere(2, 10.0)
    tolerance = tolerance_near(mesh, np.array([0.0, 0.0, 10.0]), 5.0, 0.02, 0.6)
    reduced = simplified(mesh, tolerance)
    assert (tolerance == 0.02).sum() > 50
    assert (deviation(mesh.vertices, reduced) <= tolerance).all()
    fine, coarse = simplified(mesh, 0.02), simplified(mesh, 0.6)
    above, below = (
        [int((side * each.vertices[:, 2] > height).sum()) for each in (reduced, fine, coarse)]
        for side, height in ((1, 9), (-1, 2))
    )
    assert above[0] > 0.8 * above[1] > 2 * above[2]
    assert below[0] < 1.5 * below[2] < 0.5 * below[1]


def _border(mesh: TriangleMesh) -> np.ndarray:
    """``(E, 6)`` ends of the edges of one face, in order."""
    ends = np.sort(mesh.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    edges, count = np.unique(ends, axis=0, return_counts=True)
    points = mesh.vertices[edges[count == 1]]
    return np.unique(np.take_along_axis(points, np.argsort(points[:, :, :1], axis=1), axis=1).reshape(-1, 6), axis=0)


def test_a_border_stays() -> None:
    mesh = _random_field(3)
    opened = TriangleMesh(mesh.vertices, mesh.faces[mesh.face_centres[:, 0] < 2.5])
    used, corners = np.unique(opened.faces, return_inverse=True)
    opened = _mesh(opened.vertices[used], corners.reshape(-1, 3))
    reduced = simplified(opened, 0.1)
    assert len(reduced.faces) < 0.7 * len(opened.faces)
    assert np.array_equal(_border(reduced), _border(opened))


@pytest.mark.parametrize("tolerance", [-0.1, np.nan, np.zeros(3)])
def test_bad_tolerances_are_refused(tolerance: object) -> None:
    with pytest.raises(InputError, match="tolerance: expected"):
        simplified(_bumpy_sphere(0), tolerance)  # type: ignore[arg-type]
