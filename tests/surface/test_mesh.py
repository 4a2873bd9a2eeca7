"""Laws of TriangleMesh, checked_mesh, diameter and deviation."""

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from oneframe.errors import InputError
from oneframe.surface.deviation import deviation
from oneframe.surface.mesh import TriangleMesh, checked_mesh, diameter
from oneframe.transforms import rotation_from_vector
from tests.volume.solids import enclosed_mm3

CUBE_VERTICES = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=float)
CUBE_SIDES = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]  # outward
CUBE_FACES = np.array([[a, b, c] for a, b, c, _ in CUBE_SIDES] + [[a, c, d] for a, _, c, d in CUBE_SIDES])

# small integers give many duplicate, collinear and coplanar points; large offsets test cancellation
lattices = hnp.arrays(np.float64, st.tuples(st.integers(1, 40), st.just(3)), elements=st.integers(-3, 3).map(float))
clouds = hnp.arrays(np.float64, st.tuples(st.integers(1, 40), st.just(3)), elements=st.floats(-1e4, 1e4, width=32))
flattenings = st.sampled_from([(1, 1, 1), (1, 1, 0), (1, 0, 0), (1, 1, 1e-6), (0, 0, 0)])


def brute_force_diameter(points: np.ndarray) -> float:
    return max(float(np.sqrt(((points - point) ** 2).sum(axis=1)).max()) for point in points)


def area(mesh: TriangleMesh) -> float:
    return float(np.linalg.norm(mesh.face_cross, axis=1).sum() / 2)


@given(st.one_of(lattices, clouds), flattenings, st.floats(-1e3, 1e3))
def test_diameter_is_that_of_all_pairs(points, flattening, offset):
    points = points * flattening + offset
    assert diameter(points) == pytest.approx(brute_force_diameter(points), rel=1e-12, abs=1e-9)


@given(st.tuples(*[st.integers(-5, 5).map(lambda x: x + 0.5)] * 3))
def test_a_cube_shows_its_front_on_the_sides_that_a_viewpoint_is_beyond(viewpoint):
    cube = TriangleMesh(CUBE_VERTICES, CUBE_FACES)
    outward = cube.face_normals
    shown = (outward @ np.array(viewpoint)) > (outward * cube.face_centres).sum(axis=1)
    assert cube.front_facing(np.array(viewpoint)).tolist() == shown.tolist()
    some = np.array([7, 2, 2])
    assert cube.front_facing(np.array(viewpoint), some).tolist() == shown[some].tolist()
    assert cube.flipped().front_facing(np.array(viewpoint)).tolist() == (~shown).tolist()


@given(
    hnp.arrays(np.float64, 3, elements=st.floats(-3, 3)),
    hnp.arrays(np.float64, 3, elements=st.floats(-50, 50)),
    st.floats(0.1, 10),
)
def test_measures_of_a_moved_turned_scaled_cube(rotation_vector, offset, factor):
    turned = CUBE_VERTICES @ rotation_from_vector(rotation_vector).T
    mesh = TriangleMesh(turned, CUBE_FACES).scaled(factor).moved(offset)
    assert enclosed_mm3(mesh) == pytest.approx(factor**3, rel=1e-9, abs=1e-9)
    assert area(mesh) == pytest.approx(6 * factor**2, rel=1e-9)
    assert diameter(mesh.vertices) == pytest.approx(np.sqrt(3) * factor, rel=1e-12)
    assert mesh.median_edge == pytest.approx(factor, rel=1e-9)
    assert enclosed_mm3(mesh.flipped()) == pytest.approx(-enclosed_mm3(mesh), rel=1e-12)
    assert np.allclose(mesh.flipped().vertex_normals, -mesh.vertex_normals)
    assert np.allclose(np.linalg.norm(mesh.vertex_normals, axis=1), 1)
    assert np.allclose(np.linalg.norm(mesh.face_normals, axis=1), 1)
    outward = mesh.vertices - mesh.vertices.mean(axis=0)
    assert ((outward * mesh.vertex_normals).sum(axis=1) > 0).all()
    assert np.allclose((outward[mesh.faces[:, 0]] * mesh.face_normals).sum(axis=1), factor / 2)


def test_vertex_normals_of_a_sphere_are_radial():
    sphere = trimesh.creation.icosphere(3)
    mesh = TriangleMesh(np.vstack([sphere.vertices, [[9, 9, 9]]]), np.asarray(sphere.faces, np.int32))
    assert (mesh.vertex_normals[:-1] * sphere.vertices).sum(axis=1).min() > np.cos(np.radians(2))
    assert (mesh.vertex_normals[-1] == 0).all()  # no face uses it
    apart = TriangleMesh(mesh.vertices[mesh.faces].reshape(-1, 3), np.arange(mesh.faces.size).reshape(-1, 3))
    assert np.allclose(apart.smooth_normals, mesh.smooth_normals[mesh.faces].reshape(-1, 3), atol=1e-12)


