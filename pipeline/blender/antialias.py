"""Anti-aliased views at about twice the price of exact ones, with exact depth and masks.

Averaging N samples in every pixel costs N times as much as one, and nearly all of it is spent inside the surface, where
neighbouring rays agree. Here the exact one-ray view is kept and its colour is refined in two ways:

* inside the surface a colour is one lookup of a filtered frame that stands for the mean over the pixel
  (:mod:`pipeline.texture_filter`);
* in pixels at an edge (:mod:`pipeline.edge_pixels`), or where the frame itself has one, it is the mean of N rays
  (:mod:`pipeline.blender.surface_rays`).

Every view is a function of its pose alone: nothing is drawn at random or depends on the views before.
"""

from dataclasses import replace

import bpy
import numpy as np

from pipeline.blender.image import new_float_image
from pipeline.blender.material import FILTERED_IMAGE, SurfaceColour
from pipeline.blender.render import RenderedView, render_view
from pipeline.blender.scene import SurfaceScene
from pipeline.blender.source import Source
from pipeline.blender.surface_rays import SurfaceRays
from pipeline.camera import PinholeCamera
from pipeline.colouring import VertexColours
from pipeline.edge_pixels import edge_pixels, pixel_pattern
from pipeline.frames import camera_centre, transform_points
from pipeline.texture_atlas import TextureAtlas
from pipeline.texture_filter import mean_over_pixels, prefiltered
from pipeline.visibility import inverse_depth_map

FOOTPRINT_STEP = 1.25
"""Ratio of neighbouring distances for which the frame is filtered. A filter for a footprint wrong by half a step costs
0.0002 of SSIM; Cycles takes half a frame's time to exchange the image, and at 0.9 to 1.1 of the frame's distance, where
most views are taken, it need not."""

MIN_FOOTPRINT, MAX_FOOTPRINT = 0.25, 32.0
"""Texels a pixel: below, filtering does nothing any more; above, a view shows the frame at stamp size."""


class EdgeSampler:
    """Renders anti-aliased views of a scene; what it adds to Blender's data is removed with the scene."""

    def __init__(
        self, surface_scene: SurfaceScene, source: Source, colour: SurfaceColour, camera: PinholeCamera, samples: int
    ) -> None:
        """Prepare the rays.

        Parameters
        ----------
        surface_scene
            A scene with this colour, one sample and ``filtered=True``.
        source
            The frame, and the point to whose distance the filter is fitted.
        colour, camera
            Those of the scene.
        samples
            Rays in each pixel at an edge.
        """
        self._surface_scene = surface_scene
        self._source = source
        self._colour = colour
        self._camera = camera
        self._rays = SurfaceRays(surface_scene, colour)
        self._offsets_cam = pixel_pattern(samples) / [camera.fx, camera.fy]
        self._images: dict[int, bpy.types.Image] = {}

    def render(self, cam_from_model: np.ndarray) -> RenderedView:
        """Render a pose: colour anti-aliased, depth and observed surface those of the pixels' centres."""
        if not isinstance(self._colour, VertexColours):
            self._fit_filter(cam_from_model)
        exact = render_view(self._surface_scene, cam_from_model)
        edges = edge_pixels(exact.depth_mm, exact.observed, self._camera) | exact.beside_unseen
        # vertex colours have no image to be filtered, but are smooth
        rgb = mean_over_pixels(exact.rgb) if isinstance(self._colour, VertexColours) else np.array(exact.rgb)
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

    def _fit_filter(self, cam_from_model: np.ndarray) -> None:
        """Give the surface's material the frame as filtered for the view's distance."""
        view, pivot = self._source.view, self._source.pivot_model[None]
        distance, in_frame = (transform_points(pose, pivot)[0, 2] for pose in (cam_from_model, view.cam_from_model))
        finest, coarsest = (
            np.log(limit / self._footprint_at_frame) / np.log(FOOTPRINT_STEP)
            for limit in (MIN_FOOTPRINT, MAX_FOOTPRINT)
        )
        step = np.log(max(distance / in_frame, 1e-6)) / np.log(FOOTPRINT_STEP)
        step = round(float(np.clip(step, finest, coarsest)))
        if step not in self._images:
            self._images[step] = self._filtered_image(self._footprint_at_frame * FOOTPRINT_STEP**step)
        node = self._surface_scene.surface_object.data.materials[0].node_tree.nodes[FILTERED_IMAGE]
        if node.image != self._images[step]:
            node.image = self._images[step]

    @property
    def _footprint_at_frame(self) -> float:
        """Frame pixels to a view's pixel at the frame's own distance."""
        frame, view = self._source.view.camera, self._camera
        return float(np.sqrt(frame.fx * frame.fy / (view.fx * view.fy)))

    def _filtered_image(self, footprint: float) -> bpy.types.Image:
        """The frame or atlas for this footprint; alpha marks the texels beside those that hold no surface."""
        colour = self._colour
        if isinstance(colour, TextureAtlas):
            known = colour.observed
            beside = edge_pixels(known.astype(np.float32), known, self._source.view.camera)
        else:
            known = colour.inverse_depth > 0
            beside = edge_pixels(inverse_depth_map(colour.inverse_depth), known, colour.camera)
        rgb = prefiltered(colour.image, known, footprint)
        with self._surface_scene.owning():
            return new_float_image("filtered frame", np.concatenate([rgb, beside[..., None]], axis=2))
