"""The engine ``cycles``: one exact ray a pixel, with filtered lookups and more rays at edges for anti-aliased views.

Cycles' passes are read from memory before its render call returns.
"""

from collections.abc import Iterator
from contextlib import contextmanager

import bpy
import numpy as np

from ...camera.pinhole import PinholeCamera
from ...colour.anti_aliasing import filtered_image, footprint_scale
from ...colour.footprint_filter import squares_for
from ...colour.ray_tracer import RayTracer
from ...colour.seen_frame import SeenFrame
from ...colour.shading import ColouredSurface
from ...process.own_process import delayed_interrupts
from ...projection.rendered_view import Render, RenderedView
from ..bridge.image import new_float_image
from .engines import Engine
from .material import filter_lookups
from .surface_scene import SurfaceScene


@contextmanager
def _opened(surface: ColouredSurface, camera: PinholeCamera, samples: int, threads: int) -> Iterator[Render]:
    with CyclesScene(surface, camera, filtered=samples > 1) as scene:
        scene.limit_threads(threads)
        yield scene.render if samples == 1 else EdgeSampler(scene, samples).render


ENGINE = Engine(_opened)


class CyclesScene(SurfaceScene):
    """A scene that Cycles renders."""

    def _set_engine(self, filter_px: float) -> None:
        self.scene.render.engine = "CYCLES"
        cycles = self.scene.cycles
        cycles.device = "CPU"
        cycles.samples = self._samples
        cycles.use_adaptive_sampling = cycles.use_denoising = cycles.use_auto_tile = False
        # since 5.x tiles cannot be switched off
        cycles.tile_size = 8192
        cycles.pixel_filter_type, cycles.filter_width = "BOX", filter_px
        cycles.seed, cycles.use_animated_seed = 0, False
        cycles.max_bounces = cycles.transparent_max_bounces = 0
        cycles.use_light_tree = cycles.caustics_reflective = cycles.caustics_refractive = False
        # else faint light is sampled at random
        cycles.light_sampling_threshold = 0.0
        cycles.sample_clamp_direct = cycles.sample_clamp_indirect = 0.0

    def _passes(self) -> dict[str, np.ndarray]:
        with _collected_passes() as results, delayed_interrupts():
            bpy.ops.render.render(scene=self.scene.name)
        if not results:
            raise RuntimeError("Cycles ended without a result")
        return results[-1]


@contextmanager
def _collected_passes() -> Iterator[list[dict[str, np.ndarray]]]:
    """Collect the passes of Cycles renders inside the block.

    Only the engine itself can read a render result. Cycles is an engine written in Python around a library, and Blender
    looks up its ``render_frame_finish`` at every call. So this block replaces that method by one that also reads the
    result.
    """
    import cycles

    engine, original = cycles.CyclesRender, cycles.CyclesRender.render_frame_finish
    results: list[dict[str, np.ndarray]] = []

    def finish_and_read(self: bpy.types.RenderEngine) -> None:
        # views of more than 8192 px are rendered in tiles, which are put together here
        original(self)
        result = self.get_result()
        results.append({p.name: _pass_array(p, result.resolution_y) for p in result.layers[0].passes})

    engine.render_frame_finish = finish_and_read
    try:
        yield results
    finally:
        engine.render_frame_finish = original


def _pass_array(render_pass: bpy.types.RenderPass, height: int) -> np.ndarray:
    values = np.empty(len(render_pass.rect) * render_pass.channels, np.float32)
    render_pass.rect.foreach_get(values)
    return values.reshape(height, -1, render_pass.channels)[::-1]


class EdgeSampler:
    """Renders anti-aliased views of a scene, see :mod:`oneframe.colour.anti_aliasing`.

    Its data-blocks are removed with the scene.
    """

    def __init__(self, scene: CyclesScene, samples: int) -> None:
        """Prepare the rays.

        Parameters
        ----------
        scene
            Built with ``filtered=True`` and one sample.
        samples
            Rays in each pixel at an edge.
        """
        self._scene, self._surface = scene, scene.surface
        self._tracer = RayTracer(scene.surface, scene.camera, samples=samples)
        self._images: dict[tuple[int, int], tuple[bpy.types.Image, float]] = {}

    def render(self, cam_from_model: np.ndarray) -> RenderedView:
        """Render a pose (4x4, mm): anti-aliased colour; depth and observed surface at the pixel centres."""
        for number, colour in enumerate(self._surface.colours):
            if isinstance(colour, SeenFrame):
                scale = footprint_scale(colour, self._surface.pivot_model, self._scene.camera, cam_from_model)
                self._fit_filter(number, colour, scale)
        return self._tracer.smoothed(self._scene.render(cam_from_model), cam_from_model)

    def _fit_filter(self, number: int, source: SeenFrame, scale: float) -> None:
        """Set the filtered frame for a view's scale in the surface's material."""
        side, offset = squares_for(scale)
        if (number, side) not in self._images:
            filtered, place = filtered_image(source, side)
            with self._scene.owning():
                self._images[number, side] = new_float_image("filtered frame", filtered), place
        image, place = self._images[number, side]
        nodes = self._scene.surface_object.data.materials[0].node_tree.nodes
        signs = ((-1, -1), (1, -1), (-1, 1), (1, 1))
        for (offset_name, image_name), (right, down) in zip(filter_lookups(number), signs, strict=True):
            if nodes[image_name].image != image:
                nodes[image_name].image = image
            moved = (right * offset - place) / image.size[0], (place - down * offset) / image.size[1], 0.0
            value = nodes[offset_name].inputs[1]
            if not np.array_equal(value.default_value, np.array(moved, np.float32)):
                value.default_value = moved
