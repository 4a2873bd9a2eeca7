"""Write images as an MP4 video with Blender's sequencer."""

import struct
from collections.abc import Iterable
from pathlib import Path

import bpy
import numpy as np

from ...files.content import write_bytes_atomically
from ...files.temporary import temporary_folder, unwritable_temporary, writing_temporary
from ...images.pixel_values import to_uint8
from ...images.png import encode_png
from ..bridge.data_blocks import temporary_data
from ..bridge.image import render_path
from ..bridge.versions import new_image_strip, set_mp4

FRAMES_PER_SECOND = 24


def write_video(path: Path, images: Iterable[np.ndarray]) -> None:
    """Encode ``(H, W, 3)`` float images (code values 0..1) as H.264; leaves no file behind if it fails.

    H.264 needs even sides: an odd number of rows or columns is made even by repeating the last one.

    Raises
    ------
    OSError
        The video cannot be written.
    RunError
        Temporary files cannot be written.
    """
    with temporary_folder() as folder:
        files, height, width = [], 0, 0
        for number, image in enumerate(images):
            padded = np.pad(image, ((0, image.shape[0] % 2), (0, image.shape[1] % 2), (0, 0)), mode="edge")
            height, width = padded.shape[:2]
            file = folder / f"{number:06d}.png"
            with writing_temporary():
                file.write_bytes(encode_png(to_uint8(padded)))
            files.append(file)
        written = folder / "video.mp4"
        with temporary_data():
            scene = bpy.data.scenes.new("oneframe video")
            _set_up(scene, files, width=width, height=height)
            scene.render.filepath = render_path(written)
            bpy.ops.render.render(animation=True, scene=scene.name)
        # a full disk may leave no file at all
        data = written.read_bytes() if written.exists() else b""
    # Blender reports no error when the disk is full
    if not _is_whole(data):
        raise unwritable_temporary("Blender wrote a damaged video")
    path.parent.mkdir(parents=True, exist_ok=True)
    write_bytes_atomically(path, data)


def _is_whole(mp4: bytes) -> bool:
    """Whether the boxes of an MP4 end exactly at the end of the file and include the index (moov)."""
    position, kinds = 0, set()
    while position + 16 <= len(mp4):
        size, kind, long_size = struct.unpack_from(">I4sQ", mp4, position)
        kinds.add(kind)
        position += max(long_size if size == 1 else size, 8)
    return position == len(mp4) and b"moov" in kinds


def _set_up(scene: bpy.types.Scene, files: list[Path], *, width: int, height: int) -> None:
    strip = new_image_strip(scene, str(files[0]), channel=1, frame_start=1)
    for file in files[1:]:
        strip.elements.append(file.name)
    strip.frame_final_duration = len(files)
    render = scene.render
    render.resolution_x, render.resolution_y, render.resolution_percentage = width, height, 100
    render.fps, render.fps_base = FRAMES_PER_SECOND, 1.0
    render.use_sequencer, render.use_compositing = True, False
    scene.frame_start, scene.frame_end = 1, len(files)
    # the same images make the same bytes: Blender would note day, duration, memory and paths in the file
    for name in dir(render):
        if name.startswith("use_stamp"):
            setattr(render, name, False)
    # both ends are sRGB code values: nothing to convert
    scene.view_settings.view_transform = "Standard"
    scene.sequencer_colorspace_settings.name = "sRGB"
    set_mp4(scene)
