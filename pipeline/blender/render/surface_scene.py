"""A Blender scene from data: one surface, one camera, and settings that keep colours and geometry exact."""

from collections.abc import Iterator
from contextlib import contextmanager

import bpy
import numpy as np

from ...camera.pinhole import PinholeCamera
from ...colour.shading import SurfaceColour
from ...errors import InputError
from ...surface.mesh import TriangleMesh
from ..bridge.camera import new_camera, place_camera, set_clip
from ..bridge.data_blocks import data_blocks, new_mesh_object, remove_data
from ..bridge.versions import ENGINE_IDS
from .material import OBSERVED_PASS, SOURCE_PASS, assign_colour

POINT_FILTER_PX = 0.01
"""Width of the pixel filter with one sample: practically the pixel's centre (0 is not allowed)."""

LARGEST_VIEW_PX = 8192**2
"""Pixels of a view: with its passes it takes 7 GB."""
LARGEST_SIDE_PX = 16_384
"""Of a view by Eevee: with more, OpenGL has no memory, and Eevee shows nothing without an error."""


class SurfaceScene:
    """A coloured surface and a pinhole camera in a separate Blender scene; use as a context manager.

    Attributes
    ----------
    scene, camera_object, surface_object
        The Blender data; removed on exit, so that the open file is unchanged.
    mesh, camera, colours, unseen
        What it was built from.
    """

    def __init__(
        self,
        mesh: TriangleMesh,
        camera: PinholeCamera,
        *colours: SurfaceColour,
        unseen: np.ndarray | None = None,
        engine: str = "cycles",
        samples: int = 1,
        filtered: bool = False,
    ) -> None:
        """Build the scene, which renders with a thread per core.

        Parameters
        ----------
        mesh, camera, colours, unseen
            As of :class:`.RayTracer`.
        engine
            ``"cycles"`` is exact; ``"eevee"`` is a rasteriser that needs OpenGL.
        samples
            Samples per pixel: 1 is a point sample at the pixel's centre, more average over the pixel's square.
        filtered
            Take colours from an image that the caller sets, see :func:`.assign_colour`.

        Raises
        ------
        InputError
            Views of more than :data:`LARGEST_VIEW_PX`, or :data:`LARGEST_SIDE_PX` by Eevee.
        """
        if camera.width * camera.height > LARGEST_VIEW_PX:
            raise InputError(
                f"view: expected at most {LARGEST_VIEW_PX / 1e6:.0f} million pixels, found {camera.width}x"
                f"{camera.height}; use a smaller frame or --scale"
            )
        if engine == "eevee" and max(camera.size_wh) > LARGEST_SIDE_PX:
            raise InputError(
                f"view: expected at most {LARGEST_SIDE_PX} px a side with engine {engine}, found {camera.width}x"
                f"{camera.height}; use --engine cycles or --scale"
            )
        self._own: list[bpy.types.ID] = []
        with self.owning():
            self.mesh, self.camera, self.colours, self.unseen = mesh, camera, colours, unseen
            self.scene = bpy.data.scenes.new("oneframe")
            self.surface_object = new_mesh_object("surface", mesh)
            self.scene.collection.objects.link(self.surface_object)
            assign_colour(self.surface_object, mesh, colours, unseen=unseen, filtered=filtered)
            self.camera_object = new_camera(self.scene, camera, clip_mm=(1.0, 1000.0))
            self.engine, self.samples = engine, samples
            _set_exact_colour(self.scene)
            _set_passes(self.scene, several=len(colours) > 1)
            _set_sampling(self.scene, engine, samples)
            self.scene.render.threads_mode = "AUTO"

    def __enter__(self) -> "SurfaceScene":
        return self

    def __exit__(self, *_: object) -> None:
        remove_data(self._own)

    @contextmanager
    def owning(self) -> Iterator[None]:
        """Make the scene own all data-blocks created inside the block: they are removed with it."""
        existing = set(data_blocks())
        try:
            yield
        finally:
            self._own += [block for block in data_blocks() if block not in existing]

    def limit_threads(self, threads: int) -> None:
        """Render with this number of threads; 0 is one per core."""
        if threads:
            self.scene.render.threads_mode, self.scene.render.threads = "FIXED", threads

    def look_from(self, cam_from_model: np.ndarray) -> None:
        """Put the camera at a pose (4x4, mm) and fit the clip planes to the surface's bounding sphere."""
        place_camera(self.camera_object, cam_from_model)
        depth, radius = float(cam_from_model[2, 3]), self.mesh.radius
        far = max(1.01 * (depth + radius), 1e-3 * radius)
        # margins far above single precision; the near plane is far away for the sake of a rasteriser's depth buffer
        set_clip(self.camera_object, (max(0.99 * (depth - radius), 1e-4 * far), far))


def _set_exact_colour(scene: bpy.types.Scene) -> None:
    """Set no tone curve, no exposure, no dither, no post-processing, and a transparent background."""
    scene.view_settings.view_transform = "Raw"
    scene.view_settings.look = "None"
    scene.view_settings.exposure, scene.view_settings.gamma = 0.0, 1.0
    render = scene.render
    render.dither_intensity = 0.0
    render.film_transparent = True
    render.use_compositing = render.use_sequencer = False
    render.use_motion_blur = render.use_stamp = False
    render.use_border = render.use_simplify = False
    # keeps the ray tracing structure between views: without it each view takes several times as long
    render.use_persistent_data = True


def _set_passes(scene: bpy.types.Scene, *, several: bool) -> None:
    layer = scene.view_layers[0]
    layer.use_pass_combined = layer.use_pass_z = True
    for name in (OBSERVED_PASS, SOURCE_PASS) if several else (OBSERVED_PASS,):
        own = layer.aovs.add()
        own.name, own.type = name, "VALUE"


def _set_sampling(scene: bpy.types.Scene, engine: str, samples: int) -> None:
    scene.render.engine = ENGINE_IDS[engine]
    filter_px = POINT_FILTER_PX if samples == 1 else 1.0
    if engine == "cycles":
        cycles = scene.cycles
        cycles.device = "CPU"
        cycles.samples = samples
        cycles.use_adaptive_sampling = cycles.use_denoising = cycles.use_auto_tile = False
        # since 5.x tiles cannot be switched off
        cycles.tile_size = 8192
        cycles.pixel_filter_type, cycles.filter_width = "BOX", filter_px
        cycles.seed, cycles.use_animated_seed = 0, False
        cycles.max_bounces = cycles.transparent_max_bounces = 0
        cycles.use_light_tree = cycles.caustics_reflective = cycles.caustics_refractive = False
        cycles.sample_clamp_direct = cycles.sample_clamp_indirect = 0.0
    else:
        scene.render.filter_size = POINT_FILTER_PX if samples == 1 else 1.0
        scene.eevee.taa_render_samples = samples
        scene.eevee.use_raytracing = scene.eevee.use_shadows = False
