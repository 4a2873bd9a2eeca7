"""The surface from CT on volumes whose surface is known: error and time beside scikit-image's, in alternating rounds.

Errors are distances from the analytic surface in voxels: the largest distance between neighbouring ones counts as one.
"""

import time
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
from skimage.measure import marching_cubes

from oneframe.transforms import transform_points
from oneframe.volume.bone.isosurface import isosurface
from oneframe.volume.volume import VoxelGrid

LEVEL_HU = 300.0
SPACING_MM = (0.5, 0.5, 0.8)
NOISE_HU = 25.0

OURS, PEER = "OneFrame", "scikit-image"

Distance = Callable[[np.ndarray], np.ndarray]
"""Signed distance of points ``(N, 3)``, negative inside, mm."""


def sphere(points: np.ndarray) -> np.ndarray:
    """A ball with a radius of 38 mm."""
    return np.linalg.norm(points - (0.13, -0.21, 0.07), axis=1) - 38.0


def box(points: np.ndarray) -> np.ndarray:
    """A box of 60 x 50 x 40 mm."""
    away: np.ndarray = np.abs(points - (0.13, -0.21, 0.07)) - (30.0, 25.0, 20.0)
    return np.linalg.norm(np.maximum(away, 0), axis=1) + np.minimum(away.max(axis=1), 0)


def torus(points: np.ndarray) -> np.ndarray:
    """A torus with radii of 28 and 10 mm."""
    x, y, z = (points - (0.13, -0.21, 0.07)).T
    return np.hypot(np.hypot(x, y) - 28.0, z) - 10.0


SHAPES: Mapping[str, Distance] = {"sphere": sphere, "box": box, "torus": torus}


def measure_shapes(size: int, rounds: int, report: Callable[[str], None]) -> list[dict[str, object]]:
    """Extract every shape from a volume of ``size`` voxels a side, by both programs in turn.

    Returns
    -------
    For each shape and program the distances of the vertices from the analytic surface, voxels, and the median time.
    """
    found = []
    grid = centred_grid(size, SPACING_MM)
    for shape, distance in SHAPES.items():
        values = scanned(distance, grid)
        seconds: dict[str, list[float]] = {OURS: [], PEER: []}
        vertices: dict[str, np.ndarray] = {}
        for _ in range(rounds):
            for program, extract in ((OURS, _ours), (PEER, _peers)):
                begin = time.perf_counter()
                vertices[program] = extract(values, grid)
                seconds[program].append(time.perf_counter() - begin)
        for program in seconds:
            error: np.ndarray = np.abs(distance(vertices[program])) / max(SPACING_MM)
            figures = {
                "mean_voxels": float(error.mean()), "p99_voxels": float(np.percentile(error, 99)),
                "largest_voxels": float(error.max()), "seconds": float(np.median(seconds[program])),
            }  # fmt: skip
            found.append({"shape": shape, "program": program, **figures})
            report(f"{shape}, {program}: " + ", ".join(f"{name} {value:.4f}" for name, value in figures.items()))
    return found


def centred_grid(size: int, spacing_mm: tuple[float, float, float]) -> VoxelGrid:
    """``size`` voxels a side around the origin."""
    matrix = np.diag([*spacing_mm, 1.0])
    matrix[:3, 3] = -(size - 1) / 2 * np.array(spacing_mm)
    return VoxelGrid((size, size, size), matrix)


def scanned(distance: Distance, grid: VoxelGrid) -> np.ndarray:
    """``(Z, Y, X)`` int16 HU of a solid, as a scanner blurs it: they rise over two voxels."""
    width, height, depth = grid.size
    values = np.empty((depth, height, width), np.int16)
    y, x = np.mgrid[:height, :width].astype(np.float64)
    for z in range(depth):
        index = np.stack([x.ravel(), y.ravel(), np.full(x.size, float(z))], axis=1)
        points = transform_points(grid.mesh_from_index, index)
        hu = LEVEL_HU - distance(points) / max(grid.spacing_mm) * 800
        values[z] = np.clip(hu, -1000, 1600).reshape(height, width)
    return values


def write_synthetic_bone(path: Path, size: int, spacing_mm: float, rng: np.random.Generator) -> None:
    """Write a CT (.mha) of a ball of bone full of air cells, with noise: millions of faces, as a real one has."""
    coarse = 24
    cells = rng.normal(size=(coarse + 1,) * 3).astype(np.float32)
    at = np.linspace(0, coarse - 1e-3, size, dtype=np.float32)
    low, share = at.astype(np.intp), at - np.floor(at)
    place = (np.arange(size, dtype=np.float32) - (size - 1) / 2) * spacing_mm
    radius = 0.38 * size * spacing_mm
    header = (
        "ObjectType = Image\nNDims = 3\nBinaryData = True\nBinaryDataByteOrderMSB = False\nCompressedData = False\n"
        "TransformMatrix = 1 0 0 0 1 0 0 0 1\nOffset = 0 0 0\n"
        f"ElementSpacing = {spacing_mm} {spacing_mm} {spacing_mm}\n"
        f"DimSize = {size} {size} {size}\nElementType = MET_SHORT\nElementDataFile = LOCAL\n"
    )
    with path.open("wb") as file:
        file.write(header.encode())
        for z in range(size):
            layer = cells[low[z]] * (1 - share[z]) + cells[low[z] + 1] * share[z]
            rows = layer[low] * (1 - share[:, None]) + layer[low + 1] * share[:, None]
            noise = rows[:, low] * (1 - share) + rows[:, low + 1] * share
            depth = np.sqrt(place[z] ** 2 + place[:, None] ** 2 + place**2) - radius
            depth = np.where(depth < -2, np.maximum(depth, 2 * (0.6 - np.abs(noise))), depth)
            hu = np.clip(LEVEL_HU - depth / spacing_mm * 800, -1000, 1600) + rng.normal(0, NOISE_HU, depth.shape)
            file.write(np.rint(hu).astype("<i2").tobytes())


def _ours(values: np.ndarray, grid: VoxelGrid) -> np.ndarray:
    return isosurface(values, LEVEL_HU, grid).mesh.vertices


def _peers(values: np.ndarray, grid: VoxelGrid) -> np.ndarray:
    # as ours: no voxel lies on the level
    vertices, _, _, _ = marching_cubes(values, LEVEL_HU + 0.5)
    return transform_points(grid.mesh_from_index, vertices[:, ::-1].astype(np.float64))
