"""Propose poses of a surface from the frame alone: the three best of a search over all poses, refined.

A tiny image is searched everywhere (:mod:`.template_search`). The best distinct poses are then refined by the local
search of :mod:`..refinement`, which also scores them by all its features. Nothing is verified: the user chooses. Needs
``cv2``.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from ...camera.pinhole import PinholeCamera
from ...projection.z_buffer import inverse_depth_of
from ...surface.decimation import cluster_vertices
from ...surface.mesh import TriangleMesh
from ...transforms import rotation_angle_deg
from ..refinement.image_pyramid import WINDOW, PyramidLevel, reduced_image
from ..refinement.local_search import refine_on_level
from ..refinement.shading_features import Surface
from .template_search import TEMPLATE_PX, in_threads, search_everywhere

PROPOSALS = 3
"""Poses that are proposed."""

REFINED, RENDERINGS = (120, 10), (4, 8)
"""Poses that are refined, and their most renderings: those of the search, and the best of them on a finer image.

Where the truth has a place on the grid of the search is chance: on renderings of temporal bones it was among the best
24 in 2 of 12 frames. Refined, it explains three to ten times as much as the others."""

REFINED_PX = 56, 96
"""The shorter sides of the images in which they are refined."""

APART_DEG, APART_SHARE = 12.0, 0.1
"""Two poses are distinct if they differ by this rotation, or by this share of the distance or of the image's side."""

SEARCH_SHARE, REFINED_SHARES = 0.45, (0.4, 0.15)
"""Shares of the time, about."""


@dataclass(frozen=True)
class Proposal:
    """A proposed pose.

    Attributes
    ----------
    cam_from_model
        ``(4, 4)``, mm.
    explained
        Fraction, 0..1, of the image's local variation that the surface explains where it lies.
    score
        That fraction weighted with the area that it holds for, a log-likelihood ratio: the larger the better. Of one
        frame, scores of poses compare.
    """

    cam_from_model: np.ndarray
    explained: float
    score: float


def propose_poses(
    image: np.ndarray,
    valid: np.ndarray,
    camera: PinholeCamera,
    mesh: TriangleMesh,
    *,
    progress: Callable[[float], None] | None = None,
) -> tuple[Proposal, ...]:
    """At most :data:`PROPOSALS` distinct poses, the best first; none if the image shows no detail.

    Parameters
    ----------
    image
        ``(H, W, 3)`` or ``(H, W, 1)`` undistorted frame, float32 0..1.
    valid
        ``(H, W)`` bool: pixels that may be used.
    camera
        Intrinsics of the undistorted frame.
    mesh
        In the model frame, mm, with the origin near its middle; between half and about three times as large as the
        frame.
    progress
        Called with the fraction done, 0..1; an exception that it raises ends the search.
    """
    report = progress or (lambda fraction: None)
    coarse, _ = cluster_vertices(mesh, 2 * mesh.radius / TEMPLATE_PX)
    surface = Surface(coarse)
    found = search_everywhere(image, valid, camera, surface, progress=_part(report, 0.0, SEARCH_SHARE))
    poses = [each.cam_from_model for each in found if each.score > 0]
    proposals: list[Proposal] = []
    done = SEARCH_SHARE
    for side, most, renderings, share in zip(REFINED_PX, REFINED, RENDERINGS, REFINED_SHARES, strict=True):
        level = _level(image, valid, camera, surface, side)
        starts = _distinct(poses, camera, most)
        refined = in_threads(partial(_refined, level, renderings=renderings), starts, _part(report, done, share))
        done += share
        proposals = sorted((each for each in refined if each is not None), key=lambda each: -each.score)
        poses = [each.cam_from_model for each in proposals]
    kept = _distinct(poses, camera, PROPOSALS)
    report(1.0)
    return tuple(each for each in proposals if any(each.cam_from_model is pose for pose in kept))


def _part(report: Callable[[float], None], begin: float, share: float) -> Callable[[float], None]:
    """The progress of a part of the work."""
    return lambda fraction: report(begin + share * fraction)


def _level(image: np.ndarray, valid: np.ndarray, camera: PinholeCamera, surface: Surface, side: int) -> PyramidLevel:
    """The whole image, small; the window of local means is set for each pose."""
    factor = min(side / min(camera.size_wh), 1.0)
    small = camera.resized(round(camera.width * factor), round(camera.height * factor))
    reduced, used = reduced_image(image, valid, small.size_wh)
    return PyramidLevel(small, reduced, used, surface, 1.0, 1 / factor)


def _refined(level: PyramidLevel, start: np.ndarray, renderings: int) -> Proposal | None:
    """The local maximum near a pose; ``None`` if the image shows too little of the surface."""
    area = _area(level, start)
    if not area:
        return None
    level = replace(level, window_px=WINDOW * np.sqrt(area))
    result = refine_on_level(level, start, renderings=renderings)
    if result is None:
        return None
    ratio = -_area(level, result.cam_from_model) * np.log1p(-min(result.score, 0.999))
    return Proposal(result.cam_from_model, result.score, float(ratio))


def _area(level: PyramidLevel, cam_from_model: np.ndarray) -> int:
    """Usable pixels of the level that show the surface."""
    seen = inverse_depth_of(level.surface.mesh, level.camera, cam_from_model) > 0
    return int(np.count_nonzero(seen & level.valid))


def _distinct(poses: list[np.ndarray], camera: PinholeCamera, most: int) -> list[np.ndarray]:
    """The first poses, without those that are close to an earlier one."""
    kept: list[np.ndarray] = []
    for pose in poses:
        if len(kept) == most:
            break
        if not any(_close(pose, other, camera) for other in kept):
            kept.append(pose)
    return kept


def _close(a: np.ndarray, b: np.ndarray, camera: PinholeCamera) -> bool:
    if rotation_angle_deg(a[:3, :3] @ b[:3, :3].T) > APART_DEG:
        return False
    if abs(np.log(a[2, 3] / b[2, 3])) > APART_SHARE:
        return False
    shift = camera.project(a[None, :3, 3]) - camera.project(b[None, :3, 3])
    return float(np.linalg.norm(shift)) < APART_SHARE * min(camera.size_wh)
