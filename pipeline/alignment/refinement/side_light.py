"""The pose under a light from the side, found in the image, once its shadows are taken into account.

Under a low light most of what an image shows are cast shadows. They lie beside what casts them, all to the same side:
features that know nothing of them fit best at a pose that is too far to that side, and every part of the image agrees.
So the direction is searched under which the surface, with its shadows, explains the image best. Pose and direction are
refined in turn. Where shadows explain little, there is no such light, and nothing changes.
"""

from dataclasses import dataclass, replace

import numpy as np

from ...camera.pinhole import PinholeCamera
from ...light.directional_light import Score, best_direction, directional_light, refined_direction
from ...surface.decimation import cluster_vertices
from ...transforms import transform_points
from .image_pyramid import CELL_PX, PyramidLevel
from .local_search import refine_on_level, score
from .shading_features import Surface
from .verification import mean_distance_px

SEARCH_CELL = 2.0
"""Cells of the surface in the search, relative to those of the coarsest level."""

FIRST_REST, LARGEST_REST = 0.95, 0.85
"""Unexplained variation with shadows, as a fraction of that without, up to which there is a light: after the search of
directions, and after refining them. Reliefs under a sun 25 to 40 degrees high have 0.7 to 0.8, then 0.45 to 0.55; the
sample, bloster and most of LM-O, whose light is broad or next to the lens, 0.95 to 1."""

STEPS_DEG, FINER_STEPS_DEG = (8.0, 4.0), (4.0, 2.0)
"""Steps of the direction, as it is refined after the search: on the coarser surface, then on that of the level."""
ROUNDS_DEG = ((2.0, 1.0), (1.0,), (1.0,))
"""Those in turn with the pose."""
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
        direction, _ = refined_direction(_under(coarse, pose), direction, steps_deg)
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
    direction, best = best_direction(_under(quick, cam_from_model), -middle / np.linalg.norm(middle))
    if 1 - best > FIRST_REST * (1 - score(quick, cam_from_model)):
        return None
    direction, _ = refined_direction(_under(quick, cam_from_model), direction, STEPS_DEG)
    direction, best = refined_direction(_under(level, cam_from_model), direction, FINER_STEPS_DEG)
    return direction if 1 - best <= LARGEST_REST * (1 - score(level, cam_from_model)) else None


def _under(level: PyramidLevel, cam_from_model: np.ndarray) -> Score:
    return lambda direction: score(_lit(level, direction), cam_from_model)


def _lit(level: PyramidLevel, direction: np.ndarray) -> PyramidLevel:
    return replace(level, surface=replace(level.surface, light=directional_light(level.surface.mesh, direction)))
