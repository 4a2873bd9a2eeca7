"""Rectangles with textures, drawn by shaders of one's own."""

from collections.abc import Iterable

import gpu
import numpy as np
from gpu_extras.batch import batch_for_shader

DECODE = """
vec3 decoded(vec3 code)
{
  vec3 low = code / 12.92;
  vec3 high = pow((code + 0.055) / 1.055, vec3(2.4));
  return mix(high, low, lessThan(code, vec3(0.04045)));
}
"""
"""GLSL: code values -> linear ones, for targets that encode what they are given."""

_VERTEX = """
void main()
{
  at = corner_at;
  gl_Position = vec4(position, 0.0, 1.0);
}
"""


def rectangle_shader(
    name: str, fragment: str, samplers: Iterable[str], constants: Iterable[tuple[str, str]] = (), *, out: str = "colour"
) -> gpu.types.GPUShader:
    """A shader whose ``fragment`` sets ``out`` (vec4) from ``at`` (vec2), samplers and constants (type, name)."""
    between = gpu.types.GPUStageInterfaceInfo(f"oneframe_{name}")
    between.smooth("VEC2", "at")
    info = gpu.types.GPUShaderCreateInfo()
    info.vertex_in(0, "VEC2", "position")
    info.vertex_in(1, "VEC2", "corner_at")
    info.vertex_out(between)
    for kind, constant in constants:
        info.push_constant(kind, constant)  # type: ignore[arg-type]  # one of Blender's names
    for number, sampler in enumerate(samplers):
        info.sampler(number, "FLOAT_2D", sampler)
    info.fragment_out(0, "VEC4", out)
    info.vertex_source(_VERTEX)
    info.fragment_source(fragment)
    return gpu.shader.create_from_info(info)


def rectangle(shader: gpu.types.GPUShader, corners: np.ndarray, corners_at: np.ndarray) -> gpu.types.GPUBatch:
    """A rectangle for :func:`rectangle_shader`: its corners ``(4, 2)`` in order, -1..1, and ``at`` there."""
    fields = {"position": np.float32(corners), "corner_at": np.float32(corners_at)}
    return batch_for_shader(shader, "TRIS", fields, indices=((0, 1, 2), (0, 2, 3)))
