"""An independent check of a surface: at which depth do the frames look alike, were it nearer or farther?

Each pixel of a frame is tried at depths about the surface's (Collins 1996): there the other frames are laid on it, and
their likeness is the correlation of small windows, in the mean over the better half of them, as something hides the
surface in some. There is no flow and no solver in it.
"""

from collections.abc import Sequence

import cv2
import numpy as np

from ..transforms import transform_points
from .frame_flow import TOLERANCE_PX, SurfaceFrame, SurfaceView

STEP_PX, STEPS = 1.6, 6
"""Between the depths, in pixels on the surface, and how many there are on each side."""
WINDOW_PX, FINE_PX = 9, 5
"""Sides of the windows that are compared: of the check, and to confirm, where a wide one is as smooth as an error."""
MOST_PX = 4.0
"""Disagreement that counts, in pixels on the surface: one far one does not tell of a place."""
BORDER_PX = 8
LEAST_LIKE = 0.7
"""Correlation below which a depth says nothing."""
LEAST_BEND = 0.01
"""How much less alike the frames are a step nearer and farther, in the mean: less, and any depth would do, as where a
surface is smooth, wet and dark."""

Laid = tuple[SurfaceFrame, np.ndarray]
"""A frame that is laid on a view, and its pose ``cam_from_model`` (4x4, mm)."""
Sweep = tuple[SurfaceView, Sequence[Laid]]
"""A view of the surface, and what is laid on it."""


def is_confirmed(normals: np.ndarray, sweeps: Sequence[Sweep], most_mm: float) -> np.ndarray:
    """``(V,)`` bool: most sweeps find the surface around a vertex where it is, to ``most_mm`` along normals ``(V, 3)``.

    That is the root mean square over a place, so relief that is finer than what moves is not confirmed in the mean.
    """
    votes = np.zeros(len(normals), int)
    for view, others in sweeps:
        camera = view.frame.camera
        points_cam = transform_points(view.pose, view.surface.mesh.vertices)
        places = np.rint(np.nan_to_num(camera.project(points_cam), nan=-1)).astype(int)
        inside = ((places >= BORDER_PX) & (places < np.array(camera.size_wh) - BORDER_PX)).all(axis=1)
        u, v = np.where(inside[:, None], places, 0).T
        inside &= np.abs(points_cam[:, 2] - view.depth_mm[v, u]) < TOLERANCE_PX * view.pixel_mm
        off_mm, says = swept_depths(view, others, STEP_PX * view.pixel_mm, FINE_PX)
        np.clip(off_mm, -MOST_PX * view.pixel_mm, MOST_PX * view.pixel_mm, out=off_mm)
        off_mm = np.sqrt(cv2.blur(off_mm**2, (FINE_PX, FINE_PX)))
        agrees = off_mm[v, u] * np.abs((view.rays[v, u] * normals).sum(axis=1)) < most_mm
        votes += np.where(inside & says[v, u], np.where(agrees, 1, -1), 0)
    return votes > 0


def swept_depths(
    view: SurfaceView, others: Sequence[Laid], step_mm: float, window_px: int = WINDOW_PX
) -> tuple[np.ndarray, np.ndarray]:
    """``(H, W)`` by how many mm of depth the surface is nearer than where frames agree, and bool: whether they do."""
    window = window_px, window_px
    own, details = view.frame.detail, [frame.detail for frame, _ in others]
    mean, deviation = _moments(own, window)
    shape = (3, *own.shape)
    starts = [transform_points(pose, view.points.reshape(-1, 3)).T.reshape(shape) for _, pose in others]
    ways = [(pose[:3, :3] @ view.rays.reshape(-1, 3).T).reshape(shape) for _, pose in others]
    curve = np.empty((2 * STEPS + 1, *own.shape), np.float32)
    for number, values in enumerate(curve):
        likes = []
        for start, way, (other, _), detail in zip(starts, ways, others, details, strict=True):
            x, y, z = (a + b * ((number - STEPS) * step_mm) for a, b in zip(start, way, strict=True))
            camera = other.camera
            u, v = camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy
            laid = cv2.remap(detail, u.astype(np.float32), v.astype(np.float32), cv2.INTER_LINEAR)
            laid_mean, laid_deviation = _moments(laid, window)
            likes.append((cv2.boxFilter(own * laid, -1, window) - mean * laid_mean) / (deviation * laid_deviation))
        half = len(likes) // 2
        values[:] = np.partition(np.array(likes), half, axis=0)[half:].mean(axis=0)
    best = np.clip(curve.argmax(axis=0), 1, 2 * STEPS - 1)
    nearer, most, farther = (np.take_along_axis(curve, best[None] + by, axis=0)[0] for by in (-1, 0, 1))
    bend = most - (nearer + farther) / 2
    # the vertex of the parabola through all three
    beside = np.clip((farther - nearer) / np.maximum(4 * bend, 1e-6), -1, 1)
    says = view.shown & (most > LEAST_LIKE) & (bend > LEAST_BEND)
    return ((best - STEPS + beside) * step_mm).astype(np.float32), says


def _moments(image: np.ndarray, window: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    mean = cv2.boxFilter(image, -1, window)
    return mean, np.sqrt(np.maximum(cv2.boxFilter(image * image, -1, window) - mean * mean, 1))
