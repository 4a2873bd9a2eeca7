"""Refine a rough pose against the image, and say whether the result is to be believed.

First the pose climbs from where it is; if that is not believed, tilts, turns, distances and shifts around it are
searched on a coarse image (:mod:`.pose_search`) and the best climb on finer and finer ones (:mod:`.local_search`).
A result is refused, and the pose stays, unless it explains the image better than before, stands alone among shifts of
itself, and two halves of the image agree on it. Needs numpy and cv2 only.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ...camera.pinhole import PinholeCamera
from ...errors import InputError
from ...projection.z_buffer import rasterise_depth
from ...surface.decimation import cluster_vertices
from ...surface.mesh import TriangleMesh
from ...transforms import (
    checked_rigid,
    inverse_rigid,
    rotation_angle_deg,
    rotation_from_vector,
    transform_points,
    turned_about,
)
from .image_pyramid import PyramidLevel, pyramid
from .local_search import LocalResult, refine_on_level
from .pose_search import REACH, search_poses, second_peak_ratio
from .shading_features import RIM, Surface
from .verification import ImageAgreement, Verification, agreement, contrast, mean_distance_px, verify

SIDES_PX = (70.0, 125.0, 220.0)
"""Square roots of the surface's area on the levels."""
LARGEST_CANVAS_PX = 16000
"""Pixels of the coarsest level with its margin: bounds the time of the search."""
CLIMBERS, FINALISTS = 6, 2
"""Candidates of the search that climb on the coarsest level, and on the next."""

HOP_DEG, HOPS = 4.0, 3
"""Where a climb ends it is repeated from tilts of that size around, so often while that leads higher."""
LEAST_GAIN = 1.05
"""Of the score, for another round."""
SMALL_PX = 10000
"""Pixels of surface on the finest level below which that is done there too: its correlation has more peaks then."""

LEAST_CONTRAST = 1e-3
"""Root mean square of the coarsest image less its local mean, code values 0..1."""
LEAST_SCORE = 0.1
LARGEST_SECOND_PEAK_RATIO = 0.5
SHORT_TURN_DEG, LARGEST_TURN_DEG = 6.0, 15.0
"""A climb that turned farther than the first may have found a wrong peak: search too. Farther than the second, where
slanted views begin to fit anything, is refused."""
LARGEST_HALVES_PX, LARGEST_HALVES_OF_LEVEL = 2.0, 0.7
"""The larger holds: pixels of the full image, and of the finest level."""
LEAST_SURFACE_PX = 64
"""Pixels of an image of 160 px that must show the surface at the start."""


@dataclass(frozen=True)
class Refinement:
    """The outcome of a refinement.

    Attributes
    ----------
    cam_from_model
        ``(4, 4)`` the refined pose if accepted, else the one given.
    accepted
        Whether the refined pose is better than the given one and verified.
    before, after
        Agreement of the given pose and of the refined one, whether accepted or not.
    told
        One sentence: why it was accepted or refused, with numbers.
    found
        ``(4, 4)`` the refined pose, also if it was refused.
    verified
        Whether ``found`` passed the tests; if it did and is not accepted, the given pose was as good.
    moved_px, turned_deg
        From the given pose to ``found``: mean over the visible points, and the angle of rotation.
    verification
        The tests that the refined pose had to pass; ``None`` if there was nothing to test.
    """

    cam_from_model: np.ndarray
    accepted: bool
    before: ImageAgreement
    after: ImageAgreement
    message: str
    found: np.ndarray
    verified: bool
    moved_px: float
    turned_deg: float
    verification: Verification | None


