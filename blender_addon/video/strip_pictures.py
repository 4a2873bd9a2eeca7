"""Pictures of the film on the GPU, each brought to its size on the screen beforehand, so that it is sharp there."""

from functools import cache

import cv2
import gpu
import numpy as np
from gpu_extras.batch import batch_for_shader

MOST_TEXTURES = 64

_VERTEX = """
void main()
{
  at = texture_at;
  gl_Position = ModelViewProjectionMatrix * vec4(position, 0.0, 1.0);
}
"""

_FRAGMENT = """
void main()
{
  /* the target encodes linear values as sRGB */
  vec3 code = texture(picture, at).rgb;
  vec3 decoded = mix(pow((code + 0.055) / 1.055, vec3(2.4)), code / 12.92, vec3(lessThan(code, vec3(0.04045))));
  colour = vec4(decoded, 1.0);
}
"""

_textures: dict[object, gpu.types.GPUTexture] = {}


@cache
def _shader() -> gpu.types.GPUShader:
    """Code values as they are, in a 3D view."""
    between = gpu.types.GPUStageInterfaceInfo("oneframe_film")
    between.smooth("VEC2", "at")
    info = gpu.types.GPUShaderCreateInfo()
    info.vertex_in(0, "VEC2", "position")
    info.vertex_in(1, "VEC2", "texture_at")
    info.vertex_out(between)
    info.push_constant("MAT4", "ModelViewProjectionMatrix")
    info.sampler(0, "FLOAT_2D", "picture")
    info.fragment_out(0, "VEC4", "colour")
    info.vertex_source(_VERTEX)
    info.fragment_source(_FRAGMENT)
    return gpu.shader.create_from_info(info)


def draw_picture(key: object, picture: np.ndarray, low: tuple[float, float], high: tuple[float, float]) -> None:
    """Draw an ``(H, W, 3)`` uint8 RGB picture between two corners, px of the region; equal keys mean equal pictures."""
    left, below = (round(value) for value in low)
    right, above = (round(value) for value in high)
    size_wh = max(right - left, 1), max(above - below, 1)
    texture = _texture((key, size_wh), picture, size_wh)
    shader = _shader()
    corners = np.array([[left, below], [right, below], [right, above], [left, above]], np.float32)
    batch = batch_for_shader(
        shader,
        "TRIS",
        {"position": corners, "texture_at": np.array([[0, 1], [1, 1], [1, 0], [0, 0]], np.float32)},
        indices=((0, 1, 2), (2, 3, 0)),
    )
    shader.bind()
    shader.uniform_float(
        "ModelViewProjectionMatrix", gpu.matrix.get_projection_matrix() @ gpu.matrix.get_model_view_matrix()
    )
    shader.uniform_sampler("picture", texture)
    gpu.state.blend_set("NONE")
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
