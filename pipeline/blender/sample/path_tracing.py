"""Scenes whose renders stand for photographs: path traced by Cycles, denoised, under a uniform ambient light."""

from collections.abc import Sequence
from typing import Literal

import bpy

from ..bridge.versions import IS_5


def set_path_tracing(scene: bpy.types.Scene, samples: int, *, depth: Literal["8", "16"]) -> None:
    """Set a scene up to render sRGB PNGs with one bounce of light, the same ones every time.

    Parameters
    ----------
    scene
        The scene.
    samples
        Paths per pixel before denoising.
    depth
        Bits of a channel.
    """
    render, cycles = scene.render, scene.cycles
    render.engine = "CYCLES"
    render.use_persistent_data = True
    render.use_compositing = render.use_sequencer = False
    render.dither_intensity = 0.0
    render.image_settings.file_format = "PNG"
    render.image_settings.color_mode, render.image_settings.color_depth = "RGB", depth
    # no dates or names of this computer in the file
    for stamp in filter(lambda name: name.startswith("use_stamp_"), render.bl_rna.properties.keys()):
        setattr(render, stamp, False)
    scene.display_settings.display_device = "sRGB"
    scene.view_settings.view_transform, scene.view_settings.look = "Standard", "None"
    cycles.device, cycles.seed, cycles.samples = "CPU", 0, samples
    cycles.use_adaptive_sampling = False
    cycles.use_denoising, cycles.denoiser = True, "OPENIMAGEDENOISE"
    cycles.denoising_quality = "FAST"
    cycles.max_bounces = cycles.diffuse_bounces = 1
    cycles.use_light_tree = cycles.use_auto_tile = False


def add_ambient_light(scene: bpy.types.Scene, rgb: Sequence[float], strength: float) -> bpy.types.World:
    """Give a scene a world of one colour (linear), which is returned."""
    world = bpy.data.worlds.new("ambient light")
    scene.world = world
    if not IS_5:
        world.use_nodes = True
    background = world.node_tree.nodes["Background"]
    background.inputs["Color"].default_value = (*rgb, 1)
    background.inputs["Strength"].default_value = strength
    return world
