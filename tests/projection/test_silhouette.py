"""Laws of the silhouette: the same pixels as by casting a ray through each pixel, for any mesh and pose."""

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st

from oneframe.camera.pinhole import PinholeCamera
from oneframe.projection.silhouette import (
    SilhouetteEdges,
    canvas,
    silhouette_statistics,
)
from oneframe.surface.mesh import TriangleMesh
from oneframe.transforms import rigid, rotation_from_vector, transform_points

CAMERA = PinholeCamera(width=24, height=16, fx=31.7, fy=29.3, cx=11.2, cy=8.4)

seeds = st.integers(0, 2**32 - 1).map(np.random.default_rng)


def grid_faces(rows: int, columns: int, *, closed: bool) -> np.ndarray:
    """Two triangles per cell of a grid of vertices; closed grids join the last row and column to the first."""
    i, j = np.mgrid[: rows - (not closed), : columns - (not closed)]
    a, b = i * columns + j, i * columns + (j + 1) % columns
    c, d = (i + 1) % rows * columns + j, (i + 1) % rows * columns + (j + 1) % columns
    return np.concatenate([np.stack([a, b, c], -1).reshape(-1, 3), np.stack([b, d, c], -1).reshape(-1, 3)])


def soup(rng: np.random.Generator) -> TriangleMesh:
    """Triangles at random that share vertices, and so edges: open, self-intersecting, wound at random."""
    return TriangleMesh(rng.normal(size=(9, 3)), rng.permuted(np.tile(np.arange(9), (20, 1)), axis=1)[:, :3])


def sphere(rng: np.random.Generator) -> TriangleMesh:
    ball = trimesh.creation.icosphere(subdivisions=1)
    return TriangleMesh(np.array(ball.vertices), ball.faces.astype(np.int32))


def torus(rng: np.random.Generator) -> TriangleMesh:
    u, v = np.meshgrid(np.arange(11) * 2 * np.pi / 11, np.arange(6) * 2 * np.pi / 6, indexing="ij")
    ring = 1 + 0.4 * np.cos(v)
    vertices = np.stack([ring * np.cos(u), ring * np.sin(u), 0.4 * np.sin(v)], -1)
    return TriangleMesh(vertices.reshape(-1, 3), grid_faces(11, 6, closed=True))


def sheet(rng: np.random.Generator) -> TriangleMesh:
    """An open, crumpled sheet with holes."""
    y, x = np.mgrid[-1:1:7j, -1:1:7j]
    vertices = np.stack([x, y, np.zeros_like(x)], -1).reshape(-1, 3) + rng.normal(scale=0.15, size=(49, 3))
    faces = grid_faces(7, 7, closed=False)
    return TriangleMesh(vertices, faces[rng.random(len(faces)) < 0.8])


def book(rng: np.random.Generator) -> TriangleMesh:
    """Non-manifold: many pages on one spine, some twice, some twice with the other side up."""
    vertices = np.concatenate([[[0, 0, -1], [0, 0, 1]], rng.normal(size=(7, 3))])
    pages = np.array([[0, 1, page] for page in range(2, 9)])
    return TriangleMesh(vertices, np.concatenate([pages, pages[:3], pages[1:5, ::-1]]))


SHAPES = [soup, sphere, torus, sheet, book]


def random_pose(rng: np.random.Generator, nearest: float, farthest: float) -> np.ndarray:
    """cam_from_model with the object's centre on the canvas, at a distance between two numbers of radii."""
    z = rng.uniform(nearest, farthest)
    x, y = rng.normal(scale=1.0 + 0.15 * abs(z), size=2)
    return rigid(rotation_from_vector(rng.normal(size=3) * 2), [x, y, z])


in_front = seeds.map(lambda rng: random_pose(rng, 4.5, 9))  # the farthest vertex of a soup lies at about 4
around_the_camera = seeds.map(lambda rng: random_pose(rng, -1, 2))
poses = st.one_of(in_front, around_the_camera)


def ray_cast_mask(mesh: TriangleMesh, cam_from_model: np.ndarray, window: tuple[int, int, int, int]) -> np.ndarray:
    """A ray hits a triangle in front of the camera if it is a positive combination of the three corners."""
    x0, y0, x1, y1 = window
    y, x = np.mgrid[y0:y1, x0:x1]
    rays = CAMERA.rays_cam(np.stack([x, y], -1).astype(float)).reshape(-1, 3)
    a, b, c = (transform_points(cam_from_model, mesh.vertices)[mesh.faces[:, corner]] for corner in range(3))
    determinant = (a * np.cross(b, c)).sum(axis=1)
    hit = np.ones((len(rays), len(mesh.faces)), dtype=bool)
    for p, q in ((b, c), (c, a), (a, b)):
        hit &= rays @ (np.cross(p, q) / determinant[:, None]).T > 0
    return hit.any(axis=1).reshape(x.shape)


@pytest.mark.parametrize("shape", SHAPES)
@given(rng=seeds, pose=poses)
def test_statistics_are_those_of_casting_rays(shape, rng, pose):
    mesh = shape(rng)
    statistics = silhouette_statistics(SilhouetteEdges.of(mesh), CAMERA, pose)
    mask = ray_cast_mask(mesh, pose, canvas(CAMERA))
    width, height = CAMERA.size_wh
    assert statistics.px_count_all == mask.sum()
    assert statistics.px_count_inside == mask[height : 2 * height, width : 2 * width].sum()
    if mask.any():
        y, x = np.nonzero(mask)
        expected = (x.min() - width, y.min() - height, np.ptp(x), np.ptp(y))
    else:
        expected = (-1, -1, -1, -1)
    assert statistics.bbox_obj == expected


@given(seeds)
def test_every_pixel_of_a_tiling_belongs_to_one_tile(rng):
    """Vertices and edges exactly on pixel centres: no pixel twice, none left out, for any order of corners."""
    camera = PinholeCamera(20, 16, 1.0, 1.0, 0.0, 0.0)
    y, x = np.mgrid[0:17:4, 0:21:4].astype(float)
    x[:, 1:-1] += rng.integers(0, 2, x[:, 1:-1].shape)
    y[1:-1] += rng.integers(0, 2, y[1:-1].shape)
    sheet_mesh = TriangleMesh(
        np.stack([x, y, np.zeros_like(x)], -1).reshape(-1, 3),
        rng.permuted(grid_faces(5, 6, closed=False), axis=1),
    )
    pose = rigid(translation=[0, 0, 1])  # a pixel is a millimetre and nothing is rounded
    tiles = [TriangleMesh(sheet_mesh.vertices[face], np.array([[0, 1, 2]])) for face in sheet_mesh.faces]
    counts = [silhouette_statistics(SilhouetteEdges.of(tile), camera, pose).px_count_all for tile in tiles]
    assert sum(counts) == 320
    statistics = silhouette_statistics(SilhouetteEdges.of(sheet_mesh), camera, pose)
    assert (statistics.px_count_all, statistics.bbox_obj) == (320, (0, 0, 19, 15))
