"""A light from the side, found in the image: its direction, and the pose once its shadows are taken into account.

Under a low light most of what an image shows are cast shadows. They lie beside what casts them, all to the same side:
features that know nothing of them fit best at a pose that is too far to that side, and every part of the image agrees.
So the direction is searched under which the surface, with its shadows, explains the image best. Pose and direction are
refined in turn. Where shadows explain little, there is no such light, and nothing changes.
"""

from dataclasses import dataclass, replace

import numpy as np

from ...camera.pinhole import PinholeCamera
from ...projection.z_buffer import inverse_depth_of
from ...surface.decimation import cluster_vertices
from ...surface.mesh import TriangleMesh
from ...transforms import rigid, transform_points
from .image_pyramid import CELL_PX, PyramidLevel
from .local_search import refine_on_level, score
from .shading_features import DirectionalLight, Surface
from .verification import mean_distance_px

TEXELS_PER_FACE = 4.0
MAP_TEXELS = (48**2, 512**2)
"""Least and most texels of a map."""
FAR = 1000.0
"""Distance of the map's camera, in diagonals of the surface: its rays are parallel to 0.03 degrees."""
BIAS = 0.35
"""How far behind the nearest surface a face still counts as lit, in texels: faces are not flat over a texel."""
STEEPEST = 10.0
"""Largest slope of a face against the light whose own plane is taken into account."""


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


ANGLES_DEG, TURNS = (35.0, 60.0, 77.0), 12
"""Angles of the searched directions from the view ray, and their number at each."""

SEARCH_CELL = 2.0
"""Cells of the surface in the search, relative to those of the coarsest level."""

FIRST_REST, LARGEST_REST = 0.95, 0.85
"""Unexplained variation with shadows, as a fraction of that without, up to which there is a light: after the search of
directions, and after refining them. Reliefs under a sun 25 to 40 degrees high have 0.7 to 0.8, then 0.45 to 0.55; the
sample, bloster and most of LM-O, whose light is broad or next to the lens, 0.95 to 1."""

STEPS_DEG, FINER_STEPS_DEG = (8.0, 4.0), (4.0, 2.0)
"""Of the direction, as it is refined after the search: on the coarser surface, then on that of the level."""
ROUNDS_DEG = ((2.0, 1.0), (1.0,), (1.0,))
"""The same in turn with the pose."""
RENDERINGS = 2
"""Renderings of the pose's refinement between."""

KNOWN_BIAS = 0.5
"""Error of a pose under a light, as a fraction of how far its shadows would draw it if they were not modelled."""
LEAST_BIAS_LEVEL_PX = 0.7
"""Least error of a pose that rests on shadows, in pixels of the finest level: on reliefs known from a smoothed scan the
poses were off by 0.4 to 0.75, all away from the light, since a smoothed rim casts a shorter shadow."""


@dataclass(frozen=True)
class SideLight:
    """A pose that takes the shadows of a light into account.

    Attributes
    ----------
    levels
        The pyramid, with the light on its surfaces; coarse to fine.
    cam_from_model
        ``(4, 4)`` the refined pose.
    bias_px
        Estimate of the error that all parts of the image share, because shape and light are not known exactly; mean
        displacement, pixels of the full image.
    """

    levels: list[PyramidLevel]
    cam_from_model: np.ndarray
    bias_px: float


def refined_under_side_light(
    levels: list[PyramidLevel], cam_from_model: np.ndarray, points_model: np.ndarray, camera: PinholeCamera
) -> SideLight | None:
    """Find a light from the side, and refine a pose under it.

    Parameters
    ----------
    levels
        Coarse to fine.
    cam_from_model
        ``(4, 4)`` a pose refined without shadows.
    points_model
        ``(N, 3)`` visible points, mm.
    camera
        Intrinsics of the full image.

    Returns
    -------
    The light and the pose; ``None`` if shadows explain too little of the image.
    """
    coarse = levels[0]
    direction = _found_direction(coarse, cam_from_model, points_model)
    if direction is None:
        return None
    pose = cam_from_model
    lit = [_lit(level, direction) for level in levels]
    for level in lit[:-1]:
        pose = _refined(level, pose)
    for steps_deg in ROUNDS_DEG:
        pose = _refined(lit[-1], pose, RENDERINGS)
        direction, _ = _refined_direction(coarse, pose, direction, steps_deg)
        lit = [_lit(level, direction) for level in levels]
    pose = _refined(lit[-1], pose)
    drawn_px = mean_distance_px(camera, points_model, pose, _refined(levels[-1], pose))
    return SideLight(lit, pose, max(KNOWN_BIAS * drawn_px, LEAST_BIAS_LEVEL_PX * levels[-1].px))


def _refined(level: PyramidLevel, cam_from_model: np.ndarray, renderings: int = 8) -> np.ndarray:
    found = refine_on_level(level, cam_from_model, renderings=renderings)
    return cam_from_model if found is None else found.cam_from_model


def _found_direction(level: PyramidLevel, cam_from_model: np.ndarray, points_model: np.ndarray) -> np.ndarray | None:
    cell_mm = SEARCH_CELL * CELL_PX * float(np.median(transform_points(cam_from_model, points_model)[:, 2]))
    mesh, colours = cluster_vertices(level.surface.mesh, cell_mm / level.camera.fx, level.surface.colours)
    quick = replace(level, surface=Surface(mesh, colours))
    middle = cam_from_model[:3, :3].T @ transform_points(cam_from_model, points_model).mean(axis=0)
    towards_lens = -middle / np.linalg.norm(middle)
    directions = [
        _turned(towards_lens, angle_deg, 360 * turn / TURNS) for angle_deg in ANGLES_DEG for turn in range(TURNS)
    ]
    scores = [score(_lit(quick, direction), cam_from_model) for direction in directions]
    if 1 - max(scores) > FIRST_REST * (1 - score(quick, cam_from_model)):
        return None
    direction, _ = _refined_direction(quick, cam_from_model, directions[int(np.argmax(scores))], STEPS_DEG)
    direction, best = _refined_direction(level, cam_from_model, direction, FINER_STEPS_DEG)
    return direction if 1 - best <= LARGEST_REST * (1 - score(level, cam_from_model)) else None


def _refined_direction(
    level: PyramidLevel, cam_from_model: np.ndarray, direction: np.ndarray, steps_deg: tuple[float, ...]
) -> tuple[np.ndarray, float]:
    """The best direction in reach of ever smaller steps, and its score."""
    best = score(_lit(level, direction), cam_from_model)
    for step_deg in steps_deg:
        while True:
            around = [_turned(direction, step_deg, turn) for turn in range(0, 360, 90)]
            scores = [score(_lit(level, each), cam_from_model) for each in around]
            if max(scores) <= best:
                break
            best, direction = max(scores), around[int(np.argmax(scores))]
    return direction, best


def _lit(level: PyramidLevel, direction: np.ndarray) -> PyramidLevel:
    return replace(level, surface=replace(level.surface, light=directional_light(level.surface.mesh, direction)))


def _turned(direction: np.ndarray, angle_deg: float, around_deg: float) -> np.ndarray:
    """A unit vector at an angle from another, on the side of it that ``around_deg`` says."""
    x = np.cross(np.eye(3)[np.argmin(np.abs(direction))], direction)
    x /= np.linalg.norm(x)
    angle, around = np.radians([angle_deg, around_deg])
    sideways = np.cos(around) * x + np.sin(around) * np.cross(direction, x)
    return np.cos(angle) * direction + np.sin(angle) * sideways
