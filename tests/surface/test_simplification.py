"""Laws of simplification: both surfaces stay within tolerance of each other, closed stays closed, flat goes."""

import hashlib

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from skimage.measure import marching_cubes

from oneframe.errors import InputError
from oneframe.surface import reduced_surface, surface_blocks, tolerance_guard
from oneframe.surface.deviation import deviation
from oneframe.surface.mesh import TriangleMesh
from oneframe.surface.simplification import simplified, tolerance_near


def _mesh(vertices: np.ndarray, faces: np.ndarray) -> TriangleMesh:
    return TriangleMesh(np.asarray(vertices, np.float64), np.asarray(faces, np.int32))


def _bumpy_sphere(seed: int) -> TriangleMesh:
    sphere = trimesh.creation.icosphere(4)
    rng = np.random.default_rng(seed)
    bumps = 1 + 0.01 * rng.normal(size=(len(sphere.vertices), 1))
    return _mesh(10 * sphere.vertices * bumps, sphere.faces)


def _torus() -> TriangleMesh:
    torus = trimesh.creation.torus(8, 3, major_sections=96, minor_sections=48)
    return _mesh(torus.vertices, torus.faces)


def _random_field(seed: int, size: int = 26) -> TriangleMesh:
    """Blobs with holes, tunnels and crumbs, closed, with the slivers of marching cubes."""
    values = np.random.default_rng(seed).normal(size=(size,) * 3)
    for axis in range(3):
        for _ in range(3):
            values = (np.roll(values, 1, axis) + 2 * values + np.roll(values, -1, axis)) / 4
    vertices, faces, _, _ = marching_cubes(np.pad(values, 1, constant_values=-1.0), 0.02)
    return _mesh(vertices * 0.2 + (0, 0, 1000), faces)


def _box(steps: int, size: float = 4.0) -> TriangleMesh:
    """A cube whose sides are grids of triangles."""
    grid = np.linspace(0, size, steps + 1)
    u, v = (values.ravel() for values in np.meshgrid(grid, grid, indexing="ij"))
    corner = (np.arange(steps)[:, None] * (steps + 1) + np.arange(steps)).ravel()
    quads = np.stack([corner, corner + steps + 1, corner + steps + 2, corner, corner + steps + 2, corner + 1], 1)
    sides, faces = [], []
    for axis in range(3):
        for level in (0.0, size):
            side = np.empty((len(u), 3))
            side[:, axis], side[:, (axis + 1) % 3], side[:, (axis + 2) % 3] = level, u, v
            triangles = quads.reshape(-1, 3) + len(u) * len(sides)
            faces.append(triangles if level else triangles[:, ::-1])
            sides.append(side)
    vertices, index = np.unique(np.concatenate(sides), axis=0, return_inverse=True)
    return _mesh(vertices, index.reshape(-1)[np.concatenate(faces)])


def _samples(mesh: TriangleMesh) -> np.ndarray:
    """Points all over the surface: corners, centres, midpoints of sides."""
    corners = mesh.vertices[mesh.faces]
    middles = (corners + np.roll(corners, 1, axis=1)).reshape(-1, 3) / 2
    return np.concatenate([mesh.vertices, mesh.face_centres, middles])


def _edges(mesh: TriangleMesh) -> tuple[np.ndarray, np.ndarray]:
    """Edges, and how many faces have each."""
    return np.unique(np.sort(mesh.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1), axis=0, return_counts=True)


def _euler(mesh: TriangleMesh) -> int:
    return len(mesh.vertices) - len(_edges(mesh)[0]) + len(mesh.faces)


def _volume(mesh: TriangleMesh) -> float:
    a, b, c = (mesh.vertices[mesh.faces[:, corner]] - mesh.bounds[0] for corner in range(3))
    return float((a * np.cross(b, c)).sum() / 6)


def _check(mesh: TriangleMesh, reduced: TriangleMesh, tolerance: float) -> None:
    assert deviation(_samples(mesh), reduced).max() <= tolerance
    assert deviation(_samples(reduced), mesh).max() <= tolerance
    assert (_edges(reduced)[1] == 2).all()
    assert _euler(reduced) == _euler(mesh)
    assert len(np.unique(reduced.faces)) == len(reduced.vertices)


@settings(max_examples=12)
@given(st.integers(0, 10**6), st.floats(0.02, 0.5), st.sampled_from([_bumpy_sphere, _random_field]))
def test_within_tolerance_both_ways_and_closed(seed: int, tolerance: float, shape) -> None:
    mesh = shape(seed)
    _check(mesh, simplified(mesh, tolerance), tolerance)


def test_torus_keeps_its_hole_and_its_volume_and_loses_most_faces() -> None:
    mesh = _torus()
    reduced = simplified(mesh, 0.1)
    _check(mesh, reduced, 0.1)
    assert len(reduced.faces) < len(mesh.faces) / 8
    assert _volume(reduced) == pytest.approx(_volume(mesh), rel=0.02)


