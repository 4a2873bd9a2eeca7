"""Local search of a pose: least squares between an image and the best mixture of a surface's features.

The surface is rendered, and its visible points then sample the image where they project as the pose moves. Each step
solves for the mixture exactly and removes its degrees of freedom from the Jacobian (variable projection: Golub &
Pereyra 1973, in the form of Kaufman 1975). Gradients are a mean of those of the image and of the rendered mixture
(Benhimane & Malis, "Real-time image-based tracking of planes using efficient second-order minimization", 2004).
"""

from typing import Literal, NamedTuple

import cv2
import numpy as np

from ...camera.pinhole import PinholeCamera
from ...least_squares import damped_least_squares
from ...light.local_mean import image_without_local_mean
from ...transforms import rigid, se3_exp, transform_points
from .canonical_correlation import CanonicalCorrelation, best_mixture
from .image_pyramid import PyramidLevel
from .shading_features import Appearance, appearance

MAX_POINTS = 16000
"""Most points used on a level (cv2.remap takes 32767)."""

MIN_OVERLAP = 0.5
"""Fraction of the initial points that must stay in the image."""

RENDERED_WEIGHT = 0.7
"""Weight of the rendered mixture's gradient in the mean of gradients; the image's is noisier."""

STEP_CONVERGED_PX = 0.02
"""Mean movement of the points, in px of the level, below which a step is the last of its rendering."""

RENDERING_CONVERGED_PX = 0.1
"""Mean movement of the points, in px of the level, below which a rendering is the last."""


Part = tuple[Literal["half", "without quarter"], int] | None
"""Which part of the image counts: one of two complementary halves, the fields of a chequerboard (0 or 1); all but one
quarter (0 to 3), divided at the middle of the surface; or ``None``, all of it."""


class LocalResult(NamedTuple):
    """The local maximum: squared correlation, 0..1, and ``(4, 4)`` pose."""

    score: float
    cam_from_model: np.ndarray


class Linearisation(NamedTuple):
    """The least squares problem at a pose, linear in a twist (mm, radians) about ``pivot_cam``, in the camera frame.

    Attributes
    ----------
    pivot_cam
        ``(3,)`` mean of the points, mm.
    pixels
        ``(N, 2)`` where the points lie in the image of the level.
    jacobian, residuals
        ``(N, 6)`` and ``(N,)``, without what a change of the mixture explains.
    """

    pivot_cam: np.ndarray
    pixels: np.ndarray
    jacobian: np.ndarray
    residuals: np.ndarray


class _Points(NamedTuple):
    """Rendered points: ``(N, 3)`` model frame, ``(N, K)`` features, ``(N, K, 2)`` their gradients, ``(N,)`` weights."""

    model: np.ndarray
    features: np.ndarray
    gradients: np.ndarray
    weights: np.ndarray


class _State(NamedTuple):
    """A pose, the points in the camera frame and in the image, the image's channels there, and the best mixture."""

    cam_from_model: np.ndarray
    points_cam: np.ndarray
    pixels: np.ndarray
    weights: np.ndarray
    channels: np.ndarray
    mixture: CanonicalCorrelation


def refine_on_level(
    level: PyramidLevel, cam_from_model: np.ndarray, *, renderings: int = 8, steps: int = 12, part: Part = None
) -> LocalResult | None:
    """Refine a pose on one level; ``None`` if too little of the surface is in the image.

    Parameters
    ----------
    level
        The image and the surface.
    cam_from_model
        ``(4, 4)`` the initial pose.
    renderings, steps
        Largest number of renderings, and of steps for each.
    part
        The part of the image to use, see :data:`Part`.
    """
    result = None
    for rendering in range(renderings):
        seen = appearance(level.mesh, level.camera, cam_from_model, window_px=level.window_px)
        if seen is None:
            return result
        points = _sample_points(seen, rendering, part)
        image = image_without_local_mean(level.image, level.valid, seen.region, level.window_px)
        state = _evaluate(level, image, points, cam_from_model)
        if state is None:
            return result
        before = state.pixels
        state = _fitted(level, image, points, state, steps)
        cam_from_model = state.cam_from_model
        result = LocalResult(state.mixture.score, cam_from_model)
        if np.linalg.norm(state.pixels - before, axis=1).mean() < RENDERING_CONVERGED_PX:
            break
    return result


def score(level: PyramidLevel, cam_from_model: np.ndarray) -> float:
    """Squared correlation of the image with the best mixture at a pose; 0 if too little of the surface is in it."""
    seen = appearance(level.mesh, level.camera, cam_from_model, window_px=level.window_px)
    if seen is None:
        return 0.0
    image = image_without_local_mean(level.image, level.valid, seen.region, level.window_px)
    state = _evaluate(level, image, _sample_points(seen, 0, None), cam_from_model)
    return 0.0 if state is None else state.mixture.score


def linearised(level: PyramidLevel, cam_from_model: np.ndarray) -> Linearisation | None:
    """The least squares problem of a level at a pose; ``None`` if too little of the surface is in the image."""
    seen = appearance(level.mesh, level.camera, cam_from_model, window_px=level.window_px)
    if seen is None:
        return None
    image = image_without_local_mean(level.image, level.valid, seen.region, level.window_px)
    points = _sample_points(seen, 0, None)
    state = _evaluate(level, image, points, cam_from_model)
    if state is None:
        return None
    pivot = state.points_cam.mean(axis=0)
    return Linearisation(pivot, state.pixels, *_linear_system(level.camera, image, points, state, pivot))


