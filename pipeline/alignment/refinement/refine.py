"""Refine a rough pose against the image, and accept or refuse the result.

A local search (:mod:`.local_search`) starts from the rough pose. If its result fails the verification, a search over
tilts, rolls, distances and shifts on a coarse image (:mod:`.pose_search`) gives further initial poses, which are
refined from coarse to fine. :mod:`.verdict` accepts or refuses the result. Needs ``cv2``.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ...camera.pinhole import PinholeCamera
from ...projection.z_buffer import rasterise_depth
from ...surface.decimation import cluster_vertices
from ...surface.mesh import TriangleMesh
from ...transforms import (
    checked_rigid,
    inverse_rigid,
    rotation_from_vector,
    transform_points,
    turned_about,
)
from .image_pyramid import PyramidLevel, pyramid
from .local_search import LocalResult, refine_on_level, score
from .pose_search import REACH, search_poses, second_peak_ratio
from .shading_features import RIM
from .verdict import MAX_SECOND_PEAK_RATIO, Refinement, judged, refused_unsearched
from .verification import contrast, mean_distance_px

SIDES_PX = (70.0, 125.0, 220.0)
"""Square roots of the surface's area on the pyramid levels."""

MAX_CANVAS_PX = 16000
"""Pixels of the coarsest level with its margin; bounds the time of the search."""

COARSEST_CANDIDATES, FINER_CANDIDATES = 6, 2
"""Candidates of the pose search that are refined on the coarsest level, and on the next."""

HOP_DEG, MAX_HOPS = 4.0, 3
"""The multi-start repeats a local search from tilts of this size around its result, at most this often."""

MIN_GAIN = 1.05
"""Ratio of scores at which the multi-start continues."""

SMALL_PX = 10000
"""Pixels of surface on the finest level below which the multi-start runs there too: small surfaces give more peaks."""

MIN_CONTRAST = 1e-3
"""Root mean square of the coarsest image less its local mean, code values 0..1."""

SHORT_ROTATION_DEG = 6.0
"""A local search that rotated by more may have found a wrong peak and is followed by the pose search."""

COARSE_PX, MIN_COARSE_PX = 160, 64
"""Longer side of the image in which the surface is found first, and pixels of surface below which it is too coarse."""

MIN_SURFACE_PX = 200
"""Pixels of the frame that must show the surface at the rough pose. Of objects of LM-O in reduced photographs, 5 of 11
with 230 to 620 px were accepted, all within 2.4 px; of 5 with 130 to 180 px none, and two ended 14 and 24 px off."""


def refine_pose(
    image: np.ndarray,
    valid: np.ndarray,
    camera: PinholeCamera,
    mesh: TriangleMesh,
    cam_from_model: np.ndarray,
    *,
    progress: Callable[[float], None] | None = None,
) -> Refinement:
    """Refine a rough pose against the image.

    Parameters
    ----------
    image
        ``(H, W, 3)`` or ``(H, W, 1)`` undistorted frame, float32 0..1.
    valid
        ``(H, W)`` bool: pixels that may be used.
    camera
        Intrinsics of the undistorted frame.
    mesh
        In the model frame, mm.
    cam_from_model
        ``(4, 4)`` the rough pose, within about 10° and 5 % of the distance.
    progress
        Called with the fraction done, 0..1; an exception that it raises ends the refinement.
    """
    start, _ = checked_rigid(cam_from_model, "refinement: cam_from_model")
    report = progress or (lambda fraction: None)
    report(0.0)
    levels, points, area_px = _levels(image, valid, camera, mesh, start)
    if not levels:
        return refused_unsearched(
            start, "it shows almost no surface in the image; move the surface into the image first"
        )
    if contrast(levels[0]) < MIN_CONTRAST:
        return refused_unsearched(start, "the image shows no detail there; use a frame with more contrast")
    before = score(levels[-1], start)
    report(0.05)

    def assess(pose: np.ndarray) -> Refinement:
        if area_px / levels[-1].px ** 2 < SMALL_PX:
            pose = _multistart(levels[-1], pose, points)
        return judged(start, pose, before, levels, points, camera)

    # a pose whose shifts fit as well is not worth refining on finer levels
    pose = _multistart(levels[0], start, points, lambda fraction: report(0.05 + 0.05 * fraction))
    if second_peak_ratio(levels[0], pose) <= MAX_SECOND_PEAK_RATIO:
        pose = _refined_over_levels([pose], levels[1:], points, camera, lambda fraction: report(0.1 + 0.1 * fraction))
        local = assess(pose)
        if local.verified and local.rotation_deg <= SHORT_ROTATION_DEG:
            report(1.0)
            return local
    report(0.25)
    pivot = transform_points(start, points).mean(axis=0)
    searching = lambda fraction: report(0.25 + 0.4 * fraction)  # noqa: E731
    candidates = search_poses(levels[0], start, pivot, COARSEST_CANDIDATES, progress=searching)
    pose = _refined_over_levels(
        [pose, *candidates], levels, points, camera, lambda fraction: report(0.65 + 0.25 * fraction)
    )
    result = assess(pose)
    report(1.0)
    return result


