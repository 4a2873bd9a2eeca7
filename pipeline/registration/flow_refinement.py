"""Refine a pose by rendering and optical flow: where the known view of a pose would have to move to lie on the frame.

The flow is that of dense inverse search (Kroeger et al. 2016), there and back: where both disagree, the frame shows
something else than the surface.
"""

from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np

from ..alignment.levenberg_marquardt import Loss, fit_poses
from ..alignment.reprojection import Correspondences, Poses
from ..transforms import transform_points
from .known_views import KnownView, KnownViews

ROUNDS = 4
SETTLED_PX = 0.1
"""Mean movement below which no further round follows."""

STEP_PX = 4
"""Between the pixels whose flow is used."""

CLOSING_PX = 1.0
"""Flow there and back that misses the pixel by more is not used."""

CONTRAST_SIGMA = 0.03
"""Local contrast relative to the longer side below which light and exposure are taken out."""

LEAST_TEXTURE = 6.0
"""Standard deviation in code values around a pixel without which its flow says nothing."""

SHRINK = 4
"""Factor by which images are made smaller to blur them widely."""

LOSS_PX = 1.0
FITTED = 1500
"""Pixels of which a pose is fitted at most: its neighbours' flow says nothing else."""
LEAST_PIXELS = 30


class _Flow(NamedTuple):
    """Flow from a known view to a frame: ``(N, 2)`` pixels of the view, where they go, and whether they come back."""

    pixels: np.ndarray
    moved: np.ndarray
    closes: np.ndarray


@dataclass(frozen=True)
class FlowFit:
    """A pose refined by flow.

    Attributes
    ----------
    cam_from_model
        ``(4, 4)``, mm.
    view
        The known view near it from which the flow went out.
    pixels
        ``(N, 2)`` textured pixels of the view.
    residuals_px
        ``(N,)`` how far each lies from where the frame shows it; infinite where the flow does not come back.
    points_model, moved
        ``(N, 3)`` points of the surface at the pixels, and ``(N, 2)`` where the frame shows them.
    """

    cam_from_model: np.ndarray
    view: KnownView
    pixels: np.ndarray
    residuals_px: np.ndarray
    points_model: np.ndarray
    moved: np.ndarray


def refined_by_flow(
    views: KnownViews, grey: np.ndarray, valid: np.ndarray, cam_from_model: np.ndarray
) -> FlowFit | None:
    """The pose near a rough one ``(4, 4)`` at which the known view lies on a frame; ``None`` if there is none.

    ``grey`` is ``(H, W)`` uint8, ``valid`` ``(H, W)`` bool: pixels that may be used.
    """
    frame, pose, view = _without_light(grey, valid), cam_from_model, views.at(cam_from_model)
    for last in (*[False] * (ROUNDS - 1), True):
        flow = _flow(view, frame, valid)
        if flow is None or np.count_nonzero(flow.closes) < LEAST_PIXELS:
            return None
        points = view.lifted(flow.pixels)
        pose = _fitted(points[flow.closes], flow.moved[flow.closes], view, view.cam_from_model)
        placed = view.camera.project(transform_points(pose, points))
        shift_px = float(np.linalg.norm(placed - flow.pixels, axis=1).mean())
        if last or not shift_px > SETTLED_PX:
            residuals_px = np.where(flow.closes, np.linalg.norm(flow.moved - placed, axis=1), np.inf)
            return FlowFit(pose, view, flow.pixels, residuals_px, points, flow.moved)
        view = views.at(pose)
    return None


def _fitted(points: np.ndarray, pixels: np.ndarray, view: KnownView, start: np.ndarray) -> np.ndarray:
    chosen = slice(None, None, max(1, len(points) // FITTED))
    known = Correspondences.about(points[chosen], pixels[chosen], view.camera)
    poses, _ = fit_poses(known, Poses.of(start[None], known.pivot_model), loss=Loss(LOSS_PX))
    return poses.matrix(0, known.pivot_model)


def _without_light(grey: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """``(H, W)`` uint8: the image less its local mean, by its local deviation; grey outside the mask."""
    sigma = CONTRAST_SIGMA * max(grey.shape)
    weight = np.maximum(_blurred(mask.astype(np.float32), sigma), 1e-3)
    image = np.where(mask, grey, 0).astype(np.float32)
    detail = np.where(mask, grey - _blurred(image, sigma) / weight, 0).astype(np.float32)
    deviation = np.sqrt(np.maximum(_blurred(detail**2, sigma), 0) / weight)
    return np.clip(128 + 48 * detail / (deviation + 4), 0, 255).astype(np.uint8)


def _blurred(image: np.ndarray, sigma: float) -> np.ndarray:
    """A wide Gaussian blur, of a smaller image: it has no finer detail, and takes a tenth of the time."""
    height, width = image.shape
    small = cv2.resize(image, (-(-width // SHRINK), -(-height // SHRINK)), interpolation=cv2.INTER_AREA)
    small = cv2.GaussianBlur(small, (0, 0), sigma / SHRINK)
    return cv2.resize(small, (width, height), interpolation=cv2.INTER_LINEAR)


def _flow(view: KnownView, frame: np.ndarray, valid: np.ndarray) -> _Flow | None:
    if np.count_nonzero(view.shown) < LEAST_PIXELS * STEP_PX**2:
        return None
    known = _without_light(view.grey, view.shown)
    # what the view does not show is the frame's own: no false edge at the border
    shown = np.where(view.shown, known, frame)
    search = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
    unknown = np.zeros((*frame.shape, 2), np.float32)
    there, back = search.calc(shown, frame, unknown.copy()), search.calc(frame, shown, unknown)
    height, width = frame.shape
    v, u = np.mgrid[STEP_PX // 2 : height : STEP_PX, STEP_PX // 2 : width : STEP_PX]
    blurred = cv2.GaussianBlur(known.astype(np.float32), (0, 0), 3.0)
    texture = np.sqrt(np.maximum(cv2.GaussianBlur(known.astype(np.float32) ** 2, (0, 0), 3.0) - blurred**2, 0))
    inside = cv2.erode(view.shown.astype(np.uint8), np.ones((9, 9), np.uint8)) > 0
    chosen = inside[v, u] & (texture[v, u] > LEAST_TEXTURE)
    u, v = u[chosen], v[chosen]
    if len(u) < LEAST_PIXELS:
        return None
    pixels = np.stack([u, v], axis=1).astype(float)
    moved = pixels + there[v, u]
    nearest = np.clip(np.rint(moved).astype(int), 0, [width - 1, height - 1])
    returned = moved + back[nearest[:, 1], nearest[:, 0]]
    closes = np.linalg.norm(returned - pixels, axis=1) < CLOSING_PX
    closes &= ((moved >= 0) & (moved <= [width - 1, height - 1])).all(axis=1) & valid[nearest[:, 1], nearest[:, 0]]
    return _Flow(pixels, moved, closes)
