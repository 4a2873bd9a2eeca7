"""Image files read by Blender, and arrays as Blender images: code values without colour management."""

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import bpy
import numpy as np

from ...errors import InputError
from ...images.image_check import LARGEST_FRAME, check_image_file, may_have_alpha
from ...process.own_process import delayed_interrupts

_BEYOND = 1e-3
"""By which floats may exceed 0 to 1: interpolation and rounding do."""


def read_image(path: Path, where: str = "") -> tuple[np.ndarray, np.ndarray]:
    """Read an image file as code values between 0 and 1.

    Returns
    -------
    ``(H, W, 3)`` float32 RGB, 8-bit values divided by 255 and 16-bit ones by 65535 (grey is repeated), top row first;
    ``(H, W)`` bool, False where the file's alpha is 0: pixels without image, such as outside a circular field of view.

    Raises
    ------
    InputError
        The file is missing, cut off, or not an image that Blender can read; or Blender has other colours than its own.
    """
    where = where or str(path)
    # a distribution's Blender names its own configuration so
    folder = bpy.utils.system_resource("DATAFILES", path="colormanagement")  # type: ignore[attr-defined]  # not in stubs
    own = Path(folder, "config.ocio")
    if "OCIO" in os.environ and Path(os.environ["OCIO"]) != own:
        raise InputError(
            f"{where}: expected Blender with its own colours, found OCIO = {os.environ['OCIO']!r}; start Blender "
            "without this environment variable"
        )
    data = check_image_file(path, where, most_pixels=LARGEST_FRAME)
    image = bpy.data.images.new("image", 1, 1)
    try:
        # the bytes that were checked, whatever the file is called and whatever has become of it
        image.source = "FILE"
        image.pack(data=data, data_len=len(data))
        has_alpha = may_have_alpha(data)
        del data
        image.colorspace_settings.name = "Non-Color"
        # straight alpha: else Blender multiplies 16-bit colours by alpha
        image.alpha_mode = "CHANNEL_PACKED"
        # an interruption between the two would lose the standard error
        with delayed_interrupts(), _quiet_decoders():
            width, height = image.size
        channels = image.channels
        if width == 0 or height == 0 or channels == 0:
            raise InputError(f"{where}: expected an image, Blender cannot decode it; open and save it again as PNG")
        # lets the file's bytes go, not the pixels: those and their copy take enough memory. unpack() would print
        image.pack(data=b" ", data_len=1)
        values = np.empty(width * height * channels, np.float32)
        image.pixels.foreach_get(values)
    finally:
        bpy.data.images.remove(image)
    # of floats; NaN is not within it
    if not (values.min() >= -_BEYOND and values.max() <= 1 + _BEYOND):
        raise InputError(
            f"{where}: expected an image of values from 0 to 1, found {values.min():g} to {values.max():g}; save it as "
            "PNG of 8 or 16 bits"
        )
    values = values.reshape(height, width, channels)[::-1]
    colours = values[..., :3] if channels >= 3 else np.repeat(values[..., :1], 3, axis=2)
    valid = values[..., 3] > 0 if channels == 4 and has_alpha else np.ones((height, width), dtype=bool)
    return np.ascontiguousarray(colours), np.ascontiguousarray(valid)


@contextmanager
def _quiet_decoders() -> Iterator[None]:
    """Discard what libraries print about damaged images: the caller reports it in one sentence."""
    sys.stderr.flush()
    kept, nowhere = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 2)
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nowhere)


def new_float_image(name: str, rgba: np.ndarray) -> bpy.types.Image:
    """A Blender image with ``(H, W, 4)`` float values unchanged, top row first, for lookups in shaders."""
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
