"""Anti-aliased views by Cycles: :mod:`oneframe.colour.anti_aliasing`, with filtered lookups in the material."""

import bpy
import numpy as np

from ...camera.pinhole import PinholeCamera
from ...colour.anti_aliasing import filtered_image, footprint_scale, smoothed
from ...colour.footprint_filter import squares_for
from ...colour.shading import SurfaceColour
from ...colour.source_view import SourceView
from ...colour.vertex_colours import VertexColours
from ...projection.edge_pixels import pixel_pattern
from ...projection.rendered_view import RenderedView
from ...transforms import camera_centre
from ..bridge.image import new_float_image
from .engines import render_view
from .material import FILTER_LOOKUPS
from .surface_rays import SurfaceRays
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
        scale = footprint_scale(self._source, self._pivot_model, self._camera, cam_from_model)
        self._fit_filter(scale)
        exact = render_view(self._surface_scene, cam_from_model)

        def cast(u: np.ndarray, v: np.ndarray, texel_share: float) -> tuple[np.ndarray, np.ndarray]:
            # float32 is enough from here on: rays are affine in the pixel
            model_from_cam = cam_from_model[:3, :3].T.astype(np.float32)
            centres = self._camera.rays_cam(np.stack([u, v], axis=1)).astype(np.float32) @ model_from_cam.T
            offsets = self._offsets_cam.astype(np.float32) @ model_from_cam[:, :2].T
            directions = (centres[:, None] + offsets).reshape(-1, 3)
            colours, kinds = self._rays.cast(camera_centre(cam_from_model), directions, texel_share=texel_share)
            rays = len(u), len(self._offsets_cam)
            return colours.reshape(*rays, 3), kinds.reshape(rays)

        return smoothed(exact, self._camera, scale, cast, vertex_colours=isinstance(self._colour, VertexColours))

    def _fit_filter(self, scale: float) -> None:
        """Set the filtered frames for a view's scale in the surface's material."""
        if isinstance(self._colour, VertexColours):
            return
        side, offset = squares_for(scale)
        if side not in self._images:
            filtered, place = filtered_image(self._colour, self._source, side)
            with self._surface_scene.owning():
                self._images[side] = new_float_image("filtered frame", filtered), place
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