@pytest.mark.parametrize("tolerance", [0.0, 0.01])
def test_flat_sides_of_a_box_go_and_its_creases_stay(tolerance: float) -> None:
    mesh = _box(12)
    reduced = simplified(mesh, tolerance)
    _check(mesh, reduced, max(tolerance, 1e-5))
    assert len(reduced.faces) <= 60
    assert deviation(_box(1).vertices, TriangleMesh(reduced.vertices, reduced.faces)).max() <= max(tolerance, 1e-5)
    assert _volume(reduced) == pytest.approx(64, abs=max(tolerance * 96, 1e-4))


def _distances(shape: str, points: np.ndarray) -> np.ndarray:
    """Distances of points ``(..., 3)`` from a ball of 10 mm, a torus, or a box."""
    x, y, z = np.moveaxis(points, -1, 0)
    if shape == "ball":
        return np.sqrt(x**2 + y**2 + z**2) - 10
    if shape == "torus":
        return np.hypot(np.hypot(x, y) - 8, z) - 3.5
    outside = np.abs(points) - (9, 7, 8)
    return np.linalg.norm(np.maximum(outside, 0), axis=-1) + np.minimum(outside.max(axis=-1), 0)


def _extracted(shape: str, noise: float) -> TriangleMesh:
    """A shape as marching cubes give it, with voxels of 0.6 mm."""
    step, count = 0.6, 42
    axis = step * (np.arange(count) - (count - 1) / 2)
    values = _distances(shape, np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1))
    values += np.random.default_rng(0).normal(0, noise, values.shape)
    vertices, faces, _, _ = marching_cubes(values, 0.0)
    return _mesh(step * vertices + axis[0], faces)


def _folds_deg(mesh: TriangleMesh) -> np.ndarray:
    """Angles between the normals of neighbouring faces of a closed mesh."""
    ends = np.sort(mesh.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    face = np.repeat(np.arange(len(mesh.faces)), 3)[np.lexsort(ends.T)].reshape(-1, 2)
    return np.degrees(np.arccos(np.clip((mesh.face_normals[face[:, 0]] * mesh.face_normals[face[:, 1]]).sum(1), -1, 1)))


@pytest.mark.parametrize("tolerance", [0.06, 0.3])
@pytest.mark.parametrize("shape", ["ball", "torus", "box"])
def test_faces_do_not_turn_away_or_fold_over_their_neighbours(shape: str, tolerance: float) -> None:
    mesh = _extracted(shape, 0.02)
    reduced = simplified(mesh, tolerance)
    assert len(reduced.faces) < len(mesh.faces) / 4
    steps = np.eye(3) * 1e-4
    gradient = np.stack(
        [_distances(shape, reduced.face_centres + d) - _distances(shape, reduced.face_centres - d) for d in steps], 1
    )
    turned = np.degrees(np.arccos(np.clip((gradient / 2e-4 * reduced.face_normals).sum(axis=1), -1, 1)))
    near_crease = np.zeros(len(turned), bool)
    if shape == "box":
        near_crease = (np.sort((9, 7, 8) - np.abs(reduced.face_centres), axis=1)[:, 1]) < 1
    assert turned[~near_crease].max() < 40
    sharpest = _folds_deg(mesh).max()
    assert _folds_deg(reduced).max() < max(61, sharpest + 10)


def test_a_sharp_rim_folds_no_more_than_before() -> None:
    # a groove cut into a ball: slivers where the two surfaces meet
    mesh = _extracted("ball", 0.02)
    axis = 0.6 * (np.arange(42) - 20.5)
    points = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1)
    x, y, z = np.moveaxis(points, -1, 0)
    groove = 2.5 - np.sqrt(np.maximum(np.abs(x) - 3, 0) ** 2 + y**2 + (z - 9.5) ** 2)
    vertices, faces, _, _ = marching_cubes(np.maximum(_distances("ball", points), groove), 0.0)
    mesh = _mesh(0.6 * vertices + axis[0], faces)
    tolerance = tolerance_near(mesh, np.array([0.0, 0.0, 9.0]), 5.5, 0.075, 0.3)
    reduced = simplified(mesh, tolerance)
    assert (_folds_deg(reduced) > 100).sum() <= (_folds_deg(mesh) > 100).sum()


def test_blocks_and_threads_keep_the_laws_and_threads_change_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    mesh = _random_field(5)
    for module in (surface_blocks, tolerance_guard):
        monkeypatch.setattr(module, "BLOCK_FACES", 1500)
    assert len(surface_blocks.surface_blocks(mesh.vertices[mesh.faces[:, 0]])) > 5
    found = []
    for threads in (1, 4):
        for module in (reduced_surface, tolerance_guard):
            monkeypatch.setattr(module, "THREADS", threads)
        reduced = simplified(mesh, 0.1)
        found.append(reduced.vertices.tobytes() + reduced.faces.tobytes())
    assert found[0] == found[1]
    _check(mesh, reduced, 0.1)
    monkeypatch.undo()
    assert len(reduced.faces) < 1.05 * len(simplified(mesh, 0.1).faces)


