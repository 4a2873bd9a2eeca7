"""Refine a pose by rendering and optical flow: where the known view of a pose would have to move to lie on the frame.

A view stands for poses around its own, as a keyframe: the frame is laid on it by the pose, and only what is left is
searched for, from no motion. The flow is that of dense inverse search (Kroeger et al. 2016), there and back: where both
disagree, the frame shows something else than the surface.
"""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np

from ..alignment.levenberg_marquardt import Loss, fit_poses
from ..alignment.reprojection import Correspondences, Poses
from ..camera.pinhole import PinholeCamera
from ..light.local_mean import without_light
from ..transforms import transform_points
from .known_views import KnownView, KnownViews

ROUNDS, STEPS = 4, 15
"""Rounds of flow and fit, and steps of a fit."""
SETTLED_PX = 3.0
"""Mean movement below which no further round follows: flow is no less exact over it."""

CLOSING_PX = 1.0
"""Flow there and back that misses the pixel by more is not used."""

LOSS_PX = 1.0
FITTED = 1500
"""Pixels of which a pose is fitted at most: its neighbours' flow says nothing else."""
CONVERGED_PX = 0.1
"""Movement of all of them together below which a fit ends: 0.003 px each."""
LEAST_PIXELS = 30


@dataclass(frozen=True)
class FlowFit:
    """A pose refined by flow.

    Attributes
    ----------
    cam_from_model
        ``(4, 4)``, mm.
    camera
        That of the frame.
    pixels
        ``(N, 2)`` where the pose places textured points of the surface in the frame, inside of it.
    residuals_px
        ``(N,)`` how far each lies from where the frame shows it; infinite where the flow does not come back.
    points_model, moved
        ``(N, 3)`` the points, and ``(N, 2)`` where the frame shows them.
    codes
        ``(N, 2)`` code values, without light, of the known view and of the frame there.
    """

    cam_from_model: np.ndarray
    camera: PinholeCamera
    pixels: np.ndarray
    residuals_px: np.ndarray
    points_model: np.ndarray
    moved: np.ndarray
    codes: np.ndarray

    def returning(self, most: int) -> np.ndarray:
        """``(M,)`` numbers of points whose flow comes back, evenly chosen: about ``most`` of them."""
        numbers = np.flatnonzero(np.isfinite(self.residuals_px))
        return numbers[:: max(1, len(numbers) // most)]


class _Flow(NamedTuple):
    """Where a frame shows a known view's textured points ``(N, 2)``, whether it does, and code values ``(N, 2)``."""

    moved: np.ndarray
    closes: np.ndarray
    codes: np.ndarray


def refined_by_flow(
    views: KnownViews, grey: np.ndarray, valid: np.ndarray, cam_from_model: np.ndarray
) -> FlowFit | None:
    """The pose near a rough one ``(4, 4)`` at which the known view lies on a frame; ``None`` if there is none.

    ``grey`` is ``(H, W)`` uint8, ``valid`` ``(H, W)`` bool: pixels that may be used.
    """
    frame, pose, view = without_light(grey, valid), cam_from_model, views.near(cam_from_model)
    for last in (*[False] * (ROUNDS - 1), True):
        if len(view.textured) < LEAST_PIXELS:
            return None
        flow = _flow(view, frame, valid, pose)
        if np.count_nonzero(flow.closes) < LEAST_PIXELS:
            return None
        points, camera, before = view.points, view.camera, pose
        pose = _fitted(points[flow.closes], flow.moved[flow.closes], camera, pose)
        placed = camera.project(transform_points(pose, points))
        shift_px = float(np.linalg.norm(placed - camera.project(transform_points(before, points)), axis=1).mean())
        if last or not shift_px > SETTLED_PX:
            inside = ((placed >= 0) & (placed <= np.array(camera.size_wh) - 1)).all(axis=1)
            residuals_px = np.where(flow.closes, np.linalg.norm(flow.moved - placed, axis=1), np.inf)
            placed, residuals_px, points, moved, codes = (
                each[inside] for each in (placed, residuals_px, points, flow.moved, flow.codes)
            )
            return FlowFit(pose, camera, placed, residuals_px, points, moved, codes)
        view = views.near(pose)
    return None


def _fitted(points: np.ndarray, pixels: np.ndarray, camera: PinholeCamera, start: np.ndarray) -> np.ndarray:
    chosen = slice(None, None, max(1, len(points) // FITTED))
    known = Correspondences.about(points[chosen], pixels[chosen], camera)
    poses, _ = fit_poses(
        known,
        Poses.of(start[None], known.pivot_model),
        loss=Loss(LOSS_PX),
        iterations=STEPS,
        converged_px=CONVERGED_PX,
    )
    return poses.matrix(0, known.pivot_model)


def _dense_flow(preset: int, one: np.ndarray, other: np.ndarray) -> np.ndarray:
    return cv2.DISOpticalFlow.create(preset).calc(one, other, np.zeros((*one.shape, 2), np.float32))


def _flow(view: KnownView, frame: np.ndarray, valid: np.ndarray, cam_from_model: np.ndarray) -> _Flow:
    """The flow from a known view to a frame that is laid on it by a rough pose."""
    known, place = view.detail, view.placed(cam_from_model)
    x, y = cv2.split(place)
    laid = cv2.remap(frame, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    usable = cv2.remap(valid.astype(np.uint8), x, y, cv2.INTER_NEAREST) > 0
    # what the view does not show is the frame's own: no false edge at the border
    shown = np.where(view.shown, known, laid)
    # the way back only tests, to a pixel
    presets = cv2.DISOPTICAL_FLOW_PRESET_MEDIUM, cv2.DISOPTICAL_FLOW_PRESET_FAST
    with ThreadPoolExecutor(2) as both:
        there, back = both.map(_dense_flow, presets, (shown, laid), (laid, shown))
    height, width = frame.shape
    u, v = view.textured.T
    moved = view.textured + there[v, u]
    to_u, to_v = moved.astype(np.float32).T[..., None]
    codes, returns, fits = (cv2.remap(each, to_u, to_v, cv2.INTER_LINEAR)[:, 0] for each in (laid, back, place))
    closes = np.linalg.norm(there[v, u] + returns, axis=1) < CLOSING_PX
    column, row = np.clip(np.rint(moved).astype(int), 0, [width - 1, height - 1]).T
    closes &= ((moved >= 0) & (moved <= [width - 1, height - 1])).all(axis=1) & usable[row, column]
    return _Flow(fits.astype(float), closes, np.stack([known[v, u], codes], axis=1).astype(float))
