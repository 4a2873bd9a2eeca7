"""Search of all poses on a tiny image: renderings from all sides, correlated over all rolls, sizes and shifts.

Only view directions need renderings, with features that a roll leaves as they are. Sizes resample the rendering, rolls
turn the image, and Fourier transforms give all shifts at once. Perspective is neglected within the surface.
"""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple

import cv2
import numpy as np

from ...camera.pinhole import PinholeCamera
from ...light.local_mean import without_local_mean
from ...transforms import rigid, rotation_between, rotation_from_vector
from ..refinement.image_pyramid import reduced_image
from ..refinement.masked_correlation import Spectra, correlated, spectrum
from ..refinement.shading_features import Surface, appearance

DIRECTIONS = 150
"""View directions, about 17° apart."""

ROLLS_DEG = tuple(range(0, 360, 20))

SPANS = tuple(0.62 * 1.25**step for step in range(7))
"""Diameters of the surface's bounding sphere in the image, relative to the image's shorter side."""

SHORT_PX, TEMPLATE_PX = 40, 112
"""The shorter side of the tiny image, and the diameter of the bounding sphere in the renderings."""

WINDOW = 0.07
"""Standard deviation of the window of local means, relative to the bounding sphere's diameter in px."""

MIN_OVERLAP = 0.6
"""Fraction of the surface, or of the image if that is smaller, that a pose must show."""

PEAKS = 4
"""Candidates kept of each direction."""

THREADS = 2


class Found(NamedTuple):
    """A ``(4, 4)`` pose and its score, a log-likelihood ratio: the larger the better."""

    score: float
    cam_from_model: np.ndarray


class _TurnedImage(NamedTuple):
    """The image at a roll on a square canvas: its transforms, and the warp ``(2, 3)`` to it."""

    spectra: Spectra
    canvas_from_image: np.ndarray


def search_everywhere(
    image: np.ndarray,
    valid: np.ndarray,
    camera: PinholeCamera,
    surface: Surface,
    *,
    progress: Callable[[float], None] = lambda fraction: None,
) -> list[Found]:
    """Poses that explain the image best, best first: at most :data:`PEAKS` of each direction.

    Parameters
    ----------
    image, valid, camera
        ``(H, W, C)`` 0..1, ``(H, W)`` bool, and intrinsics.
    surface
        Its mesh is in the model frame, mm, with the origin near its middle.
    progress
        Called with the fraction done.
    """
    factor = SHORT_PX / min(camera.size_wh)
    small = camera.resized(round(camera.width * factor), round(camera.height * factor))
    reduced, used = reduced_image(image, valid, small.size_wh)
    grey = reduced.mean(axis=2)
    turned = [_turned_images(grey, used, SHORT_PX * span) for span in SPANS]
    image_px = float(np.count_nonzero(used))
    views = view_rotations(DIRECTIONS)

    def best(rotation: np.ndarray) -> list[Found]:
        rendered = _rendered(surface, rotation)
        if rendered is None:
            return []
        peaks = []
        for span, images in zip(SPANS, turned, strict=True):
            region, planes = _template(*rendered, span)
            transforms = [spectrum(plane, images[0].spectra.region.shape) for plane in (region, *planes)]
            shown_px = float(region.sum())
            for turned_image in images:
                scores = _scores(transforms, turned_image.spectra, shown_px, MIN_OVERLAP * min(shown_px, image_px))
                _, score, _, place = cv2.minMaxLoc(scores)
                peaks.append((score, span, turned_image, place))
        peaks.sort(key=lambda peak: -peak[0])
        return [
            Found(score, _pose(rotation, surface.mesh.radius, small, span, turned_image, place))
            for score, span, turned_image, place in peaks[:PEAKS]
        ]

    found = [each for some in in_threads(best, views, progress) for each in some]
    return sorted(found, key=lambda each: -each.score)


def in_threads(
    function: Callable[[np.ndarray], Any], items: Sequence[np.ndarray], progress: Callable[[float], None]
) -> list[Any]:
    """The function of each item, in as many threads as OpenCV's and numpy's own code can run side by side."""
    results = []
    pool = ThreadPoolExecutor(THREADS)
    try:
        for result in pool.map(function, items):
            results.append(result)
            progress(len(results) / len(items))
    finally:
        pool.shutdown(cancel_futures=True)
    return results


def view_rotations(count: int) -> list[np.ndarray]:
    """``(3, 3)`` rotations of cameras that look at the model from directions evenly spread over the sphere."""
    index = np.arange(count) + 0.5
    z, angle = 1 - 2 * index / count, index * np.pi * (3 - np.sqrt(5))
    radius = np.sqrt(1 - z**2)
    from_model = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), z])
    return [rotation_between(direction, np.array([0.0, 0.0, -1.0])) for direction in from_model]


