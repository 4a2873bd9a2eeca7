"""Image files decoded by Blender, and arrays as Blender images: code values without colour management."""

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryFile
from threading import Lock

import bpy
import numpy as np

from ...errors import InputError
from ...images.image_check import JPEG_SIGNATURE
from ...process.own_process import delayed_interrupts

_STANDARD_ERROR = Lock()
"""Belongs to one reader at a time."""


def decode(data: bytes, where: str) -> np.ndarray:
    """Code values of a checked image file, ``(H, W, C)`` float32, top row first, for :func:`.read_image`."""
    _check_own_colours(where)
    image = bpy.data.images.new("image", 1, 1)
    try:
        # the bytes that were checked, whatever the file is called and whatever has become of it
        image.source = "FILE"
        image.pack(data=data, data_len=len(data))
        image.colorspace_settings.name = "Non-Color"
        # straight alpha: else Blender multiplies 16-bit colours by alpha
        image.alpha_mode = "CHANNEL_PACKED"
        if data.startswith(JPEG_SIGNATURE):
            # an interruption between the two would lose the standard error
            with delayed_interrupts(), _STANDARD_ERROR, _jpeg_messages() as messages:
                width, height = image.size
        else:
            (width, height), messages = image.size, []
        channels = image.channels
        if width == 0 or height == 0 or channels == 0 or messages:
            raise InputError(f"{where}: expected a whole image, its decoder says that it is damaged; copy it again")
        # lets the file's bytes go, not the pixels: those and their copy take enough memory. unpack() would print
        image.pack(data=b" ", data_len=1)
        values = np.empty(width * height * channels, np.float32)
        image.pixels.foreach_get(values)
    finally:
        bpy.data.images.remove(image)
    return values.reshape(height, width, channels)[::-1]


def _check_own_colours(where: str) -> None:
    # a distribution's Blender names its own configuration so
    folder = bpy.utils.system_resource("DATAFILES", path="colormanagement")  # type: ignore[attr-defined]  # not in stubs
    own = Path(folder, "config.ocio")
    if "OCIO" in os.environ and Path(os.environ["OCIO"]) != own:
        raise InputError(
            f"{where}: expected Blender with its own colours, found OCIO = {os.environ['OCIO']!r}; start Blender "
            "without this environment variable"
        )


@contextmanager
def _jpeg_messages() -> Iterator[list[bytes]]:
    """Filled in the end with what libjpeg prints about an image: of a damaged one it fills in what it lacks.

    It has no other way to say so here. What other threads print meanwhile follows.
    """
    messages: list[bytes] = []
    sys.stderr.flush()
    with TemporaryFile() as said:
        kept = os.dup(2)
        try:
            os.dup2(said.fileno(), 2)
            yield messages
        finally:
            os.dup2(kept, 2)
            os.close(kept)
            said.seek(0)
            for line in said:
                if b"JPEG" in line:
                    messages.append(line)
                else:
                    os.write(2, line)


def new_float_image(name: str, rgba: np.ndarray) -> bpy.types.Image:
    """A Blender image with ``(H, W, 4)`` float values unchanged, top row first, for lookups in shaders."""
    _check_own_colours(name)
    height, width = rgba.shape[:2]
    image = bpy.data.images.new(name, width, height, alpha=True, float_buffer=True, is_data=True)
    image.colorspace_settings.name = "Non-Color"
    image.alpha_mode = "CHANNEL_PACKED"
    image.use_half_precision = False
    image.pixels.foreach_set(np.ascontiguousarray(rgba[::-1], dtype=np.float32).ravel())
    image.update()
    return image


def new_packed_image(name: str, png: bytes, *, width: int, height: int) -> bpy.types.Image:
    """A Blender image packed into the .blend file, from a PNG in memory; its code values are sRGB."""
    image = bpy.data.images.new(name, width, height)
    image.source = "FILE"
    image.pack(data=png, data_len=len(png))
    return image


def render_path(path: Path) -> str:
    """A path for ``render.filepath``, where braces are a template and two slashes the folder of the .blend file."""
    return str(path.resolve()).replace("{", "{{").replace("}", "}}")
