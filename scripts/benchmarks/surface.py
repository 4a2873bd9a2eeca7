"""The surface from CT on volumes whose surface is known: error and time.

Errors are distances from the analytic surface in voxels: the largest distance between neighbouring ones counts as one.
"""

import argparse
import os
import platform
import time
from collections.abc import Callable, Mapping

import numpy as np

from oneframe.transforms import transform_points
from oneframe.volume.bone.isosurface import isosurface
from oneframe.volume.volume import VoxelGrid

from .figures import write_figures

QUICK = {"size": 160, "rounds": 1}
LEVEL_HU = 300.0
SPACING_MM = (0.5, 0.5, 0.8)

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


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this topic."""
    parser.add_argument("--size", metavar="N", type=int, default=200, help="voxels a side of the shapes, from 160")
    parser.add_argument("--rounds", metavar="N", type=int, default=3)


def measure(arguments: argparse.Namespace, report: Callable[[str], None]) -> None:
    """Measure the shapes."""
    figures: dict[str, object] = {
        "machine": {"processors": os.cpu_count(), "python": platform.python_version(), "numpy": np.__version__},
        "size": arguments.size, "rounds": arguments.rounds,
        "shapes": measure_shapes(arguments.size, arguments.rounds, report),
    }  # fmt: skip
    write_figures(arguments.out, figures)


def measure_shapes(size: int, rounds: int, report: Callable[[str], None]) -> list[dict[str, object]]:
    """Extract every shape from a volume of ``size`` voxels a side.

    Returns
    -------
    For each shape the distances of the vertices from the analytic surface, voxels, and the median time.
    """
    found = []
    grid = centred_grid(size, SPACING_MM)
    for shape, distance in SHAPES.items():
        values, seconds = scanned(distance, grid), []
        for _ in range(rounds):
            begin = time.perf_counter()
            vertices = isosurface(values, LEVEL_HU, grid).mesh.vertices
            seconds.append(time.perf_counter() - begin)
        error: np.ndarray = np.abs(distance(vertices)) / max(SPACING_MM)
        figures = {
            "mean_voxels": float(error.mean()), "p99_voxels": float(np.percentile(error, 99)),
            "largest_voxels": float(error.max()), "seconds": float(np.median(seconds)),
        }  # fmt: skip
        found.append({"shape": shape, **figures})
        report(f"{shape}: " + ", ".join(f"{name} {value:.4f}" for name, value in figures.items()))
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
