"""A Blender scene from data: one surface, one camera, and settings that keep colours and geometry exact.

What the engines of Blender share: colour, depth and observed surface of a view come from the same rays.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Self

import bpy
import numpy as np

from ...camera.pinhole import PinholeCamera
from ...colour.lens_shading import shown_codes
from ...colour.shading import ColouredSurface
from ...projection.rendered_view import RenderedView
from ..bridge.camera import new_camera, place_camera, set_clip
from ..bridge.data_blocks import data_blocks, new_mesh_object, remove_data
from .material import OBSERVED_PASS, SOURCE_PASS, assign_colour, move_lamp

POINT_FILTER_PX = 0.01
"""Width of the pixel filter with one sample: practically the pixel's centre (0 is not allowed)."""

LAMP_WATT_PER_MM2 = 4 * np.pi**2
"""Blender's watts of a point lamp that gives a white surface which faces it at 1 mm the radiance 1."""

_BACKGROUND_MM = 1e9  # Blender's background has depth 1e10


class SurfaceScene(ABC):
    """A coloured surface and a pinhole camera in a separate Blender scene, without an engine yet.

    Use as a context manager.

    Attributes
    ----------
    scene, camera_object, surface_object
        The Blender data; removed on exit, so that the open file is unchanged.
    surface, camera
        What it was built from.
    """

    def __init__(
        self,
        surface: ColouredSurface,
        camera: PinholeCamera,
        *,
        samples: int = 1,
        filtered: bool = False,
    ) -> None:
        """Build the scene, which renders with a thread per core.

        Parameters
        ----------
        surface, camera
            What to render, and the intrinsics of the views.
        samples
            Samples per pixel: 1 is a point sample at the pixel's centre, more average over the pixel's square.
        filtered
            Take colours from an image that the caller sets, see :func:`.assign_colour`.
        """
        self._own: list[bpy.types.ID] = []
        with self.owning():
            self.surface, self.camera, self._samples = surface, camera, samples
            self.scene = bpy.data.scenes.new("oneframe")
            self.surface_object = new_mesh_object("surface", surface.mesh)
            self.scene.collection.objects.link(self.surface_object)
            assign_colour(self.surface_object, surface, filtered=filtered)
            self.camera_object = new_camera(self.scene, camera, clip_mm=(1.0, 1000.0))
            _set_exact_colour(self.scene)
            _set_passes(self.scene, several=len(surface.colours) > 1)
            if surface.light is not None and surface.light.shadows:
                self._lamp = _new_lamp(self.scene)
                # else the surface, which emits its colours, lights itself
                self.surface_object.visible_diffuse = False
            self._set_engine(POINT_FILTER_PX if samples == 1 else 1.0)
            self.scene.render.threads_mode = "AUTO"

    def __enter__(self) -> Self:
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

    @abstractmethod
    def _set_engine(self, filter_px: float) -> None:
        """Choose the engine, and its sampling with a pixel filter of this width."""

    @abstractmethod
    def _passes(self) -> dict[str, np.ndarray]:
        """Render, and give ``(H, W, C)`` passes by name."""

    def render(self, cam_from_model: np.ndarray) -> RenderedView:
        """Render the surface from a pose (4x4, mm)."""
        self.look_from(cam_from_model)
        passes = self._passes()
        combined, depth = passes["Combined"], passes["Depth"][..., 0]
        # Eevee 4.5 gives the background the depth of the far clip plane
        depth = np.where((depth < _BACKGROUND_MM) & (combined[..., 3] > 0), depth, np.float32(0))
        # with several samples the flag is the mean over the pixel
        flag = np.where(depth > 0, passes[OBSERVED_PASS][..., 0], np.float32(0))
        rgb = combined[..., :3] if self._samples == 1 else _without_background(combined, depth)
        if self.surface.light is not None:
            curve = self.surface.light.curve
            shown = shown_codes((rgb - np.float32(curve.shift)).reshape(-1, 3), curve=curve)
            rgb = shown.reshape(rgb.shape) * (depth > 0)[..., None]
        source = (flag > 0.5).astype(np.uint8)
        if SOURCE_PASS in passes:
            # at seams, several samples may be of several frames
            numbers = passes[SOURCE_PASS][..., 0] / (1.0 if self._samples == 1 else np.maximum(flag, 0.5))
            source *= np.clip(np.rint(numbers), 1, len(self.surface.colours)).astype(np.uint8)
        return RenderedView(rgb, depth, source, flag > 1.5)

    def look_from(self, cam_from_model: np.ndarray) -> None:
        """Put the camera at a pose (4x4, mm) and fit the clip planes to the surface's bounding sphere."""
        place_camera(self.camera_object, cam_from_model)
        depth, radius = float(cam_from_model[2, 3]), self.surface.mesh.radius
        far = max(1.01 * (depth + radius), 1e-3 * radius)
        # margins far above single precision; the near plane is far away for the sake of a rasteriser's depth buffer
        set_clip(self.camera_object, (max(0.99 * (depth - radius), 1e-4 * far), far))
        if self.surface.light is not None:
            place, distance_mm = move_lamp(self.surface_object, self.surface.light, cam_from_model)
            if self.surface.light.shadows:
                self._lamp.location = place.tolist()
                self._lamp.data.energy = LAMP_WATT_PER_MM2 * distance_mm**2


def _new_lamp(scene: bpy.types.Scene) -> bpy.types.Object:
    """A lamp without a size, whose shadows have sharp edges: one sample has no noise."""
    lamp = bpy.data.lights.new("lamp", "POINT")
    lamp.shadow_soft_size = 0.0
    lamp_object = bpy.data.objects.new("lamp", lamp)
    scene.collection.objects.link(lamp_object)
    return lamp_object


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


def _without_background(combined: np.ndarray, depth: np.ndarray) -> np.ndarray:
    """``(H, W, 3)`` the mean of the samples that hit the surface, black where the depth (0 for none) has none."""
    alpha = combined[..., 3:]
    shown = (depth[..., None] > 0) & (alpha > 0)
    return np.divide(combined[..., :3], alpha, out=np.zeros((*depth.shape, 3), np.float32), where=shown)
