"""Anti-aliased colour for exact views, at a fraction of the cost of many samples in every pixel.

A renderer's own N samples per pixel cost nearly N times one sample, nearly all of it inside the surface, where
neighbouring rays agree. This module keeps the exact one-ray view and refines its colour in two ways:

* inside the surface, a colour is a lookup in the frame, or, in views that are coarser than the frame, a mean of four
  (:mod:`oneframe.colour.footprint_filter`). Vertex colours are means of neighbouring pixels there;
* in pixels at an edge of the surface (:mod:`oneframe.projection.edge_pixels`) or of the observed region, it is the
  mean of N rays.

A pixel's colour is that of what its masks say. Of the N rays, those count that meet what the ray through the centre
does: surface that the frame saw, or surface that it did not see. A pixel whose centre is off the surface is background.
So nothing mixes with black at silhouettes, nor with grey where the observed region ends; edges inside the surface are
smooth.

Every view is a function of its pose alone: nothing is random or depends on earlier views.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ..camera.pinhole import PinholeCamera
from ..projection.edge_pixels import edge_pixels
from ..projection.rendered_view import RenderedView
from ..transforms import transform_points
from .footprint_filter import averaged, mean_over_pixels
from .seen_frame import SeenFrame

MISSED, UNSEEN, OBSERVED = 0, 1, 2
"""What a ray meets: no surface, surface that the frame did not see, surface that it saw."""

CastRays = Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]
"""Casts N rays, at the places of :func:`.pixel_pattern`, in each of P pixels.

From ``(P,)`` columns and rows, to ``(P, N, 3)`` colours, and ``(P, N)`` what the rays meet. Rays at texels average to a
square's mean. In enlarged views, interpolated ones are mixed in so that the variance of the weights stays that of the
interpolant inside the surface: of the nearest texel there is a share of the squared scale, at most 1.
"""


def footprint_scale(
    source: SeenFrame, pivot_model: np.ndarray, camera: PinholeCamera, cam_from_model: np.ndarray
) -> float:
    """Side of a view's pixel in frame pixels, at the point ``(3,)`` mm."""
    view_mm, frame_mm = (
        transform_points(pose, pivot_model[None])[0, 2] for pose in (cam_from_model, source.cam_from_model)
    )
    at_frame = np.sqrt(source.camera.fx * source.camera.fy / (camera.fx * camera.fy))
    return float(at_frame * max(view_mm / frame_mm, 1e-6))


def filtered_image(source: SeenFrame, side: int) -> tuple[np.ndarray, float]:
    """The frame, averaged over squares of ``side`` pixels; alpha marks the border of the observed region.

    Returns
    -------
    ``(H, W, 4)`` float32, and the place of its squares: see :func:`.averaged`.
    """
    image, surface = source.continued
    known = surface > 0
    depth_mm = np.divide(1.0, surface, out=np.zeros_like(surface), where=known)
    border = edge_pixels(depth_mm, known, source.camera)
    rgb, place = averaged(image, known, side)
    return np.concatenate([rgb, border[..., None]], axis=2), place


def smoothed(
    exact: RenderedView, camera: PinholeCamera, cast: CastRays, *, vertex_scale: np.ndarray | None
) -> RenderedView:
    """An exact view, whose colours are filtered unless they are those of vertices, with means of rays at edges.

    ``vertex_scale`` ``(H, W)`` are the :func:`footprint_scale` of pixels whose colours are those of vertices.
    """
    edges = (edge_pixels(exact.depth_mm, exact.observed, camera) | exact.near_unseen) & exact.mask
    rgb = np.array(exact.rgb) if vertex_scale is None else mean_over_pixels(exact.rgb, vertex_scale[..., None])
    v, u = np.nonzero(edges)
    colours, kinds = cast(u, v)
    same = (kinds == np.where(exact.observed[v, u], OBSERVED, UNSEEN)[:, None])[..., None]
    count = same.sum(axis=1)
    means = (colours * same).sum(axis=1) / np.maximum(count, 1)
    # where no ray meets what the centre does, it is the centre's colour
    rgb[edges] = np.where(count > 0, means, exact.rgb[v, u])
    rgb[~exact.mask] = 0
    return replace(exact, rgb=rgb)
