"""Pictures of the film on the GPU, each brought to its size on the screen beforehand, so that it is sharp there."""

from functools import cache

import cv2
import gpu
import numpy as np

from ..ui.rectangle import DECODE, bound_rectangle, rectangle_shader

MOST_TEXTURES = 64

_FRAGMENT = (
    DECODE
    + """
void main()
{
  /* the target encodes linear values as sRGB */
  colour = vec4(decoded(texture(picture, at).rgb), 1.0);
}
"""
)

_textures: dict[object, gpu.types.GPUTexture] = {}


@cache
def _shader() -> gpu.types.GPUShader:
    """Code values as they are, in a 3D view."""
    return rectangle_shader("film", _FRAGMENT, samplers=("picture",))


def draw_picture(key: object, picture: np.ndarray, low: tuple[float, float], high: tuple[float, float]) -> None:
    """Draw an ``(H, W, 3)`` uint8 RGB picture between two corners, px of the region; equal keys mean equal pictures."""
    left, below = (round(value) for value in low)
    right, above = (round(value) for value in high)
    size_wh = max(right - left, 1), max(above - below, 1)
    texture = _texture((key, size_wh), picture, size_wh)
    shader = _shader()
    corners = np.array([[left, below], [right, below], [right, above], [left, above]])
    batch = bound_rectangle(shader, corners, np.array([[0, 1], [1, 1], [1, 0], [0, 0]]))
    shader.uniform_sampler("picture", texture)
    batch.draw(shader)


def _texture(key: object, picture: np.ndarray, size_wh: tuple[int, int]) -> gpu.types.GPUTexture:
    found = _textures.pop(key, None)
    if found is None:
        shrinks = size_wh[0] < picture.shape[1]
        sized = cv2.resize(picture, size_wh, interpolation=cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR)
        rgba = np.ones((size_wh[1], size_wh[0], 4), np.float32)
        rgba[..., :3] = sized.astype(np.float32) / 255
        found = gpu.types.GPUTexture(size_wh, format="RGBA8", data=gpu.types.Buffer("FLOAT", rgba.size, rgba))
    _textures[key] = found
    while len(_textures) > MOST_TEXTURES:
        del _textures[next(iter(_textures))]
    return found


def clear() -> None:
    """Free the GPU's memory."""
    _textures.clear()
    _shader.cache_clear()