def _sample_points(seen: Appearance, rendering: int, part: Part) -> _Points:
    selected = seen.region
    step = max(int(np.ceil(np.sqrt(np.count_nonzero(selected) / MAX_POINTS))), 1)
    if step > 1:
        lattice = np.zeros_like(selected)
        # a different subset of points for each rendering
        lattice[rendering % step :: step, (rendering // step) % step :: step] = True
        selected = selected & lattice
    y, x = np.nonzero(selected)
    weights = np.ones(len(x))
    if part is not None:
        kind, number = part
        if kind == "half":
            field = max(np.sqrt(np.count_nonzero(seen.region)) / 5, 2)
            weights = ((x // field + y // field) % 2 == number).astype(float)
        else:
            weights = ((x > np.median(x)) + 2 * (y > np.median(y)) != number).astype(float)
    planes = np.moveaxis(seen.features, 2, 0)
    gradients = np.stack([_gradient(plane)[y, x] for plane in planes], axis=1)
    return _Points(seen.points_model[y, x], seen.features[y, x].astype(float), gradients, weights)


def _gradient(plane: np.ndarray) -> np.ndarray:
    """``(H, W)`` -> ``(H, W, 2)`` derivatives along x and y, per pixel."""
    return np.dstack([cv2.Sobel(plane, cv2.CV_32F, 1, 0, scale=1 / 8), cv2.Sobel(plane, cv2.CV_32F, 0, 1, scale=1 / 8)])


def _sample_image(image: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    """``(H, W)`` or ``(H, W, C)`` at ``(N, 2)`` pixels -> ``(N, C)`` float64; 0 outside."""
    x, y = (np.ascontiguousarray(column, np.float32).reshape(-1, 1) for column in pixels.T)
    return cv2.remap(image, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT).reshape(len(x), -1).astype(float)


def _evaluate(level: PyramidLevel, image: np.ndarray, points: _Points, cam_from_model: np.ndarray) -> _State | None:
    points_cam = transform_points(cam_from_model, points.model)
    if points_cam[:, 2].min() <= 0:
        return None
    pixels = level.camera.project(points_cam)
    valid = _sample_image(level.valid.astype(np.float32), pixels)[:, 0]
    weights = np.where(valid > 0.99, points.weights, 0.0)
    if np.count_nonzero(weights) < 4 * points.features.shape[1]:
        return None
    channels = _sample_image(image, pixels)
    return _State(
        cam_from_model, points_cam, pixels, weights, channels, best_mixture(channels, points.features, weights)
    )


def _fitted(level: PyramidLevel, image: np.ndarray, points: _Points, start: _State, steps: int) -> _State:
    min_weight, pivot = MIN_OVERLAP * start.weights.sum(), start.points_cam.mean(axis=0)

    def linear(state: _State) -> tuple[np.ndarray, np.ndarray]:
        jacobian, residuals = _linear_system(level.camera, image, points, state, pivot)
        return jacobian.T @ jacobian, -jacobian.T @ residuals

    def better(state: _State, twist: np.ndarray) -> _State | None:
        moved = rigid(translation=pivot) @ se3_exp(twist) @ rigid(translation=-pivot) @ state.cam_from_model
        trial = _evaluate(level, image, points, moved)
        if trial is None or trial.mixture.score <= state.mixture.score or trial.weights.sum() < min_weight:
            return None
        return trial

    def is_settled(before: _State, after: _State) -> bool:
        return float(np.linalg.norm(after.pixels - before.pixels, axis=1).mean()) < STEP_CONVERGED_PX

    return damped_least_squares(start, linear, better, is_settled, steps=steps)


def _linear_system(
    camera: PinholeCamera, image: np.ndarray, points: _Points, state: _State, pivot: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """J ``(N, 6)`` and r ``(N,)`` for a twist (mm, radians) about ``pivot``, in the camera frame."""
    mixture, weights = state.mixture, state.weights
    total = weights.sum()
    mixed, predicted = state.channels @ mixture.channel_weights, points.features @ mixture.feature_weights
    residual = (mixed - weights @ mixed / total) - (predicted - weights @ predicted / total)
    mixed_image = (image @ mixture.channel_weights).astype(np.float32)
    observed = _sample_image(_gradient(mixed_image), state.pixels)
    rendered = np.einsum("nkd,k->nd", points.gradients, mixture.feature_weights)
    gradient_px = (1 - RENDERED_WEIGHT) * observed + RENDERED_WEIGHT * rendered
    x, y, z = state.points_cam.T
    # gradient in the image times d(pixel)/d(point)
    gradient_cam = np.stack([gradient_px[:, 0] * camera.fx / z, gradient_px[:, 1] * camera.fy / z], axis=1)
    gradient_cam = np.column_stack([gradient_cam, -(gradient_cam[:, 0] * x + gradient_cam[:, 1] * y) / z])
    jacobian = np.hstack([gradient_cam, np.cross(state.points_cam - pivot, gradient_cam)])
    # remove what a change of the mixture explains as well as a motion does
    root = np.sqrt(weights)[:, None]
    basis = np.column_stack([np.ones(len(residual)), points.features]) * root
    jacobian = jacobian * root
    within = basis.T @ basis
    within += np.diag(1e-9 * np.diag(within) + 1e-30)
    jacobian -= basis @ np.linalg.solve(within, basis.T @ jacobian)
    return jacobian, residual * root[:, 0]
