"""The shaders of the overlays: geometry of the surface, structures, edges and lines in the geometry, the composite.

All colours are code values, as on the screen. Blender passes images to shaders as scene-linear values, which the
shaders encode.
"""

from collections.abc import Iterable
from functools import cache
from typing import Literal

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


_ENCODE = """
vec3 encoded(vec3 light)
{
  vec3 low = light * 12.92;
  vec3 high = 1.055 * pow(max(light, vec3(0.0)), vec3(1.0 / 2.4)) - 0.055;
  return mix(high, low, lessThan(light, vec3(0.0031308)));
}
"""

_SURFACE_VERTEX = """
void main()
{
  vec4 point = view_from_model * vec4(position, 1.0);
  gl_Position = clip_from_view * point;
  bool perspective = clip_from_view[3][3] == 0.0;
  normal_view = mat3(view_from_model) * normal;
  toward_eye = perspective ? -point.xyz : vec3(0.0, 0.0, 1.0);
  depth_mm = -point.z;
}
"""

_SURFACE_FRAGMENT = """
const float tolerance_mm = 0.1;  /* a structure in the surface's plane is visible */

void main()
{
  vec3 n = normalize(normal_view);
  float facing = dot(n, normalize(toward_eye));
#ifdef STRUCTURE
  /* a light next to the lens, as in a microscope */
  picture = vec4(plain.colour.rgb * (0.15 + 0.85 * abs(facing)), plain.colour.a);
  float bone_mm = texelFetch(bone, ivec2(gl_FragCoord.xy), 0).w;
  if (bone_mm > 0.0 && depth_mm > bone_mm + tolerance_mm) {
    picture.a = plain.hidden_alpha.x;
  }
#else
  geometry = vec4(facing < 0.0 ? -n : n, depth_mm);
#endif
}
"""

_DIRECTIONS = """
const ivec2 directions[4] = ivec2[4](ivec2(1, 0), ivec2(1, 1), ivec2(0, 1), ivec2(-1, 1));
"""

_EDGES_FRAGMENT = (
    _DIRECTIONS
    + """
/* x: occluding contour (0 or 1), y: angle of a crease in radians, z: index of the direction across it (0..3),
   w: edge strength, whose ridge is the line */
vec4 geometry_at(ivec2 px)
{
  return texelFetch(geometry, clamp(px, ivec2(0), textureSize(geometry, 0) - 1), 0);
}

float depth_step(vec4 before, vec4 centre, vec4 after)
{
  /* mm; 0 on a plane: there 1/depth is linear over the image in perspective, depth in parallel projection */
  if (mm_per_px.y > 0.0) {
    float beyond = centre.w + 1000.0 * mm_per_px.y;
    return (before.w > 0.0 ? before.w : beyond) + (after.w > 0.0 ? after.w : beyond) - 2.0 * centre.w;
  }
  float q_before = before.w > 0.0 ? 1.0 / before.w : 0.0;
  float q_after = after.w > 0.0 ? 1.0 / after.w : 0.0;
  return (2.0 / centre.w - q_before - q_after) * centre.w * centre.w;
}

void main()
{
  ivec2 px = ivec2(floor(at));
  vec4 centre = geometry_at(px);
  edges = vec4(0.0);
  if (centre.w <= 0.0) {
    return;
  }
  float px_mm = max(mm_per_px.x * centre.w, mm_per_px.y);
  vec4 left = geometry_at(px - ivec2(1, 0)), right = geometry_at(px + ivec2(1, 0));
  vec4 below = geometry_at(px - ivec2(0, 1)), above = geometry_at(px + ivec2(0, 1));
  float step_mm = max(depth_step(left, centre, right), depth_step(below, centre, above));
  edges.x = step_mm > max(max_slope * px_mm, min_step_mm) ? 1.0 : 0.0;

  /* creases: compare the mean normals of the two halves of a disc, cut in four directions, without samples of another
     sheet of the surface */
  vec3 normals[8];
  for (int spoke = 0; spoke < 8; spoke++) {
    float angle = 0.78539816 * float(spoke);
    vec2 direction = vec2(cos(angle), sin(angle));
    normals[spoke] = vec3(0.0);
    for (int ring = 1; ring <= 2; ring++) {
      float distance_px = 0.5 * float(ring) * radius_px;
      vec4 tap = geometry_at(px + ivec2(round(direction * distance_px)));
      if (tap.w > 0.0 && abs(tap.w - centre.w) < max_slope * px_mm * max(1.0, distance_px / magnification)) {
        normals[spoke] += tap.xyz;
      }
    }
  }
  for (int cut = 0; cut < 4; cut++) {
    vec3 ahead = normals[cut] + 0.7071 * (normals[(cut + 1) % 8] + normals[(cut + 7) % 8]);
    vec3 behind = normals[cut + 4] + 0.7071 * (normals[(cut + 5) % 8] + normals[cut + 3]);
    if (dot(ahead, ahead) > 0.5 && dot(behind, behind) > 0.5) {
      float angle = acos(clamp(dot(normalize(ahead), normalize(behind)), -1.0, 1.0));
      if (angle > edges.y) {
        edges.y = angle;
        edges.z = float(cut);
      }
    }
  }
  /* at a sharp edge the normal changes between two neighbours: put the line there */
  ivec2 across = directions[int(edges.z)];
  vec3 before = geometry_at(px - across).xyz, after = geometry_at(px + across).xyz;
  edges.w = edges.y + 0.25 * acos(clamp(dot(before, after), -1.0, 1.0));
}
"""
)