def refine_pose(
    image: np.ndarray,
    valid: np.ndarray,
    camera: PinholeCamera,
    mesh: TriangleMesh,
    cam_from_model: np.ndarray,
    *,
    colours: np.ndarray | None = None,
    progress: Callable[[float], None] | None = None,
) -> Refinement:
    """Refine a rough pose against the image.

    Parameters
    ----------
    image
        ``(H, W, 3)`` (or 1 channel) undistorted frame, float32 0..1.
    valid
        ``(H, W)`` bool: pixels that may be used.
    mesh
        In the model frame, mm.
    cam_from_model
        ``(4, 4)`` the rough pose; good to some 10 degrees and 5 % of the distance.
    colours
        ``(V, 3)`` per vertex, 0..1, if the surface's own colours are known.
    progress
        Called with the fraction done, 0..1; what it raises ends the refinement.

    Raises
    ------
    InputError
        Arrays that do not fit each other, or a pose that is not one.
    """
    start, _ = checked_rigid(cam_from_model, "refinement: cam_from_model")
    _check(image, valid, camera, mesh, colours)
    report = progress or (lambda fraction: None)
    report(0.0)
    levels, points, area_px = _levels(image, valid, camera, Surface(mesh, colours), start)
    if not levels:
        return _nothing_to_go_by(start, "it shows next to nothing of the surface in the image; move it there first")
    if contrast(levels[0]) < LEAST_CONTRAST:
        return _nothing_to_go_by(start, "the image shows no detail there; use a frame with more contrast")
    before = agreement(levels[-1], start)
    report(0.05)

    def judged(pose: np.ndarray) -> Refinement:
        if area_px / levels[-1].px ** 2 < SMALL_PX:
            pose = _multistart(levels[-1], pose, points)
        return _accept(start, pose, before, levels, points, camera)

    # where other shifts fit as well, finer images would be lost on it
    pose = _multistart(levels[0], start, points, lambda fraction: report(0.05 + 0.05 * fraction))
    if second_peak_ratio(levels[0], pose) <= LARGEST_SECOND_PEAK_RATIO:
        pose = _refined_over_levels([pose], levels[1:], points, camera, lambda fraction: report(0.1 + 0.1 * fraction))
        near = judged(pose)
        if near.verified and near.turned_deg <= SHORT_TURN_DEG:
            report(1.0)
            return near
    report(0.25)
    pivot = transform_points(start, points).mean(axis=0)
    candidates = search_poses(levels[0], start, pivot, progress=lambda fraction: report(0.25 + 0.4 * fraction))
    starts = [pose, *(candidate.cam_from_model for candidate in candidates[:CLIMBERS])]
    pose = _refined_over_levels(starts, levels, points, camera, lambda fraction: report(0.65 + 0.25 * fraction))
    result = judged(pose)
    report(1.0)
    return result


def _nothing_to_go_by(start: np.ndarray, reason: str) -> Refinement:
    none = ImageAgreement(0.0, np.nan)
    message = f"Refused, the pose is unchanged: {reason}."
    return Refinement(start, False, none, none, message, start, False, 0.0, 0.0, None)


def _check(
    image: np.ndarray, valid: np.ndarray, camera: PinholeCamera, mesh: TriangleMesh, colours: np.ndarray | None
) -> None:
    if image.ndim != 3 or image.shape[:2] != camera.shape_hw or valid.shape != camera.shape_hw:
        raise InputError(
            f"refinement: expected an image and a mask of the camera's {camera.width}x{camera.height} px, "
            f"found shapes {image.shape} and {valid.shape}; give the undistorted frame of this camera"
        )
    if colours is not None and colours.shape != mesh.vertices.shape:
        raise InputError(
            f"refinement: expected one colour per vertex {mesh.vertices.shape}, found {colours.shape}; "
            "leave the colours out or give those of this mesh"
        )


