"""Grids in any direction, balls, and what every surface of a solid obeys."""

from collections.abc import Callable

import numpy as np
import trimesh

from oneframe.surface.mesh import TriangleMesh
from oneframe.transforms import transform_points
from oneframe.volume.bone.isosurface import RemovedField
from oneframe.volume.drill.virtual_drill import FAR_MM
from oneframe.volume.volume import Volume, VoxelGrid


def oblique_grid(rng: np.random.Generator, spacing: float | np.ndarray, size: int) -> VoxelGrid:
    """A cube of voxels around the origin in a random direction, which may be left-handed."""
    matrix = np.eye(4)
    matrix[:3, :3] = np.linalg.qr(rng.normal(size=(3, 3)))[0] * spacing
    matrix[:3, 3] = -matrix[:3, :3] @ np.full(3, (size - 1) / 2)
    return VoxelGrid((size, size, size), matrix)


def voxel_centres(grid: VoxelGrid) -> np.ndarray:
    """``(Z, Y, X, 3)``, mm."""
    z, y, x = np.indices(grid.size[::-1]).reshape(3, -1)
    points = transform_points(grid.mesh_from_index, np.stack([x, y, z], axis=1).astype(np.float64))
    return points.reshape(*grid.size[::-1], 3)


def ball(radius: float, centre: np.ndarray, subdivisions: int = 3) -> TriangleMesh:
    sphere = trimesh.creation.icosphere(subdivisions, radius)
    return TriangleMesh(np.asarray(sphere.vertices) + centre, np.asarray(sphere.faces, np.int32))


def is_closed(mesh: TriangleMesh) -> bool:
    """Whether every edge has exactly two faces, which run along it in opposite directions."""
    faces, count = mesh.faces.astype(np.int64), len(mesh.vertices)
    following = np.roll(faces, -1, axis=1)
    there, back = np.sort((faces * count + following).ravel()), np.sort((following * count + faces).ravel())
    return bool((np.diff(there) > 0).all() and (there == back).all())


def enclosed_mm3(mesh: TriangleMesh) -> float:
    """Positive if fronts face outward."""
    return float(np.einsum("ij,ij->", mesh.vertices[mesh.faces[:, 0]], mesh.face_cross) / 6)


def check_crop(whole: Volume, part: Volume) -> None:
    """Every voxel of a part of a volume lies where the whole has it."""
    index = transform_points(whole.grid.index_from_mesh, voxel_centres(part.grid).reshape(-1, 3))
    x, y, z = np.rint(index).astype(int).T
    np.testing.assert_allclose(index, np.rint(index), atol=1e-4)
    np.testing.assert_array_equal(part.values.ravel(), whole.values[z, y, x])


def whole(field: RemovedField | None, grid: VoxelGrid) -> np.ndarray:
    """The distance field of a drill on the whole grid."""
    distance = np.full(grid.size[::-1], FAR_MM)
    if field is not None:
        part = tuple(slice(a, a + n) for a, n in zip(field.first[::-1], field.distance_mm.shape, strict=True))
        distance[part] = field.distance_mm
    return distance


def scanned(distance: Callable[[np.ndarray], np.ndarray], grid: VoxelGrid) -> np.ndarray:
    """``(Z, Y, X)`` int16 HU of a solid, as a scanner blurs it: they rise over two voxels."""
    width, height, depth = grid.size
    values = np.empty((depth, height, width), np.int16)
    y, x = np.mgrid[:height, :width].astype(np.float64)
    for z in range(depth):
        index = np.stack([x.ravel(), y.ravel(), np.full(x.size, float(z))], axis=1)
        points = transform_points(grid.mesh_from_index, index)
        hu = 300.0 - distance(points) / max(grid.spacing_mm) * 800
        values[z] = np.clip(hu, -1000, 1600).reshape(height, width)
    return values
