"""Pose search around a rough pose: renderings at several tilts, correlated with the image over all shifts at once.

Only tilts need renderings. A shift in the image is, to first order, a rotation of the camera about its centre, which
leaves the rendering unchanged. Rolls and changes of distance are warps of the image. For each tilt and warp, features
and channels are correlated at all shifts at once, each shift over its own overlap of valid pixels, by Fourier
transforms (Padfield, "Masked object registration in the Fourier domain", 2012).
"""

from collections.abc import Callable, Iterable
from typing import NamedTuple

import cv2
import numpy as np

from ...camera.pinhole import PinholeCamera
from ...light.local_mean import without_local_mean
from ...transforms import rigid, rotation_between, rotation_from_vector, turned_about
from .canonical_correlation import summed_correlation
from .image_pyramid import PyramidLevel
from .shading_features import Appearance, appearance

MIN_OVERLAP = 0.6
"""Fraction of the surface, or of the image if that is smaller, that a candidate must overlap."""

MAX_PEAKS = 6
"""Local maxima kept of each correlation."""

TILTS_DEG = tuple(
    (radius * np.cos(angle), radius * np.sin(angle))
    for radius, count, first in ((0.0, 1, 0.0), (4.0, 6, 0.0), (8.0, 12, np.pi / 12))
    for angle in first + np.arange(count) * 2 * np.pi / count
)
ROLLS_DEG = (-4.0, 0.0, 4.0)
SCALES = (0.95, 1.0, 1.05)
"""Rotations about the camera's (x, y) and about z, and factors of the image's size; all combinations are searched."""

REACH = 0.058
"""Largest shift, as a fraction of the distance."""


class Spectra(NamedTuple):
    """Packed Fourier transforms ``(H, W)`` of an image.

    Attributes
    ----------
    region
        That of its valid pixels.
    planes
        Those of its planes, which are 0 elsewhere.
    products
        Those of the products of two planes, by their numbers.
    """

    region: np.ndarray
    planes: list[np.ndarray]
    products: dict[tuple[int, int], np.ndarray]

    @classmethod
    def of(cls, region: np.ndarray, planes: Iterable[np.ndarray], shape: tuple[int, int]) -> "Spectra":
        """Transform an image ``(h, w)``, in the corner of a canvas of some shape."""
        planes = list(planes)
        pairs = [(k, m) for k in range(len(planes)) for m in range(k, len(planes))]
        return cls(
            spectrum(region, shape),
            [spectrum(plane, shape) for plane in planes],
            {(k, m): spectrum(planes[k] * planes[m], shape) for k, m in pairs},
        )


