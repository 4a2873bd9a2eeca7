"""Whether a frame was taken at the focal length of the aligned one.

A longer lens looks like a nearer camera, but for the relief of the surface: it moves by other amounts in the image.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..alignment.reprojection import apply_twist, twist_jacobians
from ..transforms import transform_points
from .blocks import robust_step
from .flow_refinement import FITTED, FlowFit

STEPS, LARGEST_STEP, SETTLED_STEP = 8, 0.1, 0.001
"""Of the fit, how far a step goes at most, and how small the last one is, as the logarithm of the focal length."""
LEAST_CHANGE, LEAST_SIGMAS = 0.15, 3.0
"""How far the focal length must be from the aligned frame's, relatively, and in its standard deviations. A pose 2 px
off and a surface that is not exact look like 11 % at most in "bloster"."""
LASTING, LASTING_CHANGE = 9, 0.06
"""How many frames of a video show a smaller change, in the median, and how small: "bloster" has one of 4 % at most."""


class Zoom(NamedTuple):
    """The focal length of a frame relative to the aligned one's, and the standard deviation of its logarithm."""

    factor: float
    sigma: float


def zoom_of(fit: FlowFit, pivot_model: np.ndarray) -> Zoom:
    """The zoom that fits together with a pose; ``fit`` is at the aligned frame's, ``pivot_model`` ``(3,)`` mm."""
    camera, pose, zoom = fit.camera, fit.cam_from_model, 0.0
    used = fit.returning(FITTED)
    points, moved, pixels = (each[used] for each in (fit.points_model, fit.moved, fit.pixels))
    centre, sigma = np.array([camera.cx, camera.cy]), np.inf
    for _ in range(STEPS):
        zoomed = camera.zoomed(np.exp(zoom))
        position = transform_points(pose, pivot_model[None])
        offsets_cam = (points - pivot_model) @ pose[:3, :3].T
        predicted = zoomed.project(offsets_cam + position)
        jacobian = twist_jacobians(zoomed, offsets_cam[None], position)[0]
        jacobian = np.concatenate([jacobian, (predicted - centre)[:, :, None]], axis=2)
        step, covariance = robust_step(jacobian, moved - predicted, pixels)
        step *= min(1.0, LARGEST_STEP / max(abs(step[6]), 1e-9))
        pose, zoom, sigma = apply_twist(step[:6], pose, pivot_model), zoom + step[6], float(np.sqrt(covariance[6, 6]))
        if abs(step[6]) < SETTLED_STEP:
            break
    return Zoom(float(np.exp(zoom)), sigma)


def has_zoomed(zoom: Zoom, before: Sequence[Zoom] = ()) -> bool:
    """Whether the focal length is clearly another; ``before`` are those of the frames before it in a video."""
    lasting = np.median([*before, zoom][-LASTING:], axis=0)
    known = [(zoom, LEAST_CHANGE)]
    if len(before) >= LASTING - 1:
        known.append((Zoom(*lasting), LASTING_CHANGE))
    return any(abs(factor - 1) > least and abs(np.log(factor)) > LEAST_SIGMAS * s for (factor, s), least in known)
