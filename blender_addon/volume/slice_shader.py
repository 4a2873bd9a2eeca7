"""The shader of the slices: window and level, the contour of the threshold, tints of what was drilled and of labels."""

from functools import cache

import gpu
import numpy as np

from ..ui.rectangle import rectangle_shader

_FRAGMENT = """
/* linear between the centres of the voxels; (0, 0) is the centre of the top left one */
float hu_at(vec2 place)
{
  ivec2 last = textureSize(slice, 0) - 1;
  vec2 inside = clamp(place, vec2(0.0), vec2(last));
  ivec2 low = min(ivec2(inside), max(last - 1, ivec2(0)));
  ivec2 high = min(low + 1, last);
  vec2 share = inside - vec2(low);
  float top = mix(texelFetch(slice, low, 0).r, texelFetch(slice, ivec2(high.x, low.y), 0).r, share.x);
  float bottom = mix(texelFetch(slice, ivec2(low.x, high.y), 0).r, texelFetch(slice, high, 0).r, share.x);
  return mix(top, bottom, share.y);
}

void main()
{
  ivec2 size = textureSize(slice, 0);
  float hu = hu_at(at);
  vec3 code = vec3(clamp((hu - window.x) / window.y + 0.5, 0.0, 1.0));
  ivec2 voxel = clamp(ivec2(floor(at + 0.5)), ivec2(0), size - 1);
  vec4 tint = texelFetch(tints, min(voxel, textureSize(tints, 0) - 1), 0);
  code = mix(code, tint.rgb, tint.a);
  /* the line of the threshold: its distance is the difference over the slope, on the screen */
  float difference = hu - threshold;
  vec2 step_px = vec2(length(dFdx(at)), length(dFdy(at)));
  vec2 slope = vec2(hu_at(at + vec2(step_px.x, 0.0)) - hu_at(at - vec2(step_px.x, 0.0)),
                    hu_at(at + vec2(0.0, step_px.y)) - hu_at(at - vec2(0.0, step_px.y))) / 2.0;
  float distance_px = abs(difference) / max(length(slope), 1e-6);
  float line = clamp(line_px / 2.0 + 0.5 - distance_px, 0.0, 1.0);
  code = mix(code, line_colour.rgb, line);
  colour = vec4(code, 1.0);
}
"""


@cache
def slice_shader() -> gpu.types.GPUShader:
    """``slice`` in HU -> its picture; ``at`` is the pixel of the slice."""
    constants = (("VEC2", "window"), ("VEC4", "line_colour"), ("FLOAT", "threshold"), ("FLOAT", "line_px"))
    return rectangle_shader("slice", _FRAGMENT, samplers=("slice", "tints"), constants=constants)


def hu_texture(hu: np.ndarray) -> gpu.types.GPUTexture:
    """A slice ``(H, W)`` on the GPU."""
    values = np.ascontiguousarray(hu, np.float32)
    height, width = values.shape
    return gpu.types.GPUTexture((width, height), format="R32F", data=gpu.types.Buffer("FLOAT", values.size, values))


def tint_texture(rgba: np.ndarray) -> gpu.types.GPUTexture:
    """Tints ``(H, W, 4)``, 0..1, on the GPU."""
    values = np.ascontiguousarray(rgba, np.float32)
    height, width = values.shape[:2]
    return gpu.types.GPUTexture((width, height), format="RGBA8", data=gpu.types.Buffer("FLOAT", values.size, values))
