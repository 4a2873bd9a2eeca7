"""Write images as an MP4 video with Blender's sequencer."""

import shutil
import struct
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path

import bpy
import numpy as np

from ...files.temporary import temporary_folder, unwritable_temporary, writing_temporary
from ...files.writing import written_file
from ...images.pixel_values import to_uint8
from ..bridge.data_blocks import temporary_data
from ..bridge.image import render_path
from ..bridge.versions import new_image_strip, set_mp4

FRAMES_PER_SECOND = 24

STRIP_FRAMES = 1000
"""Frames of a strip of the sequencer; more frames are further strips."""


def write_video(path: Path, images: Iterable[np.ndarray]) -> None:
    """As :func:`stream_video`, of float images (code values 0..1) that Blender renders: all are made before the first.

    H.264 needs even sides: an odd number of rows or columns is made even by repeating the last one.
    """
    with temporary_folder() as folder:
        files = []
        for number, image in enumerate(images):
            files.append(folder / f"{number:06d}.npy")
            with writing_temporary():
                np.save(files[-1], to_uint8(image))
        stream_video(path, map(np.load, files), len(files), fps=FRAMES_PER_SECOND)


def stream_video(
    path: Path, images: Iterable[np.ndarray], count: int, *, fps: float, pixel_aspect: float = 1.0
) -> None:
    """Encode ``count`` images ``(H, W, 3)`` uint8 as H.264, each as soon as it comes: one at a time is kept.

    Blender's sequencer asks for each frame just before it encodes it. The images must not use Blender's renderer.

    Parameters
    ----------
    path
        The file, which is written whole or not at all.
    images, count
        At least one image. If there are fewer than ``count``, the last one stays.
    fps
        Images per second.
    pixel_aspect
        Width of a pixel over its height, for players.

    Raises
    ------
    OSError
        The video cannot be written.
    RunError
        Temporary files cannot be written.
    """
    pictures = iter(images)
    failures: list[BaseException] = []
    with temporary_folder() as folder:
        written, files = folder / "video.mp4", [folder / f"{number:08d}.bmp" for number in range(count)]
        first = padded(next(pictures))
        with writing_temporary():
            files[0].write_bytes(_bmp(first))

        def prepare(scene: bpy.types.Scene, *_: object) -> None:
            number = scene.frame_current - 1
            if number == 0:
                return
            picture = None
            if not failures:
                try:
                    picture = next(pictures, None)
                    if picture is not None:
                        with writing_temporary():
                            files[number].write_bytes(_bmp(padded(picture)))
                except BaseException as error:
                    # Blender would print it and go on
                    failures.append(error)
            with suppress(OSError):
                # Blender cannot be told to stop, and crashes if a file is missing
                if picture is None or failures:
                    files[number - 1].replace(files[number])
                else:
                    files[number - 1].unlink()

        with temporary_data():
            scene = bpy.data.scenes.new("oneframe video")
            _set_up(scene, files, width=first.shape[1], height=first.shape[0], fps=fps)
            # of no side may Blender's be below 1
            scene.render.pixel_aspect_x, scene.render.pixel_aspect_y = max(pixel_aspect, 1), max(1 / pixel_aspect, 1)
            editor = scene.sequence_editor_create()
            editor.use_cache_raw = editor.use_cache_final = False
            scene.render.filepath = render_path(written)
            bpy.app.handlers.render_pre.append(prepare)
            try:
                bpy.ops.render.render(animation=True, scene=scene.name)
            finally:
                bpy.app.handlers.render_pre.remove(prepare)
        if failures:
            raise failures[0]
        _keep(written, path)


def padded(image: np.ndarray) -> np.ndarray:
    """The image with even sides, its last row or column repeated if need be."""
    if image.shape[0] % 2 == image.shape[1] % 2 == 0:
        return image
    return np.pad(image, ((0, image.shape[0] % 2), (0, image.shape[1] % 2), (0, 0)), mode="edge")


def _bmp(image: np.ndarray) -> bytes:
    """``(H, W, 3)`` uint8 as a BMP file, which takes no computation to write and to read."""
    height, width = image.shape[:2]
    rows = np.zeros((height, -(-width * 3 // 4) * 4), np.uint8)
    rows[:, : width * 3] = image[::-1, :, ::-1].reshape(height, -1)
    file_head = struct.pack("<2sIII", b"BM", 54 + rows.size, 0, 54)
    return file_head + struct.pack("<IiiHHIIiiII", 40, width, height, 1, 24, 0, rows.size, 0, 0, 0, 0) + rows.tobytes()


def _keep(written: Path, path: Path) -> None:
    """Copy a video that Blender has written to its place."""
    if not written.exists() or not _is_whole(written):
        raise unwritable_temporary("Blender wrote a damaged video")
    path.parent.mkdir(parents=True, exist_ok=True)
    with open(written, "rb") as source, written_file(path) as target:
        shutil.copyfileobj(source, target, 1 << 20)


def _is_whole(mp4: Path) -> bool:
    """Whether the boxes of an MP4 end exactly at the end of the file and include the index (moov)."""
    position, kinds, size_of_file = 0, set(), mp4.stat().st_size
    with open(mp4, "rb") as file:
        while position + 16 <= size_of_file:
            file.seek(position)
            size, kind, long_size = struct.unpack(">I4sQ", file.read(16))
            kinds.add(kind)
            position += max(long_size if size == 1 else size, 8)
    return position == size_of_file and b"moov" in kinds


def _set_up(scene: bpy.types.Scene, files: list[Path], *, width: int, height: int, fps: float) -> None:
    # the elements of a strip are copied whenever one is appended
    for first in range(0, len(files), STRIP_FRAMES):
        part = files[first : first + STRIP_FRAMES]
        strip = new_image_strip(scene, str(part[0]), channel=1, frame_start=1 + first)
        for file in part[1:]:
            strip.elements.append(file.name)
        strip.frame_final_duration = len(part)
    render = scene.render
    render.resolution_x, render.resolution_y, render.resolution_percentage = width, height, 100
    # a whole number over a base, such as 30 / 1.001
    render.fps = max(round(fps), 1)
    render.fps_base = render.fps / fps
    render.use_sequencer, render.use_compositing = True, False
    scene.frame_start, scene.frame_end = 1, len(files)
    # nothing but the images goes into the file: Blender would note day, duration, memory and paths
    for name in dir(render):
        if name.startswith("use_stamp"):
            setattr(render, name, False)
    # both ends are sRGB code values: nothing to convert
    scene.view_settings.view_transform = "Standard"
    scene.sequencer_colorspace_settings.name = "sRGB"
    set_mp4(scene)