def _levels(
    image: np.ndarray, valid: np.ndarray, camera: PinholeCamera, mesh: TriangleMesh, start: np.ndarray
) -> tuple[list[PyramidLevel], np.ndarray, float]:
    """Pyramid levels, coarse to fine, ``(N, 3)`` visible points, model frame, and the surface's area in px.

    Without levels where the rough pose shows too little of the surface.
    """
    depth = transform_points(start, mesh.vertices)[:, 2]
    if not (depth > 0).any() or not valid.any():
        return [], np.empty((0, 3)), 0.0
    # a small object in a large image is nothing in the coarse one
    for side in (COARSE_PX, max(camera.size_wh)):
        factor = min(side / max(camera.size_wh), 1.0)
        small = camera.within(side)
        coarse = cluster_vertices(mesh, 1.5 * float(np.median(depth[depth > 0])) / small.fx)
        raster = rasterise_depth(coarse, small, start)
        seen = raster.face >= 0
        if np.count_nonzero(seen) >= MIN_COARSE_PX:
            break
    if np.count_nonzero(seen) < MIN_SURFACE_PX * factor**2:
        return [], np.empty((0, 3)), 0.0
    points_cam = small.rays_cam(small.pixel_grid())[seen] / raster.inverse_depth[seen][:, None]

    y, x = np.nonzero(seen)
    area_px = len(y) / factor**2
    margin = REACH * camera.fx + RIM * np.sqrt(area_px)
    corner, opposite = np.array([np.min(x), np.min(y)]), np.array([np.max(x), np.max(y)]) + 1
    first = np.floor(corner / factor - margin).astype(int).clip(0)
    end = np.ceil(opposite / factor + margin).astype(int).clip(None, camera.size_wh)
    canvas_px = np.prod(end - first + 2 * REACH * camera.fx)
    coarsest = np.sqrt(area_px * min(MAX_CANVAS_PX / canvas_px, 1.0))
    (x0, y0), (x1, y1) = first, end
    levels = pyramid(
        image[y0:y1, x0:x1],
        valid[y0:y1, x0:x1],
        replace(camera, width=int(x1 - x0), height=int(y1 - y0), cx=camera.cx - x0, cy=camera.cy - y0),
        mesh,
        sides=(min(SIDES_PX[0], coarsest), *SIDES_PX[1:]),
        area_px=area_px,
        depth_mm=float(np.median(points_cam[:, 2])),
    )
    return levels, transform_points(inverse_rigid(start), points_cam), area_px


def _refined_over_levels(
    starts: list[np.ndarray],
    levels: list[PyramidLevel],
    points: np.ndarray,
    camera: PinholeCamera,
    report: Callable[[float], None],
) -> np.ndarray:
    """The best pose after local searches on all levels, from fewer poses on each finer level."""
    poses = starts
    for index, level in enumerate(levels):
        results: list[LocalResult] = []
        for count, pose in enumerate(poses):
            report((index + count / len(poses)) / len(levels))
            result = refine_on_level(level, pose)
            if result is not None:
                results.append(result)
        if not results:
            return poses[0]
        results.sort(key=lambda result: -result.score)
        poses = []
        for result in results:
            distances_px = (mean_distance_px(camera, points, result.cam_from_model, pose) for pose in poses)
            if all(distance > 2 * level.px for distance in distances_px):
                poses.append(result.cam_from_model)
        poses = poses[: FINER_CANDIDATES if index == 0 else 1]
    return poses[0]


def _multistart(
    level: PyramidLevel, pose: np.ndarray, points: np.ndarray, report: Callable[[float], None] = lambda fraction: None
) -> np.ndarray:
    """The best result of local searches from a pose and, repeatedly, from tilts around the best result so far."""
    best = refine_on_level(level, pose)
    for hop in range(MAX_HOPS):
        if best is None:
            return pose
        centre = best
        pivot = transform_points(centre.cam_from_model, points).mean(axis=0)
        for index in range(6):
            report((hop + index / 6) / MAX_HOPS)
            angle = index * np.pi / 3
            tilt = rotation_from_vector(np.radians(HOP_DEG) * np.array([np.cos(angle), np.sin(angle), 0.0]))
            result = refine_on_level(level, turned_about(pivot, tilt) @ centre.cam_from_model)
            if result is not None and result.score > best.score:
                best = result
        if best.score < MIN_GAIN * centre.score:
            break
    return pose if best is None else best.cam_from_model
