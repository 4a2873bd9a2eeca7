"""One view of a surface from several, each coloured from another source frame: of every pixel the best one.

The best of those that saw the surface at the pixel's centre is the one with the smallest angle between its ray and the
surface's normal: it shows the surface least foreshortened. Nothing is blended, and exposures are taken as they are.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..camera.pinhole import PinholeCamera
from ..projection.rendered_view import RenderedView
from ..transforms import camera_centre, transform_points
from .source_view import SourceView


def best_of(
    views: Sequence[RenderedView], sources: Sequence[SourceView], camera: PinholeCamera, cam_from_model: np.ndarray
) -> RenderedView:
    """Join views of one pose (4x4, mm), which differ in the source of their colour alone.

    What no source saw is as in the first view; observed is what any saw.
    """
    rays = camera.rays_cam(camera.pixel_grid())
    normals = _normals_cam(views[0].depth_mm, rays, camera)
    cosines = np.full((len(views), *camera.shape_hw), -1.0)
    for view, source, cosine in zip(views, sources, cosines, strict=True):
        seen = view.observed
        centre_cam = transform_points(cam_from_model, camera_centre(source.cam_from_model)[None])[0]
        direction = centre_cam - rays[seen] * view.depth_mm[seen, None]
        cosine[seen] = np.abs((normals[seen] * direction).sum(axis=1)) / np.linalg.norm(direction, axis=1)
    best = cosines.argmax(axis=0)
    rgb, observed, near = (
        np.choose(best if stack.ndim == 3 else best[..., None], stack)
        for stack in (np.stack([getattr(view, name) for view in views]) for name in ("rgb", "observed", "near_unseen"))
    )
    return replace(views[0], rgb=rgb, observed=observed, near_unseen=near)


def _normals_cam(depth_mm: np.ndarray, rays: np.ndarray, camera: PinholeCamera) -> np.ndarray:
    """``(H, W, 3)`` unit normals of the surface at the pixels, up to their sign.

    On a plane n X = 1, the inverse depth at a ray r is n r: an affine function of the pixel, whose steps to the
    neighbours give n. Of the two steps along an axis the smaller one is taken, which crosses no edge.
    """
    inverse = np.divide(1.0, depth_mm, out=np.zeros(depth_mm.shape), where=depth_mm > 0)
    slopes = []
    for axis, focal in ((1, camera.fx), (0, camera.fy)):
        step = np.diff(inverse, axis=axis)
        before = np.insert(step, 0, np.inf, axis=axis)
        after = np.insert(step, step.shape[axis], np.inf, axis=axis)
        slopes.append(focal * np.where(np.abs(before) < np.abs(after), before, after))
    across, down = slopes
    normals = np.stack([across, down, inverse - across * rays[..., 0] - down * rays[..., 1]], axis=-1)
    return normals / np.maximum(np.linalg.norm(normals, axis=-1, keepdims=True), 1e-300)