def _levels(
    image: np.ndarray, valid: np.ndarray, camera: PinholeCamera, surface: Surface, start: np.ndarray
) -> tuple[list[PyramidLevel], np.ndarray, float]:
    """The image around the surface from coarse to fine; ``(N, 3)`` visible model points and their area, px."""
    factor = min(160 / max(camera.size_wh), 1.0)
    small = camera.resized(max(round(camera.width * factor), 1), max(round(camera.height * factor), 1))
    depth = transform_points(start, surface.mesh.vertices)[:, 2]
    if not (depth > 0).any():
        return [], np.empty((0, 3)), 0.0
    coarse, _ = cluster_vertices(surface.mesh, 1.5 * float(np.median(depth[depth > 0])) / small.fx)
    raster = rasterise_depth(coarse, small, start)
    seen = raster.face >= 0
    if np.count_nonzero(seen) < LEAST_SURFACE_PX or not valid.any():
        return [], np.empty((0, 3)), 0.0
    points_cam = small.rays_cam(small.pixel_grid())[seen] / raster.inverse_depth[seen][:, None]

    y, x = np.nonzero(seen)
    area_px = len(y) / factor**2
    margin = REACH * camera.fx + RIM * np.sqrt(area_px)
    corner, opposite = np.array([np.min(x), np.min(y)]), np.array([np.max(x), np.max(y)]) + 1
    first = np.floor(corner / factor - margin).astype(int).clip(0)
    end = np.ceil(opposite / factor + margin).astype(int).clip(None, camera.size_wh)
    canvas_px = np.prod(end - first + 2 * REACH * camera.fx)
    coarsest = np.sqrt(area_px * min(LARGEST_CANVAS_PX / canvas_px, 1.0))
    levels = pyramid(
        image,
        valid,
        camera,
        surface,
        crop=(*first, *end),
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
    """The best pose after climbing on all levels, fewer and fewer from level to level."""
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
            apart = (mean_distance_px(camera, points, result.cam_from_model, pose) for pose in poses)
            if all(distance > 2 * level.px for distance in apart):
                poses.append(result.cam_from_model)
        poses = poses[: FINALISTS if index == 0 else 1]
    return poses[0]


def _multistart(
    level: PyramidLevel, pose: np.ndarray, points: np.ndarray, report: Callable[[float], None] = lambda fraction: None
) -> np.ndarray:
    """The best end of climbs from a pose and from tilts around that end."""
    best = refine_on_level(level, pose)
    for hop in range(HOPS):
        if best is None:
            return pose
        centre = best
        pivot = transform_points(centre.cam_from_model, points).mean(axis=0)
        for index in range(6):
            report((hop + index / 6) / HOPS)
            angle = index * np.pi / 3
            tilt = rotation_from_vector(np.radians(HOP_DEG) * np.array([np.cos(angle), np.sin(angle), 0.0]))
            result = refine_on_level(level, turned_about(pivot, tilt) @ centre.cam_from_model)
            if result is not None and result.score > best.score:
                best = result
        if best.score < LEAST_GAIN * centre.score:
            break
    return pose if best is None else best.cam_from_model


def _accept(
    start: np.ndarray,
    pose: np.ndarray,
    before: ImageAgreement,
    levels: list[PyramidLevel],
    points: np.ndarray,
    camera: PinholeCamera,
) -> Refinement:
    """Accept or refuse a refined pose."""
    after = agreement(levels[-1], pose)
    tests = verify(levels[0], levels[-1], pose, points, camera)
    moved_px = mean_distance_px(camera, points, start, pose)
    turned_deg = rotation_angle_deg(pose[:3, :3] @ start[:3, :3].T)
    limit_px = max(LARGEST_HALVES_PX, LARGEST_HALVES_OF_LEVEL * levels[-1].px)
    explained = f"the shape explains {after.score:.0%} of the image's variation ({before.score:.0%} before)"
    doubt = None
    if after.score < LEAST_SCORE:
        doubt = f"{explained}, too little to go by"
    elif tests.second_peak_ratio > LARGEST_SECOND_PEAK_RATIO:
        doubt = f"{explained}, but other places fit {tests.second_peak_ratio:.0%} as well as the best one"
    elif turned_deg > LARGEST_TURN_DEG:
        doubt = f"{explained}, but {turned_deg:.0f} degrees away (at most {LARGEST_TURN_DEG:.0f})"
    elif tests.split_half_px > limit_px:
        doubt = (
            f"{explained}, but two halves of the image put the surface {tests.split_half_px:.1f} px apart "
            f"(at most {limit_px:.1f})"
        )
    accepted = doubt is None and after.score > before.score
    if doubt is not None:
        message = f"Refused, the pose is unchanged: {doubt}; bring it nearer by hand or with landmarks."
    elif accepted:
        message = (
            f"Refined by {moved_px:.1f} px and {turned_deg:.2f} degrees: {explained}, two halves of the image agree "
            f"within {tests.split_half_px:.1f} px, and elsewhere it fits {tests.second_peak_ratio:.0%} as well."
        )
    else:
        message = f"The pose is unchanged: the best one near it, {moved_px:.1f} px away, is no better ({explained})."
    return Refinement(
        cam_from_model=pose if accepted else start,
        accepted=accepted,
        before=before,
        after=after,
        message=message,
        found=pose,
        verified=doubt is None,
        moved_px=moved_px,
        turned_deg=turned_deg,
        verification=tests,
    )
