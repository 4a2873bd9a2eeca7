"""Anti-aliased views by Cycles: :mod:`oneframe.colour.anti_aliasing`, with filtered lookups in the material."""

import bpy
import numpy as np

from ...colour.anti_aliasing import filtered_image, footprint_scale
from ...colour.footprint_filter import squares_for
from ...colour.ray_tracer import RayTracer
from ...colour.source_view import SourceView
from ...colour.vertex_colours import VertexColours
from ...projection.rendered_view import RenderedView
from ..bridge.image import new_float_image
from .engines import render_view
from .material import FILTER_LOOKUPS
from .scene_rays import rays_at
from .surface_scene import SurfaceScene


class EdgeSampler:
    """Renders anti-aliased views of a scene; its data-blocks are removed with the scene."""

    def __init__(self, surface_scene: SurfaceScene, source: SourceView, pivot_model: np.ndarray, samples: int) -> None:
        """Prepare the rays.

        Parameters
        ----------
        surface_scene
            A scene with one sample and ``filtered=True``.
        source, pivot_model
            The frame, and the point ``(3,)`` mm whose distance determines the filter.
        samples
            Rays in each pixel at an edge.
        """
        self._surface_scene = surface_scene
        self._source, self._pivot_model = source, pivot_model
        self._colour = surface_scene.colour
        self._tracer = RayTracer(
            surface_scene.mesh,
            surface_scene.camera,
            self._colour,
            unseen=surface_scene.unseen,
            samples=samples,
            rays=rays_at(surface_scene),
        )
        self._images: dict[int, tuple[bpy.types.Image, float]] = {}

    def render(self, cam_from_model: np.ndarray) -> RenderedView:
        """Render a pose (4x4, mm): anti-aliased colour; depth and observed surface at the pixel centres."""
        scale = footprint_scale(self._source, self._pivot_model, self._surface_scene.camera, cam_from_model)
        self._fit_filter(scale)
        return self._tracer.smoothed(render_view(self._surface_scene, cam_from_model), cam_from_model, scale)

    def _fit_filter(self, scale: float) -> None:
        """Set the filtered frames for a view's scale in the surface's material."""
        if self._colour is None or isinstance(self._colour, VertexColours):
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