_LINES_FRAGMENT = (
    _DIRECTIONS
    + """
/* the line of a crease is the ridge of the edge strength across the disc of the search: one pixel wide at any zoom */
void main()
{
  ivec2 px = ivec2(floor(at)), last = textureSize(edges, 0) - 1;
  vec4 centre = texelFetch(edges, px, 0);
  lines = vec4(centre.x, 0.0, 0.0, 1.0);
  if (centre.y > crease_rad) {
    ivec2 across = directions[int(centre.z)];
    bool is_ridge = true;
    for (int offset = 1; offset <= ridge_px; offset++) {
      float before = texelFetch(edges, clamp(px - offset * across, ivec2(0), last), 0).w;
      float after = texelFetch(edges, clamp(px + offset * across, ivec2(0), last), 0).w;
      is_ridge = is_ridge && centre.w > before && centre.w >= after;
    }
    lines.y = is_ridge ? 0.3 + 0.7 * smoothstep(crease_rad, 1.5 * crease_rad, centre.y) : 0.0;
  }
}
"""
)

_COMPOSITE_FRAGMENT = (
    _ENCODE
    + DECODE
    + """
vec4 over(vec4 below, vec3 colour, float alpha)
{
  float both = alpha + below.a * (1.0 - alpha);
  return both <= 0.0 ? vec4(0.0) : vec4((colour * alpha + below.rgb * below.a * (1.0 - alpha)) / both, both);
}

void main()
{
  vec2 px = (at - frame_offset) / frame_scale;
  vec2 uv = vec2(px.x + 0.5, frame_size.y - 0.5 - px.y) / frame_size;
  ivec2 here = clamp(ivec2(floor(at)), ivec2(0), textureSize(geometry, 0) - 1);
  /* the frame over Blender's surface, or over all that is there */
  bool covered = texelFetch(geometry, here, 0).w > 0.0;
  vec3 recorded = encoded(texture(frame, clamp(uv, 0.5 / frame_size, 1.0 - 0.5 / frame_size)).rgb);
  composite = vec4(recorded, covered || everywhere ? frame_alpha : 0.0);
  if (inside) {
    vec4 structure = texelFetch(structures, here, 0);
    composite = over(composite, structure.rgb, structure.a);
  }
  if (contour) {
    /* from the distances to line pixels: coverage of a thin line, and of the dark halo around it */
    float line = 0.0, halo = 0.0;
    for (int y = -3; y <= 3; y++) {
      for (int x = -3; x <= 3; x++) {
        float distance_px = length(vec2(x, y)) / line_px;
        if (distance_px >= 2.75) {
          continue;
        }
        ivec2 there = here + ivec2(x, y);
        if (any(lessThan(there, ivec2(0))) || any(greaterThanEqual(there, textureSize(lines, 0)))) {
          continue;
        }
        vec2 found = texelFetch(lines, there, 0).xy;
        float strength = max(found.x, found.y);
        line = max(line, strength * clamp(1.3 - distance_px, 0.0, 1.0));
        halo = max(halo, strength * clamp(2.75 - distance_px, 0.0, 1.0));
      }
    }
    composite = over(composite, vec3(0.0), 0.55 * halo);
    composite = over(composite, line_colour.rgb, line);
  }
  /* the overlays of a 3D view encode linear values as sRGB */
  composite.rgb = decoded(composite.rgb);
}
"""
)