@given(st.data())
def test_checked_mesh_keeps_the_surface_and_nothing_else(data):
    vertices = data.draw(hnp.arrays(np.float64, (12, 3), elements=st.integers(-4, 4).map(float)))
    faces = data.draw(hnp.arrays(np.int64, (data.draw(st.integers(1, 20)), 3), elements=st.integers(0, 11)))
    triangles = vertices[faces]
    edges = triangles[:, 1:] - triangles[:, :1]
    # exact in integers: a face has area if its edges are linearly independent
    solid = [np.linalg.matrix_rank(pair) == 2 for pair in edges]
    if not any(solid):
        with pytest.raises(InputError, match="all with zero area"):
            checked_mesh(vertices, faces, "mesh")
        return
    mesh, messages = checked_mesh(vertices, faces, "mesh")
    assert np.array_equal(mesh.vertices[mesh.faces], triangles[solid])
    assert np.array_equal(np.unique(mesh.faces), np.arange(len(mesh.vertices)))
    assert ("zero area" in " ".join(messages)) == (not all(solid))
    assert ("no face uses" in " ".join(messages)) == (len(mesh.vertices) < len(vertices))
    again, told_again = checked_mesh(mesh.vertices, mesh.faces, "mesh")
    assert told_again == []
    assert np.array_equal(again.vertices, mesh.vertices)
    assert np.array_equal(again.faces, mesh.faces)
    assert (mesh.vertices.dtype, mesh.faces.dtype) == (np.float64, np.int32)


@given(st.floats(-6, 6), st.integers(0, 2))
def test_needles_are_dropped_at_any_scale(power, shift):
    width = np.array([3e-8, 3e-7])  # relative to the length: too thin for single precision, and just enough
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0.5, width[0], 0], [0.5, 0, width[1]]]) * 10**power
    mesh, messages = checked_mesh(vertices, np.roll([[0, 1, 2], [0, 1, 3]], shift, axis=1), "mesh")
    assert np.array_equal(mesh.vertices, vertices[[0, 1, 3]])
    assert messages == ["mesh: dropped 1 of 2 faces with zero area", "mesh: dropped 1 of 4 vertices that no face uses"]


def with_coordinate(row: int, value: float) -> np.ndarray:
    vertices = CUBE_VERTICES.copy()
    vertices[row, 1] = value
    return vertices


@pytest.mark.parametrize(
    ("vertices", "faces", "message"),
    [
        (CUBE_VERTICES, np.empty((0, 3), int), "8 vertices and 0 faces"),
        (np.empty((0, 3)), CUBE_FACES, "0 vertices and 12 faces"),
        (CUBE_VERTICES, CUBE_FACES + 1, r"indices 0\.\.7, found 1\.\.8"),
        (CUBE_VERTICES, CUBE_FACES - 1, r"indices 0\.\.7, found -1\.\.6"),
        (CUBE_VERTICES, CUBE_FACES + 2**40, "indices"),
        (CUBE_VERTICES * [1, 0, 0], CUBE_FACES, "12 faces, all with zero area"),
        (with_coordinate(2, np.nan), CUBE_FACES, r".*vertex 2\)"),
        (with_coordinate(7, -np.inf), CUBE_FACES, r".*vertex 7\)"),
        (with_coordinate(3, 1e300), CUBE_FACES, r".*vertex 3\)"),
    ],
)
@pytest.mark.filterwarnings("error")
def test_checked_mesh_refuses(vertices, faces, message):
    with pytest.raises(InputError, match=rf"^x\.ply: expected .*{message}"):
        checked_mesh(vertices, faces, "x.ply")


def distances_from_all(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """``(N, F)`` distances of all points from all triangles."""
    pairs = np.repeat(triangles[None], len(points), axis=0).reshape(-1, 3, 3)
    repeated = np.repeat(points, len(triangles), axis=0)
    nearest = trimesh.triangles.closest_point(pairs, repeated)
    return np.linalg.norm(nearest - repeated, axis=1).reshape(len(points), len(triangles))


@given(st.integers(0, 10**6), st.integers(1, 300), st.floats(0.01, 100))
def test_equalsdistances_from_all(seed: int, faces: int, spread: float) -> None:
    rng = np.random.default_rng(seed)
    vertices = rng.normal(size=(3 * faces, 3)) * (1, 1, 0.3) + (0, 0, 1000)
    vertices[2::9] = vertices[1::9][: len(vertices[2::9])]  # needles without area among them
    mesh = TriangleMesh(vertices, np.arange(3 * faces, dtype=np.int32).reshape(-1, 3))
    points = rng.normal(size=(50, 3)) * spread + (0, 0, 1000)
    flat = vertices[2::9]
    assert len(flat)
    expected = distances_from_all(points, vertices[mesh.faces])
    np.testing.assert_allclose(deviation(points, mesh), expected.min(axis=1), rtol=1e-6, atol=1e-7)
