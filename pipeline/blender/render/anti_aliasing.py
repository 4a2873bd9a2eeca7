"""Anti-aliased views at about twice the cost of exact ones, with exact depth and masks.

Averaging N samples per pixel costs N times as much as one sample, nearly all of it inside the surface, where
neighbouring rays agree. This module keeps the exact one-ray view and refines its colour in two ways:

* inside the surface, a colour is one lookup in a filtered frame, which approximates the mean over the pixel, or, where
  colours change slowly from pixel to pixel, a mean of neighbouring pixels (:mod:`pipeline.colour.footprint_filter`);
* in pixels at an edge of the surface (:mod:`pipeline.projection.edge_pixels`) or of the observed region, it is the
  mean of N rays (:mod:`pipeline.blender.render.surface_rays`).

Every view is a function of its pose alone: nothing is random or depends on earlier views.
"""

from dataclasses import replace

import bpy
import numpy as np

from ...camera.pinhole import PinholeCamera
from ...colour.footprint_filter import mean_over_pixels, prefiltered
from ...colour.source_view import SourceView
from ...colour.texture_atlas import TextureAtlas
from ...colour.vertex_colours import VertexColours
from ...dataset.view import RenderedView
from ...projection.edge_pixels import edge_pixels, pixel_pattern
from ...transforms import camera_centre, transform_points
from ..bridge.image import new_float_image
from .engines import render_view
from .material import FILTERED_IMAGE, SurfaceColour
from .surface_rays import SurfaceRays
from .surface_scene import SurfaceScene

FOOTPRINT_STEP = 1.25
"""Ratio of successive distances for which the frame is filtered.

A filter for a footprint wrong by half a step costs 0.0002 of SSIM. Replacing the image takes Cycles half of a view's
render time; at 0.9 to 1.1 of the frame's distance, where most views are, no replacement is needed.
"""

SHARP_FOOTPRINT, LARGEST_FOOTPRINT = 0.75, 32.0
"""Texels per pixel. Below the first, a spline is too smooth: views show texels unfiltered, and neighbouring pixels are
averaged as for vertex colours. Above the second, the frame covers only a few pixels of the view."""


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
        self._images: dict[float, bpy.types.Image] = {}

    def render(self, cam_from_model: np.ndarray) -> RenderedView:
        """Render a pose (4x4, mm): anti-aliased colour; depth and observed surface at the pixel centres."""
        filtered = self._fit_filter(cam_from_model)
        exact = render_view(self._surface_scene, cam_from_model)
        edges = edge_pixels(exact.depth_mm, exact.observed, self._camera) | exact.near_unseen
        rgb = np.array(exact.rgb) if filtered else mean_over_pixels(exact.rgb)
        rgb[edges] = self._mean_colours(edges, cam_from_model)
        return replace(exact, rgb=rgb)

    def _mean_colours(self, pixels: np.ndarray, cam_from_model: np.ndarray) -> np.ndarray:
        """``(H, W)`` bool -> ``(P, 3)`` mean colour of the rays in each of these P pixels."""
        v, u = np.nonzero(pixels)
        # float32 is enough from here on: rays are affine in the pixel
        model_from_cam = cam_from_model[:3, :3].T.astype(np.float32)
        centres = self._camera.rays_cam(np.stack([u, v], axis=1)).astype(np.float32) @ model_from_cam.T
        offsets = self._offsets_cam.astype(np.float32) @ model_from_cam[:, :2].T
        directions = centres[:, None] + offsets
        colours = self._rays.colours(camera_centre(cam_from_model), directions.reshape(-1, 3))
        return colours.reshape(directions.shape).mean(axis=1)

    def _fit_filter(self, cam_from_model: np.ndarray) -> bool:
        """Set the filtered frame for the view's distance in the surface's material; False if no filter is needed."""
        colour = self._colour
        if isinstance(colour, VertexColours):
            return False
        frame, pivot = self._source, self._pivot_model[None]
        view_mm, frame_mm = (transform_points(pose, pivot)[0, 2] for pose in (cam_from_model, frame.cam_from_model))
        step = round(np.log(max(view_mm / frame_mm, 1e-6)) / np.log(FOOTPRINT_STEP))
        at_frame = np.sqrt(frame.camera.fx * frame.camera.fy / (self._camera.fx * self._camera.fy))
        footprint = float(np.clip(at_frame * FOOTPRINT_STEP**step, SHARP_FOOTPRINT, LARGEST_FOOTPRINT))
        filtered = footprint > SHARP_FOOTPRINT
        if footprint not in self._images:
            self._images[footprint] = self._new_image(colour, footprint if filtered else None)
        node = self._surface_scene.surface_object.data.materials[0].node_tree.nodes[FILTERED_IMAGE]
        if node.image != self._images[footprint]:
            node.image = self._images[footprint]
            node.interpolation = "Cubic" if filtered else "Linear"
        return filtered

    def _new_image(self, colour: TextureAtlas | SourceView, footprint: float | None) -> bpy.types.Image:
        """The frame or atlas, filtered if a footprint is given; alpha marks the border of the observed region."""
        if isinstance(colour, TextureAtlas):
            known = colour.observed
            border = edge_pixels(known.astype(np.float32), known, self._source.camera)
        else:
            known = colour.depth_mm > 0
            border = edge_pixels(colour.depth_mm, known, colour.camera)
        rgb = colour.image if footprint is None else prefiltered(colour.image, known, footprint)
        with self._surface_scene.owning():
            return new_float_image("filtered frame", np.concatenate([rgb, border[..., None]], axis=2))
