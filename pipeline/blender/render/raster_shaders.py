"""The two shaders of :mod:`pipeline.blender.render.raster`, in Blender's dialect of GLSL."""

from typing import Any

import gpu

from ...colour.vertex_colours import NEUTRAL

ROW = 4096
"""Width of the texture of planes: every OpenGL 4 has twice that."""
CORNER_TEXELS = 6
"""Texels of a face in the texture of corners: three positions and three colours."""
_FACE_VERTEX = """
void main() {
  gl_Position = clip_from_model * vec4(position, 1.0);
  face = float(gl_VertexID + 1);
}
"""
_FACE_FRAGMENT = """
void main() {
  // inverse depth: the same relative precision near and far
  gl_FragDepth = nearest * gl_FragCoord.w;
  faceAndInverseDepth = vec2(face, gl_FragCoord.w);
}
"""
_VIEW_VERTEX = """
void main() { gl_Position = vec4(corner, 0.0, 1.0); }
"""
_VIEW_FRAGMENT = """
vec4 texel_at(ivec2 at) {
  bool inside = all(greaterThanEqual(at, ivec2(0))) && all(lessThan(at, textureSize(frame, 0)));
  return inside ? texelFetch(frame, at, 0) : vec4(0.0);
}
#if FILLED
vec3 corner_at(int index) { return texelFetch(corners, ivec2(index % ROW, index / ROW), 0).xyz; }
vec3 unseen_colour(int number, vec3 point) {
  int index = number * CORNER_TEXELS;
  vec3 a = corner_at(index), along = corner_at(index + 1) - a, across = corner_at(index + 2) - a;
  vec3 normal = cross(along, across);
  vec2 weight = vec2(dot(cross(point - a, across), normal), dot(cross(along, point - a), normal));
  weight = clamp(weight / max(dot(normal, normal), 1e-30), 0.0, 1.0);
  weight /= max(weight.x + weight.y, 1.0);
  return (1.0 - weight.x - weight.y) * corner_at(index + 3) + weight.x * corner_at(index + 4)
    + weight.y * corner_at(index + 5);
}
#else
vec3 unseen_colour(int number, vec3 point) { return vec3(NEUTRAL); }
#endif
void main() {
  vec2 pixel = floor(gl_FragCoord.xy);
  vec2 drawn = texelFetch(faces, ivec2(pixel), 0).xy;
  int number = int(drawn.x) - 1;
  if (number < 0) {
    view = vec4(0.0);
    return;
  }
  vec4 plane = texelFetch(planes, ivec2(number % ROW, number / ROW), 0);
  vec3 ray = ray_u.xyz * pixel.x + ray_v.xyz * pixel.y + ray_0.xyz;
  float slope = dot(plane.xyz, ray);
  float depth = -(dot(plane.xyz, origin.xyz) + plane.w) / slope;
  // a face seen from its edge has no usable plane
  if (!(abs(depth * drawn.y - 1.0) < 1e-3)) depth = 1.0 / drawn.y;
  vec3 point = (source_u.xyz * pixel.x + source_v.xyz * pixel.y + source_0.xyz) * depth + epipole.xyz;
  bool seen = slope < 0.0;
  vec4 texel = vec4(vec3(NEUTRAL), 0.0);
  // longer normals mark the faces whose front side faces the frame
  if (seen && coloured > 0.0 && dot(plane.xyz, plane.xyz) > 2.0 && point.z > 0.0) {
    vec2 at = clamp(point.xy / point.z, vec2(-2.0), vec2(textureSize(frame, 0)) + 1.0);
    ivec2 first = ivec2(floor(at));
    vec2 weight = at - floor(at);
    texel = mix(mix(texel_at(first), texel_at(first + ivec2(1, 0)), weight.x),
                mix(texel_at(first + ivec2(0, 1)), texel_at(first + ivec2(1, 1)), weight.x), weight.y);
  }
  seen = seen && (coloured == 0.0 || abs(point.z * texel.a - 1.0) <= coloured);
  // the sign tells what the frame saw
  view = vec4(seen ? texel.rgb : unseen_colour(number, ray * depth + origin.xyz), seen ? depth : -depth);
}
"""
RAYS = ("ray_u", "ray_v", "ray_0", "source_u", "source_v", "source_0", "epipole")
"""Names of the vectors from pixel to ray, and with the depth to the homogeneous pixel of the reference view."""


def face_shader() -> Any:
    """The first pass: writes the number of each pixel's face, from 1, and its inverse depth."""
    info: Any = gpu.types.GPUShaderCreateInfo()
    info.push_constant("MAT4", "clip_from_model")
    info.push_constant("FLOAT", "nearest")
    info.vertex_in(0, "VEC3", "position")
    passed: Any = gpu.types.GPUStageInterfaceInfo("oneframe_face")
    passed.flat("FLOAT", "face")
    info.vertex_out(passed)
    info.fragment_out(0, "VEC2", "faceAndInverseDepth")
    info.depth_write("ANY")
    info.vertex_source(_FACE_VERTEX)
    info.fragment_source(_FACE_FRAGMENT)
    return gpu.shader.create_from_info(info)


def view_shader(*, filled: bool) -> Any:
    """The second pass: colour and depth of each pixel; ``filled`` reads colours of unseen surface from ``corners``."""
    info: Any = gpu.types.GPUShaderCreateInfo()
    # eight vectors: no driver has room for less, many have no more
    for name in (*RAYS, "origin_and_tolerance"):
        info.push_constant("VEC4", name)
    info.define("ROW", str(ROW))
    info.define("CORNER_TEXELS", str(CORNER_TEXELS))
    info.define("NEUTRAL", repr(float(NEUTRAL)))
    info.define("origin", "origin_and_tolerance")
    info.define("coloured", "origin_and_tolerance.w")
    info.vertex_in(0, "VEC2", "corner")
    info.define("FILLED", str(int(filled)))
    for slot, name in enumerate(("faces", "frame", "planes", *(("corners",) if filled else ()))):
        info.sampler(slot, "FLOAT_2D", name)
    info.fragment_out(0, "VEC4", "view")
    info.vertex_source(_VIEW_VERTEX)
    info.fragment_source(_VIEW_FRAGMENT)
    return gpu.shader.create_from_info(info)