def test_tolerance_zero_takes_nothing_from_a_curved_surface() -> None:
    mesh = _bumpy_sphere(1)
    assert len(simplified(mesh, 0.0).faces) == len(mesh.faces)


def test_each_vertex_has_its_own_tolerance() -> None:
    mesh = _bumpy_sphere(2)
    tolerance = tolerance_near(mesh, np.array([0.0, 0.0, 10.0]), 5.0, 0.01, 0.6)
    reduced = simplified(mesh, tolerance)
    assert (deviation(mesh.vertices, reduced) <= tolerance + 1e-9).all()
    fine, coarse = simplified(mesh, 0.01), simplified(mesh, 0.6)
    near, far = ([(side(m.vertices[:, 2])).sum() for m in (reduced, fine, coarse)] for side in (_above, _below))
    assert near[0] > 0.9 * near[1] > 3 * near[2]
    assert far[0] < 1.5 * far[2] < 0.3 * far[1]


def _above(height: np.ndarray) -> np.ndarray:
    return height > 9


def _below(height: np.ndarray) -> np.ndarray:
    return height < -2


def test_tolerance_near_grows_smoothly_from_near_to_far() -> None:
    line = np.zeros((101, 3))
    line[:, 0] = np.linspace(0, 10, 101)
    values = tolerance_near(_mesh(line, np.array([[0, 1, 2]])), np.zeros(3), 3.0, 0.05, 0.4)
    assert (values[line[:, 0] <= 3] == 0.05).all()
    assert values[line[:, 0] >= 6] == pytest.approx(0.4)
    assert (np.diff(values) >= 0).all()
    # the largest second derivative of a cubic step of this height over 3 mm, in steps of 0.1 mm
    assert np.abs(np.diff(values, 2)).max() < 1.01 * 6 * 0.35 / 3**2 * 0.1**2


def test_a_border_stays() -> None:
    mesh = _random_field(3)
    open_mesh = TriangleMesh(mesh.vertices, mesh.faces[mesh.face_centres[:, 0] < 2.5])
    edges, count = _edges(open_mesh)
    border = open_mesh.vertices[edges[count == 1]].reshape(-1, 6)
    reduced = simplified(open_mesh, 0.1)
    edges, count = _edges(reduced)
    assert len(reduced.faces) < len(open_mesh.faces)
    found = reduced.vertices[edges[count == 1]].reshape(-1, 6)
    assert np.array_equal(np.sort(np.abs(found).sum(axis=1)).round(6), np.sort(np.abs(border).sum(axis=1)).round(6))
    assert deviation(mesh.vertices[np.unique(open_mesh.faces)], reduced).max() <= 0.1


def test_the_same_bytes_again_and_the_same_quality_in_another_order() -> None:
    mesh = _random_field(4)
    reduced, again = simplified(mesh, 0.05), simplified(mesh, 0.05)
    assert reduced.vertices.tobytes() + reduced.faces.tobytes() == again.vertices.tobytes() + again.faces.tobytes()
    rng = np.random.default_rng(0)
    order = rng.permutation(len(mesh.vertices))
    place = np.empty_like(order)
    place[order] = np.arange(len(order))
    shuffled = _mesh(mesh.vertices[order], place[mesh.faces][rng.permutation(len(mesh.faces))])
    assert len(simplified(shuffled, 0.05).faces) == pytest.approx(len(reduced.faces), rel=0.05)


def test_the_same_bytes_on_every_numpy() -> None:
    # shapes from integers alone: other libraries differ between their versions
    noise = np.arange(4096) * 2654435761 % 1000 / 2.5e4
    box = _box(30)
    reduced = simplified(TriangleMesh(box.vertices + np.resize(noise, box.vertices.shape), box.faces), 0.02)
    digest = hashlib.sha256(reduced.vertices.tobytes() + reduced.faces.tobytes()).hexdigest()
    assert (len(reduced.faces), digest[:16]) == (2462, "c38e1b1f7b27ab98")


def test_progress_grows_to_one_and_can_cancel() -> None:
    shares: list[float] = []
    simplified(_torus(), 0.1, progress=shares.append)
    assert shares == sorted(shares)
    assert shares[-1] == 1.0

    def cancel(share: float) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        simplified(_torus(), 0.1, progress=cancel)


@pytest.mark.parametrize("tolerance", [-0.1, np.nan, np.inf, np.zeros(3)])
def test_bad_tolerances_are_refused(tolerance: object) -> None:
    with pytest.raises(InputError, match="tolerance: expected"):
        simplified(_torus(), tolerance)  # type: ignore[arg-type]
