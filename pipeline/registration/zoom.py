"""Whether a frame was taken at the focal length of the aligned one.

A longer lens looks like a nearer camera, but for the relief of the surface: it moves by other amounts in the image.
"""

from dataclasses import replace

import numpy as np

from ..alignment.reprojection import apply_twist, twist_jacobians
from ..transforms import transform_points
from .blocks import robust_step
from .flow_refinement import FlowFit

STEPS = 8
LEAST_CHANGE, LEAST_SIGMAS = 0.03, 4.0
"""How far the focal length must be from the aligned frame's, relatively and in its standard deviations."""


def zoom_of(fit: FlowFit, pivot_model: np.ndarray) -> tuple[float, float]:
    """The focal length of a frame relative to the aligned one's, found together with the pose, and its logarithm's σ.

    ``fit`` is at the aligned frame's focal length; ``pivot_model`` is ``(3,)`` mm.
    """
    camera, pose, zoom = fit.camera, fit.cam_from_model, 0.0
    used = np.isfinite(fit.residuals_px)
    used[used] = np.arange(np.count_nonzero(used)) % max(1, np.count_nonzero(used) // 2000) == 0
    points, moved, pixels = (each[used] for each in (fit.points_model, fit.moved, fit.pixels))
    centre, sigma = np.array([camera.cx, camera.cy]), np.inf
    for _ in range(STEPS):
        zoomed = replace(camera, fx=camera.fx * np.exp(zoom), fy=camera.fy * np.exp(zoom))
        position = transform_points(pose, pivot_model[None])
        offsets_cam = (points - pivot_model) @ pose[:3, :3].T
        predicted = zoomed.project(offsets_cam + position)
        jacobian = twist_jacobians(zoomed, offsets_cam[None], position)[0]
        jacobian = np.concatenate([jacobian, (predicted - centre)[:, :, None]], axis=2)
        step, covariance = robust_step(jacobian, moved - predicted, pixels)
        pose, zoom, sigma = apply_twist(step[:6], pose, pivot_model), zoom + step[6], float(np.sqrt(covariance[6, 6]))
    return float(np.exp(zoom)), sigma


def zoom_reason(zoom: float, sigma: float) -> str:
    """A sentence if the focal length has clearly changed; empty otherwise."""
    if abs(zoom - 1) < LEAST_CHANGE or abs(np.log(zoom)) < LEAST_SIGMAS * sigma:
        return ""
    return f"the zoom is not that of the case's frame: about {zoom:.2g} times"
