"""Anti-aliased views by Cycles: :mod:`oneframe.colour.anti_aliasing`, with filtered lookups in the material."""

import bpy
import numpy as np

from ...colour.anti_aliasing import filtered_image, footprint_scale
from ...colour.footprint_filter import squares_for
from ...colour.ray_tracer import RayTracer
from ...colour.shading import source_of
from ...colour.source_view import SourceView
from ...colour.texture_atlas import TextureAtlas
from ...colour.vertex_colours import VertexColours
from ...projection.rendered_view import RenderedView
from ..bridge.image import new_float_image
from .engines import render_view
from .material import filter_lookups
from .scene_rays import rays_at
from .surface_scene import SurfaceScene


class EdgeSampler:
    """Renders anti-aliased views of a scene; its data-blocks are removed with the scene."""

    def __init__(self, surface_scene: SurfaceScene, pivot_model: np.ndarray, samples: int) -> None:
        """Prepare the rays.

        Parameters
        ----------
        surface_scene
            A scene with one sample and ``filtered=True``.
        pivot_model
            The point ``(3,)`` mm whose distance determines the filter.
        samples
            Rays in each pixel at an edge.
        """
        self._surface_scene, self._pivot_model = surface_scene, pivot_model
        self._tracer = RayTracer(
            surface_scene.mesh,
            surface_scene.camera,
            *surface_scene.colours,
            unseen=surface_scene.unseen,
            samples=samples,
            pivot_model=pivot_model,
            rays=rays_at(surface_scene),
        )
        self._images: dict[tuple[int, int], tuple[bpy.types.Image, float]] = {}

    def render(self, cam_from_model: np.ndarray) -> RenderedView:
        """Render a pose (4x4, mm): anti-aliased colour; depth and observed surface at the pixel centres."""
        for number, colour in enumerate(self._surface_scene.colours):
            source = source_of(colour)
            if source is not None and not isinstance(colour, VertexColours):
                scale = footprint_scale(source, self._pivot_model, self._surface_scene.camera, cam_from_model)
                self._fit_filter(number, colour, source, scale)
        return self._tracer.smoothed(render_view(self._surface_scene, cam_from_model), cam_from_model)

    def _fit_filter(self, number: int, colour: TextureAtlas | SourceView, source: SourceView, scale: float) -> None:
        """Set the filtered frame for a view's scale in the surface's material."""
        side, offset = squares_for(scale)
        if (number, side) not in self._images:
            filtered, place = filtered_image(colour, source, side)
            with self._surface_scene.owning():
                self._images[number, side] = new_float_image("filtered frame", filtered), place
        image, place = self._images[number, side]
        nodes = self._surface_scene.surface_object.data.materials[0].node_tree.nodes
        signs = ((-1, -1), (1, -1), (-1, 1), (1, 1))
        for (offset_name, image_name), (right, down) in zip(filter_lookups(number), signs, strict=True):
            if nodes[image_name].image != image:
                nodes[image_name].image = image
            moved = (right * offset - place) / image.size[0], (place - down * offset) / image.size[1], 0.0
            value = nodes[offset_name].inputs[1]
            if not np.array_equal(value.default_value, np.array(moved, np.float32)):
                value.default_value = moved
