"""A light from afar: what it reaches past the surface's own shadows, and the search of its direction."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..camera.pinhole import PinholeCamera
from ..projection.z_buffer import inverse_depth_of
from ..surface.mesh import TriangleMesh
from ..transforms import rigid

TEXELS_PER_FACE = 4.0
MAP_TEXELS = (48**2, 512**2)
"""Least and most texels of a map."""
FAR = 1000.0
"""Distance of the map's camera, in diagonals of the surface: its rays are parallel to 0.03 degrees."""
BIAS = 0.35
"""How far behind the nearest surface a face still counts as lit, in texels: faces are not flat over a texel."""
STEEPEST = 10.0
"""Largest slope of a face against the light whose own plane is taken into account."""

ANGLES_DEG, TURNS = (35.0, 60.0, 77.0), 12
"""Angles of the searched directions from the one towards the lens, and their number at each."""

Score = Callable[[np.ndarray], float]
"""How well an image is explained under a light from a direction, a ``(3,)`` unit vector."""


@dataclass(frozen=True)
class DirectionalLight:
    """A light far away from a surface.

    Attributes
    ----------
    towards_light
        ``(3,)`` unit vector, model frame.
    lit
        ``(F,)`` 0..1: how much of each face the light reaches past the other faces.
    """

    towards_light: np.ndarray
    lit: np.ndarray


def directional_light(mesh: TriangleMesh, towards_light: np.ndarray) -> DirectionalLight:
    """The light from a direction, a ``(3,)`` unit vector in the frame of the mesh, and the shadows that it casts."""
    x = np.cross(np.eye(3)[np.argmin(np.abs(towards_light))], towards_light)
    x /= np.linalg.norm(x)
    rotation = np.stack([x, np.cross(-towards_light, x), -towards_light])
    points = mesh.vertices @ rotation.T
    low, high = points.min(axis=0), points.max(axis=0)
    extent = np.maximum(high - low, 1e-9)
    texel_mm = float(np.sqrt(extent[0] * extent[1] / np.clip(TEXELS_PER_FACE * len(mesh.faces), *MAP_TEXELS)))
    # a surface seen edge-on by the light is long and thin
    texel_mm = max(texel_mm, float(extent[:2].max()) / MAP_TEXELS[1] ** 0.5 / 4)
    width, height = (int(np.ceil(side / texel_mm)) + 1 for side in extent[:2])
    far = FAR * float(np.linalg.norm(extent))
    light_from_model = rigid(rotation, np.append(-low[:2], far - low[2]))
    camera = PinholeCamera(width, height, far / texel_mm, far / texel_mm, 0.0, 0.0)
    inverse = inverse_depth_of(mesh, camera, light_from_model)
    nearest = np.divide(1.0, inverse, out=np.full_like(inverse, np.inf), where=inverse > 0) - far + low[2]

    corners = points[mesh.faces]
    middle = corners.mean(axis=1, keepdims=True)
    samples = np.concatenate([middle, 0.4 * middle + 0.6 * corners], axis=1)
    normal = mesh.face_cross @ rotation.T
    facing = np.copysign(np.maximum(np.abs(normal[:, 2]), np.linalg.norm(normal, axis=1) / STEEPEST), normal[:, 2])
    slope = -normal[:, :2] / np.where(facing == 0, 1.0, facing)[:, None]
    place = (samples[..., :2] - low[:2]) / texel_mm
    texel = np.clip(np.rint(place), 0, [width - 1, height - 1])
    # the map holds depths at the middle of texels: there the face's own plane is compared with it
    depth = samples[..., 2] + ((texel - place) * texel_mm * slope[:, None]).sum(axis=2)
    u, v = np.moveaxis(texel.astype(int), 2, 0)
    slack = BIAS * texel_mm * (1 + np.linalg.norm(slope, axis=1))
    return DirectionalLight(towards_light, (depth <= nearest[v, u] + slack[:, None]).mean(axis=1))


def best_direction(score: Score, towards_lens: np.ndarray) -> tuple[np.ndarray, float]:
    """The best of directions all around the one towards the lens, and its score."""
    directions = [
        _turned(towards_lens, angle_deg, 360 * turn / TURNS) for angle_deg in ANGLES_DEG for turn in range(TURNS)
    ]
    scores = [score(direction) for direction in directions]
    return directions[int(np.argmax(scores))], max(scores)


def refined_direction(score: Score, direction: np.ndarray, steps_deg: tuple[float, ...]) -> tuple[np.ndarray, float]:
    """The best direction in reach of ever smaller steps, and its score."""
    best = score(direction)
    for step_deg in steps_deg:
        while True:
            around = [_turned(direction, step_deg, turn) for turn in range(0, 360, 90)]
            scores = [score(each) for each in around]
            if max(scores) <= best:
                break
            best, direction = max(scores), around[int(np.argmax(scores))]
    return direction, best


def _turned(direction: np.ndarray, angle_deg: float, around_deg: float) -> np.ndarray:
    """A unit vector at an angle from another, on the side of it that ``around_deg`` says."""
    x = np.cross(np.eye(3)[np.argmin(np.abs(direction))], direction)
    x /= np.linalg.norm(x)
    angle, around = np.radians([angle_deg, around_deg])
    sideways = np.cos(around) * x + np.sin(around) * np.cross(direction, x)
    return np.cos(angle) * direction + np.sin(angle) * sideways