def _rendered(surface: Surface, rotation: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
    """Region and features of the surface seen from far away, the model's origin in the middle."""
    size, focal, radius = TEMPLATE_PX * 5 // 4, 1000.0, surface.mesh.radius
    middle = (size - 1) / 2
    camera = PinholeCamera(size, size, focal, focal, middle, middle)
    pose = rigid(rotation, np.array([0.0, 0.0, 2 * radius * focal / TEMPLATE_PX]))
    seen = appearance(surface, camera, pose, window_px=WINDOW * TEMPLATE_PX, brief=True)
    return None if seen is None else (seen.region, seen.features)


def _template(region: np.ndarray, features: np.ndarray, span: float) -> tuple[np.ndarray, np.ndarray]:
    """The region ``(S, S)`` at a size, 0 or 1, and orthonormal mixtures ``(K, S, S)`` of the features, 0 outside."""
    size = _template_px(span)
    inside = cv2.resize(region.astype(np.float32), (size, size), interpolation=cv2.INTER_AREA) > 0.5
    resized = cv2.resize(features, (size, size), interpolation=cv2.INTER_AREA).reshape(size, size, -1)
    values = resized[inside] - resized[inside].mean(axis=0)
    values /= np.maximum(np.linalg.norm(values, axis=0), 1e-12)
    basis, weights, _ = np.linalg.svd(values, full_matrices=False)
    basis = basis[:, weights > 0.05]
    planes = np.zeros((basis.shape[1], size, size), np.float32)
    planes[:, inside] = basis.T
    return inside.astype(np.float32), planes


def _template_px(span: float) -> int:
    """The side of a template of a surface that spans so much of the image."""
    return max(round(TEMPLATE_PX * 5 // 4 * SHORT_PX * span / TEMPLATE_PX), 8)


def _turned_images(grey: np.ndarray, valid: np.ndarray, diameter_px: float) -> list[_TurnedImage]:
    height, width = grey.shape
    size = cv2.getOptimalDFTSize(int(np.ceil(np.hypot(height, width) + 1.25 * diameter_px)))
    detail = without_local_mean(grey, valid, WINDOW * diameter_px)
    limit = 3 * np.sqrt(np.mean(detail[valid] ** 2)) if valid.any() else 0.0
    detail = np.clip(detail, -limit, limit).astype(np.float32)
    turned = []
    for roll in ROLLS_DEG:
        warp = cv2.getRotationMatrix2D(((width - 1) / 2, (height - 1) / 2), -roll, 1.0)
        warp[:, 2] = warp[:, 2] + (size - 1) / 2 - np.array([width - 1, height - 1]) / 2
        mask = cv2.warpAffine(valid.astype(np.float32), warp, (size, size))
        values = cv2.warpAffine(detail, warp, (size, size))
        turned.append(_TurnedImage(Spectra.of(mask, [values], (size, size)), warp))
    return turned


def _scores(transforms: list[np.ndarray], image: Spectra, whole_px: float, least_px: float) -> np.ndarray:
    """``(P, P)`` log-likelihood ratios by shift (y, x), cyclic, of the template from the canvas's corner.

    The features count as orthonormal on the part of the template in the image, too.
    """
    shown = correlated(image.region, transforms[0])
    variation = correlated(image.products[0, 0], transforms[0])
    explained = sum(correlated(image.planes[0], each) ** 2 for each in transforms[1:])
    enough = shown >= least_px
    shown = np.maximum(shown, 1.0)
    share = explained * whole_px / shown / np.maximum(variation, 1e-9)
    return np.where(enough, -shown * np.log1p(-np.clip(share, 0, 0.95)), 0.0)


def _pose(
    rotation: np.ndarray,
    radius: float,
    small: PinholeCamera,
    span: float,
    image: _TurnedImage,
    place: Sequence[int],
) -> np.ndarray:
    """The pose of a peak, whose place is (x, y)."""
    size, canvas = _template_px(span), len(image.spectra.region)
    x, y = (value - canvas if value > canvas - size // 2 else value for value in place)
    warp = image.canvas_from_image
    pixel = np.linalg.solve(warp[:, :2], np.array([x, y]) + (size - 1) / 2 - warp[:, 2])
    ray = small.rays_cam(pixel[None])[0]
    turn = rotation_from_vector(np.array([0.0, 0.0, -np.arctan2(warp[1, 0], warp[0, 0])]))
    distance = 2 * radius * np.sqrt(small.fx * small.fy) / (SHORT_PX * span)
    towards = rotation_between(np.array([0.0, 0.0, 1.0]), ray)
    return rigid(towards) @ rigid(turn @ rotation, np.array([0.0, 0.0, distance]))
