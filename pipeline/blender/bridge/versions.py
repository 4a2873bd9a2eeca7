"""All differences between Blender 4.5 LTS and 5.2 LTS that the project handles."""

import bpy

IS_5 = bpy.app.version >= (5, 0, 0)

EEVEE = "BLENDER_EEVEE" if IS_5 else "BLENDER_EEVEE_NEXT"
"""Blender's name of the engine."""


def new_node_material(name: str) -> bpy.types.Material:
    """A material with an empty node tree (5.x gives every material one, and warns if ``use_nodes`` is set)."""
    material = bpy.data.materials.new(name)
    if not IS_5:
        material.use_nodes = True
    material.node_tree.nodes.clear()
    return material


def set_multilayer_exr(scene: bpy.types.Scene) -> None:
    """Make a scene write renders as uncompressed 32-bit multilayer EXR of one part."""
    settings = scene.render.image_settings
    if hasattr(settings, "media_type"):  # 5.x
        settings.media_type = "MULTI_LAYER_IMAGE"
    if hasattr(settings, "use_exr_interleave"):
        settings.use_exr_interleave = True
    settings.file_format = "OPEN_EXR_MULTILAYER"
    settings.color_depth = "32"
    settings.exr_codec = "NONE"


def set_mp4(scene: bpy.types.Scene) -> None:
    """Make a scene write animations as H.264 in MP4: visually lossless, with a keyframe every half second."""
    settings = scene.render.image_settings
    if hasattr(settings, "media_type"):  # 5.x
        settings.media_type = "VIDEO"
    settings.file_format = "FFMPEG"
    settings.color_mode = "RGB"
    video = scene.render.ffmpeg
    video.format, video.codec = "MPEG4", "H264"
    video.constant_rate_factor, video.ffmpeg_preset = "HIGH", "GOOD"
    video.gopsize, video.audio_codec = 12, "NONE"


def new_image_strip(scene: bpy.types.Scene, path: str, *, channel: int, frame_start: int) -> bpy.types.Strip:
    """Add an image strip to the scene's sequencer; append further files to its ``elements``."""
    editor = scene.sequence_editor_create()
    strips = editor.strips if hasattr(editor, "strips") else editor.sequences  # type: ignore[attr-defined]  # 4.5
    return strips.new_image("frames", path, channel, frame_start)
