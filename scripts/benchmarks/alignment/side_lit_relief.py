"""A relief under a low sun, for trials of the refinement: most of what a photograph of it shows is cast shadow.

The features of the refinement know a light next to the lens. Shadows that a low light casts lie beside what casts them,
with the same offset everywhere, and so draw a pose away from the truth: every part of the image agrees with the others.
Needs ``cv2``.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from oneframe.camera.pinhole import PinholeCamera
from oneframe.surface.mesh import TriangleMesh
from oneframe.transforms import rigid, rotation_from_vector

from ..grid_mesh import grid_mesh

SIZE_MM = (230.0, 200.0)
SPACING_MM = 0.6
"""Distance between vertices: the material is as fine as that."""
DISTANCE_MM = 300.0
CAMERA = PinholeCamera(1280, 960, 2600.0, 2594.0, 646.0, 474.0)
ELEVATIONS_DEG = (25.0, 32.0, 40.0)
"""Of the sun above the plane of the relief."""
LARGEST_TILT_DEG = 25.0
LARGEST_ROLL_DEG = 20.0
SMOOTHED_MM = 0.8
"""Standard deviation of the smoothing with which the refinement knows the surface: a scan loses what is finer."""


@dataclass(frozen=True)
class Relief:
    """A relief with its material.

    Attributes
    ----------
    mesh
        In the model frame, mm; z points out of the relief.
    albedo
        ``(V, 3)`` linear RGB.
    known_mesh
        The mesh as a scan gives it: smoother, with fewer vertices, in the same frame.
    """

    mesh: TriangleMesh
    albedo: np.ndarray
    known_mesh: TriangleMesh


@dataclass(frozen=True)
class SideLitShot:
    """A camera and a sun.

    Attributes
    ----------
    name
        Says where the light comes from.
    cam_from_model
        ``(4, 4)``, mm.
    towards_light
        ``(3,)`` unit vector, model frame.
    """

    name: str
    cam_from_model: np.ndarray
    towards_light: np.ndarray


def relief(rng: np.random.Generator) -> Relief:
    """A plate with steep-sided figures of all sizes up to 9 mm high, without any period, and a blotchy material."""
    shape = tuple(int(side / SPACING_MM) + 1 for side in reversed(SIZE_MM))
    height = np.zeros(shape)
    for sigma_mm, rise_mm, steep in ((11.0, 10.0, 6.0), (4.5, 3.0, 6.0), (2.0, 0.3, 1.0)):
        height += rise_mm * (1 + np.tanh(steep * _noise(rng, shape, sigma_mm)))
    height += 0.6 * _noise(rng, shape, 14.0)
    known = cv2.GaussianBlur(height, (0, 0), SMOOTHED_MM / SPACING_MM)
    tint = np.array([0.62, 0.54, 0.44])
    blotches = 0.16 * np.tanh(2 * _noise(rng, shape, 6.0)) + 0.14 * _noise(rng, shape, 1.0)
    patches = 0.25 * (_noise(rng, shape, 8.0) > 0.8)
    albedo = np.clip(tint * (1 + blotches - patches)[..., None], 0.03, 0.95)
    mesh, coarse = _grid(height, SPACING_MM), _grid(known[::2, ::2], 2 * SPACING_MM)
    offset = -coarse.vertices.mean(axis=0)
    return Relief(mesh.moved(offset), albedo.reshape(-1, 3), coarse.moved(offset))


def side_lit_shots(rng: np.random.Generator, count: int) -> tuple[SideLitShot, ...]:
    """Views from above, tilted and rolled at random; the sun goes around and changes its height."""
    shots = []
    for index in range(count):
        tilt_deg, about = rng.uniform(0, LARGEST_TILT_DEG), rng.uniform(0, 2 * np.pi)
        tilt = rotation_from_vector(np.radians(tilt_deg) * np.array([np.cos(about), np.sin(about), 0]))
        roll = rotation_from_vector(np.radians(rng.uniform(-1, 1) * LARGEST_ROLL_DEG) * np.array([0.0, 0, 1]))
        shift = np.append(rng.uniform(-4, 4, 2), DISTANCE_MM * rng.uniform(0.9, 1.1))
        azimuth_deg = 360 * index / count + rng.uniform(0, 360 / count)
        elevation_deg = ELEVATIONS_DEG[index % len(ELEVATIONS_DEG)]
        azimuth, elevation = np.radians([azimuth_deg, elevation_deg])
        sun = np.array([np.cos(azimuth) * np.cos(elevation), np.sin(azimuth) * np.cos(elevation), np.sin(elevation)])
        pose = rigid(roll @ tilt @ np.diag([1.0, -1.0, -1.0]), shift)
        shots.append(SideLitShot(f"sun at {azimuth_deg:.0f}°, {elevation_deg:.0f}° high", pose, sun))
    return tuple(shots)


def _noise(rng: np.random.Generator, shape: tuple[int, ...], sigma_mm: float) -> np.ndarray:
    """Normal, smooth over ``sigma_mm``, with mean 0 and variance 1."""
    smooth = cv2.GaussianBlur(rng.normal(size=shape), (0, 0), sigma_mm / SPACING_MM, borderType=cv2.BORDER_REFLECT)
    return (smooth - smooth.mean()) / smooth.std()


def _grid(height: np.ndarray, spacing_mm: float) -> TriangleMesh:
    rows, columns = height.shape
    x, y = np.meshgrid(np.arange(columns) * spacing_mm, np.arange(rows) * spacing_mm)
    return grid_mesh(np.stack([x, y, height], -1))
