"""Pictures of the film on the GPU, each brought to its size on the screen beforehand, so that it is sharp there."""

import cv2
import gpu
import numpy as np
from gpu_extras.presets import draw_texture_2d

from ..pipeline.images.pixel_values import linear_from_codes

MOST_TEXTURES = 64
LINEAR = linear_from_codes(np.arange(256) / 255).astype(np.float32)
"""Of the code values."""

_textures: dict[object, gpu.types.GPUTexture] = {}


def draw_picture(key: object, picture: np.ndarray, low: tuple[float, float], high: tuple[float, float]) -> None:
    """Draw an ``(H, W, 3)`` uint8 RGB picture between two corners, px of the region; equal keys mean equal pictures."""
    left, below = (round(value) for value in low)
    right, above = (round(value) for value in high)
    size_wh = max(right - left, 1), max(above - below, 1)
    gpu.state.blend_set("NONE")
    draw_texture_2d(_texture((key, size_wh), picture, size_wh), (left, below), right - left, above - below)


def _texture(key: object, picture: np.ndarray, size_wh: tuple[int, int]) -> gpu.types.GPUTexture:
    found = _textures.pop(key, None)
    if found is None:
        shrinks = size_wh[0] < picture.shape[1]
        sized = cv2.resize(picture, size_wh, interpolation=cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR)
        rgba = np.ones((size_wh[1], size_wh[0], 4), np.float32)
        # the target encodes linear values as sRGB; its rows begin below
        rgba[..., :3] = LINEAR[sized[::-1]]
        found = gpu.types.GPUTexture(size_wh, format="RGBA16F", data=gpu.types.Buffer("FLOAT", rgba.size, rgba))
    _textures[key] = found
    while len(_textures) > MOST_TEXTURES:
        del _textures[next(iter(_textures))]
    return found


def clear() -> None:
    """Free the GPU's memory."""
    _textures.clear()