@cache
def surface_shader(kind: Literal["BONE", "STRUCTURE"]) -> gpu.types.GPUShader:
    """The shader that draws the surface into ``geometry``: normal and depth in view axes.

    A ``STRUCTURE`` is drawn into ``picture``, fainter where the ``geometry`` of the surface, ``bone``, hides it.
    """
    between = gpu.types.GPUStageInterfaceInfo(f"oneframe_surface_{kind.lower()}")
    between.smooth("VEC3", "normal_view")
    between.smooth("VEC3", "toward_eye")
    between.smooth("FLOAT", "depth_mm")
    info = gpu.types.GPUShaderCreateInfo()
    info.define(kind)  # type: ignore[call-arg]  # the value is optional
    info.vertex_in(0, "VEC3", "position")
    info.vertex_in(1, "VEC3", "normal")
    info.push_constant("MAT4", "view_from_model")
    info.push_constant("MAT4", "clip_from_view")
    if kind == "STRUCTURE":
        info.sampler(0, "FLOAT_2D", "bone")
        # two matrices fill the push constants that every GPU supports
        info.typedef_source("struct Plain { vec4 colour; vec4 hidden_alpha; };")
        info.uniform_buf(0, "Plain", "plain")
    info.vertex_out(between)
    info.fragment_out(0, "VEC4", "picture" if kind == "STRUCTURE" else "geometry")
    info.vertex_source(_SURFACE_VERTEX)
    info.fragment_source(_SURFACE_FRAGMENT)
    return gpu.shader.create_from_info(info)


@cache
def edges_shader() -> gpu.types.GPUShader:
    """``geometry`` -> ``edges``: discontinuities of depth, and the change of the normal around each pixel."""
    numbers = ("max_slope", "min_step_mm", "radius_px", "magnification")
    constants = (("VEC2", "mm_per_px"), *(("FLOAT", name) for name in numbers))
    return rectangle_shader("edges", _EDGES_FRAGMENT, ("geometry",), constants, out="edges")


@cache
def lines_shader() -> gpu.types.GPUShader:
    """``edges`` -> ``lines``: one pixel wide; x: occluding contour, y: crease, both 0..1."""
    constants = (("FLOAT", "crease_rad"), ("INT", "ridge_px"))
    return rectangle_shader("lines", _LINES_FRAGMENT, ("edges",), constants, out="lines")


@cache
def composite_shader() -> gpu.types.GPUShader:
    """Frame, geometry, structures and lines -> the composite drawn over the view."""
    kinds = {
        "VEC2": ("frame_scale", "frame_offset", "frame_size"),
        "VEC4": ("line_colour",),
        "FLOAT": ("frame_alpha", "line_px"),
        "BOOL": ("everywhere", "inside", "contour"),
    }
    constants = [(kind, name) for kind, names in kinds.items() for name in names]
    samplers = ("frame", "geometry", "structures", "lines")
    return rectangle_shader("composite", _COMPOSITE_FRAGMENT, samplers, constants, out="composite")
