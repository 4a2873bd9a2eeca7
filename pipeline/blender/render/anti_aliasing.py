"""Anti-aliased views at about twice the price of exact ones, with exact depth and masks.

Averaging N samples in every pixel costs N times as much as one, and nearly all of it is spent inside the surface, where
neighbouring rays agree. Here the exact one-ray view is kept and its colour is refined in two ways:

* inside the surface a colour is one lookup of a filtered frame that stands for the mean over the pixel, or where
  colours change slowly from pixel to pixel, a mean of neighbouring pixels (:mod:`pipeline.colour.footprint_filter`);
* in pixels at an edge (:mod:`pipeline.projection.edge_pixels`), or where the frame itself has one, it is the mean of
  N rays (:mod:`pipeline.blender.render.surface_rays`).

Every view is a function of its pose alone: nothing is drawn at random or depends on the views before.
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
"""Ratio of neighbouring distances for which the frame is filtered. A filter for a footprint wrong by half a step costs
0.0002 of SSIM; Cycles takes half a frame's time to exchange the image, and at 0.9 to 1.1 of the frame's distance, where
most views are taken, it need not."""

SHARP_FOOTPRINT, LARGEST_FOOTPRINT = 0.75, 32.0
"""Texels a pixel. Below, views show single texels as they are, with means taken in the view as for vertex colours: a
spline is too smooth there. Above, views show the frame at stamp size."""


class EdgeSampler:
    """Renders anti-aliased views of a scene; what it adds to Blender's data is removed with the scene."""

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
            The frame, and the point ``(3,)`` mm to whose distance the filter is fitted.
        colour, camera
            Those of the scene.
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
        """Render a pose: colour anti-aliased, depth and observed surface those of the pixels' centres."""
        filtered = self._fit_filter(cam_from_model)
        exact = render_view(self._surface_scene, cam_from_model)
        edges = edge_pixels(exact.depth_mm, exact.observed, self._camera) | exact.beside_unseen
        rgb = np.array(exact.rgb) if filtered else mean_over_pixels(exact.rgb)
        rgb[edges] = self._mean_colours(edges, cam_from_model)
        return replace(exact, rgb=rgb)

    def _mean_colours(self, pixels: np.ndarray, cam_from_model: np.ndarray) -> np.ndarray:
        """``(H, W)`` bool -> ``(P, 3)`` mean colour of the rays in each of these P pixels."""
        v, u = np.nonzero(pixels)
        # in float32 from here on: rays are affine in the pixel
        model_from_cam = cam_from_model[:3, :3].T.astype(np.float32)
        centres = self._camera.rays_cam(np.stack([u, v], axis=1)).astype(np.float32) @ model_from_cam.T
        offsets = self._offsets_cam.astype(np.float32) @ model_from_cam[:, :2].T
        directions = centres[:, None] + offsets
        colours = self._rays.colours(camera_centre(cam_from_model), directions.reshape(-1, 3))
        return colours.reshape(directions.shape).mean(axis=1)

    def _fit_filter(self, cam_from_model: np.ndarray) -> bool:
        """Give the surface's material the frame as filtered for the view's distance; False if it needs no filter."""
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
        """The frame or atlas, filtered if a footprint is given; alpha marks where what it saw breaks off."""
        if isinstance(colour, TextureAtlas):
            known = colour.observed
            beside = edge_pixels(known.astype(np.float32), known, self._source.camera)
        else:
            known = colour.depth_mm > 0
            beside = edge_pixels(colour.depth_mm, known, colour.camera)
        rgb = colour.image if footprint is None else prefiltered(colour.image, known, footprint)
        with self._surface_scene.owning():
            return new_float_image("filtered frame", np.concatenate([rgb, beside[..., None]], axis=2))