def spectrum(plane: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """The packed Fourier transform of a plane ``(h, w)`` in the corner of a canvas."""
    canvas = np.zeros(shape, np.float32)
    canvas[: plane.shape[0], : plane.shape[1]] = plane
    return cv2.dft(canvas)


def correlated(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """``(H, W)`` by shift (y, x), cyclic: the sum of ``one`` times the ``other``, moved by the shift; both packed."""
    return cv2.idft(cv2.mulSpectrums(one, other, 0, conjB=True), flags=cv2.DFT_SCALE | cv2.DFT_REAL_OUTPUT)


def correlation_scores(features: Spectra, image: Spectra, reach: int, least_area: float) -> np.ndarray:
    """``(2 reach + 1, 2 reach + 1)`` sums of the squared canonical correlations by shift (y, x), from -reach.

    The image is moved against the features; 0 where both overlap in less than ``least_area`` px.
    """
    rows, columns = (np.r_[size - reach : size, 0 : reach + 1] for size in features.region.shape)

    def within_reach(one: np.ndarray, other: np.ndarray) -> np.ndarray:
        return correlated(one, other)[rows][:, columns].astype(np.float64)

    area = within_reach(features.region, image.region)
    count = np.maximum(area, 1.0)
    mean_p = np.stack([within_reach(each, image.region) for each in features.planes], axis=-1) / count[..., None]
    mean_y = np.stack([within_reach(features.region, each) for each in image.planes], axis=-1) / count[..., None]
    within_p = np.empty((*area.shape, len(features.planes), len(features.planes)))
    for (k, m), product in features.products.items():
        within_p[..., k, m] = within_p[..., m, k] = within_reach(product, image.region) / count
    within_y = np.empty((*area.shape, len(image.planes), len(image.planes)))
    for (c, d), product in image.products.items():
        within_y[..., c, d] = within_y[..., d, c] = within_reach(features.region, product) / count
    between = np.stack(
        [np.stack([within_reach(one, other) for other in image.planes], axis=-1) for one in features.planes], axis=-2
    )
    within_p -= mean_p[..., :, None] * mean_p[..., None, :]
    within_y -= mean_y[..., :, None] * mean_y[..., None, :]
    between = between / count[..., None, None] - mean_p[..., :, None] * mean_y[..., None, :]
    return np.where(area >= least_area, summed_correlation(within_y, within_p, between), 0.0)


class _WarpedImage(NamedTuple):
    """The image rotated and scaled: its transforms, the affine warp ``(2, 3)``, its scale and its area in px."""

    spectra: Spectra
    canvas_from_image: np.ndarray
    scale: float
    area: float


def search_poses(
    level: PyramidLevel,
    cam_from_model: np.ndarray,
    pivot_cam: np.ndarray,
    most: int,
    *,
    progress: Callable[[float], None] = lambda fraction: None,
) -> list[np.ndarray]:
    """Poses ``(4, 4)`` of local maxima around a pose, by the sum of squared canonical correlations, best first.

    Parameters
    ----------
    cam_from_model
        ``(4, 4)`` the rough pose.
    pivot_cam
        ``(3,)`` mm: the centre of rotations, a point on the surface at the rough pose, in the camera frame.
    most
        How many at most.
    progress
        Called with the fraction done.
    """
    reach, canvas, shape = _canvas(level)
    warped_images = [_warped_image(level, roll, scale, reach, shape) for roll in ROLLS_DEG for scale in SCALES]
    found = []
    for index, tilt in enumerate(TILTS_DEG):
        progress(index / len(TILTS_DEG))
        tilted = turned_about(pivot_cam, rotation_from_vector(np.radians([*tilt, 0.0]))) @ cam_from_model
        seen = appearance(level.mesh, canvas, tilted, window_px=level.window_px, brief=True)
        if seen is None:
            continue
        features = _spectra(seen, shape)
        area = float(np.count_nonzero(seen.region))
        for warped in warped_images:
            scores = correlation_scores(features, warped.spectra, reach, MIN_OVERLAP * min(area, warped.area))
            for score, shift in _peaks(scores, reach):
                found.append((score, shift, warped, tilted))
    found.sort(key=lambda entry: -entry[0])
    pivot_canvas = canvas.project(pivot_cam[None])[0]
    return [
        _candidate_pose(tilted, warped, pivot_cam, pivot_canvas - shift, level)
        for _score, shift, warped, tilted in found[:most]
    ]


def second_peak_ratio(level: PyramidLevel, cam_from_model: np.ndarray) -> float:
    """Second peak ratio: the best score of the same rendering elsewhere in the image over the score at the pose.

    Near 0 the pose is unique among its shifts. Near 1 or above, other places fit as well, and the pose is unreliable.
    Infinite if too little of the surface is in the image.
    """
    reach, canvas, shape = _canvas(level)
    seen = appearance(level.mesh, canvas, cam_from_model, window_px=level.window_px, brief=True)
    if seen is None:
        return np.inf
    warped = _warped_image(level, 0.0, 1.0, reach, shape)
    least_area = MIN_OVERLAP * min(float(np.count_nonzero(seen.region)), warped.area)
    scores = correlation_scores(_spectra(seen, shape), warped.spectra, reach, least_area)
    shift_px = np.hypot(*np.mgrid[-reach : reach + 1, -reach : reach + 1])
    here = scores[shift_px <= 2].max()
    elsewhere = scores[shift_px > max(2 * level.window_px, 4)].max(initial=0.0)
    return float(elsewhere / here) if here > 0 else np.inf


def _canvas(level: PyramidLevel) -> tuple[int, PinholeCamera, tuple[int, int]]:
    """The largest shift in px of the level, the camera of renderings with that margin, and the transforms' shape."""
    reach = int(np.ceil(REACH * min(level.camera.fx, level.camera.fy)))
    canvas = level.margin(reach)
    return reach, canvas, (cv2.getOptimalDFTSize(canvas.height), cv2.getOptimalDFTSize(canvas.width))


def _warped_image(
    level: PyramidLevel, roll_deg: float, scale: float, reach: int, shape: tuple[int, int]
) -> _WarpedImage:
    camera = level.camera
    canvas_from_image = cv2.getRotationMatrix2D((camera.width / 2, camera.height / 2), -roll_deg, scale)
    canvas_from_image[:, 2] = canvas_from_image[:, 2] + reach
    size = camera.width + 2 * reach, camera.height + 2 * reach
    image = without_local_mean(level.image, level.valid, level.window_px)
    mask = cv2.warpAffine(level.valid.astype(np.float32), canvas_from_image, size)
    rotated = cv2.warpAffine(image, canvas_from_image, size).reshape(*mask.shape, -1)
    spectra = Spectra.of(mask, np.moveaxis(rotated, 2, 0), shape)
    return _WarpedImage(spectra, canvas_from_image, scale, float(mask.sum()))


def _spectra(seen: Appearance, shape: tuple[int, int]) -> Spectra:
    return Spectra.of(seen.region, np.moveaxis(seen.features, 2, 0), shape)


def _peaks(scores: np.ndarray, reach: int) -> list[tuple[float, np.ndarray]]:
    """The best local maxima: score and ``(2,)`` shift (x, y) in px."""
    neighbours = cv2.dilate(scores, np.ones((5, 5), np.uint8))
    y, x = np.nonzero((scores >= neighbours) & (scores > 0))
    best = np.argsort(-scores[y, x], kind="stable")[:MAX_PEAKS]
    return [(float(scores[y[i], x[i]]), np.array([x[i] - reach, y[i] - reach], float)) for i in best]


def _candidate_pose(
    tilted: np.ndarray, warped: _WarpedImage, pivot_cam: np.ndarray, pivot_warped: np.ndarray, level: PyramidLevel
) -> np.ndarray:
    """The pose whose rendering in the image equals that of ``tilted`` in the rotated, scaled and shifted image."""
    linear, offset = warped.canvas_from_image[:, :2], warped.canvas_from_image[:, 2]
    pivot_image = np.linalg.solve(linear, pivot_warped - offset)
    roll = np.arctan2(linear[1, 0], linear[0, 0])
    # an image that had to be enlarged to match the rendering shows the surface farther away
    pose = turned_about(pivot_cam, rotation_from_vector(np.array([0.0, 0.0, -roll]))) @ tilted
    pose = rigid(translation=(warped.scale - 1) * pivot_cam) @ pose
    return rigid(rotation_between(pivot_cam, level.camera.rays_cam(pivot_image[None])[0])) @ pose
