"""The rim of a drilled surface, against the crease of a ball and a capsule in closed form."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from oneframe.surface.deviation import deviation
from oneframe.volume.bone.bone_surface import smoothed
from oneframe.volume.bone.isosurface import Isosurface, RemovedField, isosurface
from oneframe.volume.bone.rim import with_sharp_rim
from oneframe.volume.volume import VoxelGrid
from tests.volume.solids import is_closed, oblique_grid, voxel_centres

SIZE, SPACING = 56, 0.4
BALL_MM, BURR_MM = 9.0, 4.0
START, END = np.array([2.0, -3.0, 7.0]), np.array([5.0, 4.0, 6.5])


def ball(points: np.ndarray) -> np.ndarray:
    return np.linalg.norm(points, axis=1) - BALL_MM


def burr(points: np.ndarray) -> np.ndarray:
    along = np.clip((points - START) @ (END - START) / ((END - START) @ (END - START)), 0, 1)
    return np.linalg.norm(points - (START + along[:, None] * (END - START)), axis=1) - BURR_MM


def gradient(distance, points: np.ndarray) -> np.ndarray:
    return np.stack([distance(points + step) - distance(points - step) for step in np.eye(3) * 1e-5], axis=1) / 2e-5


def crease() -> np.ndarray:
    """Points of the curve on both surfaces, by Newton's method from points all around it."""
    points = (START + END) / 2 + 4 * np.random.default_rng(0).normal(size=(400, 3))
    for _ in range(30):
        rest = np.stack([ball(points), burr(points)], axis=1)
        slopes = np.stack([gradient(ball, points), gradient(burr, points)], axis=1)
        points = points - np.einsum("nij,nj->ni", np.linalg.pinv(slopes), rest)
    return points[np.abs(ball(points)) + np.abs(burr(points)) < 1e-6]


def drilled_ball(seed: int, noise_hu: float) -> tuple[Isosurface, RemovedField, VoxelGrid]:
    rng = np.random.default_rng(seed)
    grid = oblique_grid(rng, SPACING, SIZE)
    points = voxel_centres(grid).reshape(-1, 3)
    values = 300 - np.clip(ball(points) / (1.4 * SPACING), -1, 1) * 900 + rng.normal(0, noise_hu, len(points))
    removed = RemovedField(np.zeros(3, int), burr(points).astype(np.float32).reshape((SIZE,) * 3))
    surface = isosurface(values.astype(np.int16).reshape((SIZE,) * 3), 300, grid, removed=removed)
    return surface, removed, grid


def test_rim_is_the_crease_of_ball_and_burr():
    surface, removed, grid = drilled_ball(1, noise_hu=35)
    sharp = with_sharp_rim(surface, removed, grid)
    assert is_closed(sharp.mesh)
    count = len(surface.mesh.vertices)
    np.testing.assert_array_equal(sharp.mesh.vertices[:count], surface.mesh.vertices)
    # where no crease was found, a vertex may lie on bone that the burr did not reach
    assert np.abs(burr(sharp.mesh.vertices[sharp.drilled])).max() < 0.15 * SPACING
    assert sharp.drilled[count:].mean() > 0.9
    points = crease()
    assert len(points) > 100
    # marching cubes cuts it off by 0.3 voxels, and smoothing by 0.4
    for before, after in ((surface, sharp), (smoothed(surface), smoothed(sharp))):
        cut_off = deviation(points, before.mesh).mean() / SPACING
        assert cut_off > 0.25
        assert deviation(points, after.mesh).mean() < cut_off / 8
    made = sharp.mesh.vertices[count:]
    # of trilinear interpolation of the distance to a ball of this radius
    bound = 2 * SPACING**2 / (8 * BURR_MM)
    assert np.median(np.abs(burr(made))) < bound
    # nothing is drilled deeper than before
    assert burr(made).min() > -2 * bound


@settings(max_examples=12)
@given(st.integers(0, 2**32 - 1))
def test_rim_of_noise_stays_closed_and_near_its_faces(seed):
    rng = np.random.default_rng(seed)
    values = rng.normal(size=rng.integers(2, 8, 3))
    grid = VoxelGrid(values.shape[::-1], np.eye(4))
    removed = RemovedField(np.zeros(3, int), rng.normal(size=values.shape).astype(np.float32))
    surface = isosurface(values, 0, grid, removed=removed)
    sharp = with_sharp_rim(surface, removed, grid)
    assert is_closed(sharp.mesh)
    assert np.isfinite(sharp.mesh.vertices).all()
    if len(sharp.mesh.vertices) > len(surface.mesh.vertices):
        assert deviation(sharp.mesh.vertices, surface.mesh).max() < 2.1
