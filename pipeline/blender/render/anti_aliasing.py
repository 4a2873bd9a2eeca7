"""Anti-aliased views at about twice the cost of exact ones, with exact depth and masks.

Averaging N samples per pixel costs N times as much as one sample, nearly all of it inside the surface, where
neighbouring rays agree. This module keeps the exact one-ray view and refines its colour in two ways:

* inside the surface, a colour is a lookup in the frame, or, in views that are coarser than the frame, a mean of four
  (:mod:`pipeline.colour.footprint_filter`). Vertex colours are means of neighbouring pixels there;
* in pixels at an edge of the surface (:mod:`pipeline.projection.edge_pixels`) or of the observed region, it is the
  mean of N rays (:mod:`pipeline.blender.render.surface_rays`).

A pixel's colour is that of what its masks say. Of the N rays, those count that meet what the ray through the centre
does: surface that the frame saw, or surface that it did not see. A pixel whose centre is off the surface is background.
So nothing mixes with black at silhouettes, nor with grey where the observed region ends; edges inside the surface are
smooth.

Every view is a function of its pose alone: nothing is random or depends on earlier views.
"""

from dataclasses import replace

import bpy
import numpy as np

from ...camera.pinhole import PinholeCamera
from ...colour.footprint_filter import averaged, mean_over_pixels, squares_for
from ...colour.source_view import SourceView
from ...colour.texture_atlas import TextureAtlas
from ...colour.vertex_colours import VertexColours
from ...dataset.view import RenderedView
from ...projection.edge_pixels import edge_pixels, pixel_pattern
from ...transforms import camera_centre, transform_points
from ..bridge.image import new_float_image
from .engines import render_view
from .material import FILTER_LOOKUPS, SurfaceColour
from .surface_rays import OBSERVED, UNSEEN, SurfaceRays
from .surface_scene import SurfaceScene


class EdgeSampler:
    """Renders anti-aliased views of a scene; its data-blocks are removed with the scene."""

    def __init__(
        self,
        surface_scene: SurfaceScene,
        source: SourceView,
        pivot_model: np.ndarray,
        colour: SurfaceColour,
        camera: PinholeCamera,
        samples: int,
    ) -> None:
        """Prepare the rays.

        Parameters
        ----------
        surface_scene
            A scene with this colour, one sample and ``filtered=True``.
        source, pivot_model
            The frame, and the point ``(3,)`` mm whose distance determines the filter.
        colour, camera
            The scene's colour and intrinsics.
        samples
            Rays in each pixel at an edge.
        """
        self._surface_scene = surface_scene
        self._source, self._pivot_model = source, pivot_model
        self._colour = colour
        self._camera = camera
        self._rays = SurfaceRays(surface_scene, colour)
        self._offsets_cam = pixel_pattern(samples) / [camera.fx, camera.fy]
        self._images: dict[int, tuple[bpy.types.Image, float]] = {}

    def render(self, cam_from_model: np.ndarray) -> RenderedView:
        """Render a pose (4x4, mm): anti-aliased colour; depth and observed surface at the pixel centres."""
        scale = self._scale(cam_from_model)
        self._fit_filter(scale)
        exact = render_view(self._surface_scene, cam_from_model)
        edges = (edge_pixels(exact.depth_mm, exact.observed, self._camera) | exact.near_unseen) & exact.mask
        rgb = mean_over_pixels(exact.rgb, scale) if isinstance(self._colour, VertexColours) else np.array(exact.rgb)
        rgb[edges] = self._mean_colours(edges, exact, cam_from_model, scale)
        rgb[~exact.mask] = 0
        return replace(exact, rgb=rgb)

    def _mean_colours(
        self, pixels: np.ndarray, exact: RenderedView, cam_from_model: np.ndarray, scale: float
    ) -> np.ndarray:
        """``(H, W)`` bool -> ``(P, 3)`` for each of these P pixels the mean of its rays that meet what its centre does.

        Where none does, it is the centre's colour.
        """
        v, u = np.nonzero(pixels)
        # float32 is enough from here on: rays are affine in the pixel
        model_from_cam = cam_from_model[:3, :3].T.astype(np.float32)
        centres = self._camera.rays_cam(np.stack([u, v], axis=1)).astype(np.float32) @ model_from_cam.T
        offsets = self._offsets_cam.astype(np.float32) @ model_from_cam[:, :2].T
        directions = (centres[:, None] + offsets).reshape(-1, 3)
        # rays at texels average to a square's mean. In enlarged views, interpolated ones are mixed in so that the
        # variance of the weights stays that of the interpolant inside the surface
        share = min(scale * scale, 1.0)
        colours, kinds = self._rays.cast(camera_centre(cam_from_model), directions, texel_share=share)
        rays = len(u), len(self._offsets_cam)
        colours, kinds = colours.reshape(*rays, 3), kinds.reshape(rays)
        same = (kinds == np.where(exact.observed[v, u], OBSERVED, UNSEEN)[:, None])[..., None]
        count = same.sum(axis=1)
        means = (colours * same).sum(axis=1) / np.maximum(count, 1)
        return np.where(count > 0, means, exact.rgb[v, u])

    def _scale(self, cam_from_model: np.ndarray) -> float:
        """Side of a view's pixel in frame pixels, at the pivot."""
        frame, pivot = self._source, self._pivot_model[None]
        view_mm, frame_mm = (transform_points(pose, pivot)[0, 2] for pose in (cam_from_model, frame.cam_from_model))
        at_frame = np.sqrt(frame.camera.fx * frame.camera.fy / (self._camera.fx * self._camera.fy))
        return float(at_frame * max(view_mm / frame_mm, 1e-6))

    def _fit_filter(self, scale: float) -> None:
        """Set the filtered frames for a view's scale in the surface's material."""
        colour = self._colour
        if isinstance(colour, VertexColours):
            return
        side, offset = squares_for(scale)
        if side not in self._images:
            self._images[side] = self._new_image(colour, side)
        image, place = self._images[side]
        nodes = self._surface_scene.surface_object.data.materials[0].node_tree.nodes
        signs = ((-1, -1), (1, -1), (-1, 1), (1, 1))
        for (offset_name, image_name), (right, down) in zip(FILTER_LOOKUPS, signs, strict=True):
            if nodes[image_name].image != image:
                nodes[image_name].image = image
            moved = (right * offset - place) / image.size[0], (place - down * offset) / image.size[1], 0.0
            value = nodes[offset_name].inputs[1]
            if not np.array_equal(value.default_value, np.array(moved, np.float32)):
                value.default_value = moved

    def _new_image(self, colour: TextureAtlas | SourceView, side: int) -> tuple[bpy.types.Image, float]:
        """The averaged frame or atlas; alpha marks the border of the observed region. And the place of its squares."""
        if isinstance(colour, TextureAtlas):
            texels, known = colour.image, colour.observed
            border = edge_pixels(known.astype(np.float32), known, self._source.camera)
        else:
            texels, surface = colour.continued
            known = surface > 0
            depth_mm = np.divide(1.0, surface, out=np.zeros_like(surface), where=known)
            border = edge_pixels(depth_mm, known, colour.camera)
        rgb, place = averaged(texels, known, side)
        with self._surface_scene.owning():
            image = new_float_image("filtered frame", np.concatenate([rgb, border[..., None]], axis=2))
        return image, place
