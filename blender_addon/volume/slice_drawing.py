"""Draws the slices: grey values, the threshold's contour, structures, what was drilled, directions, a scale bar."""

from functools import cache

import bpy
import gpu
import numpy as np

from ..class_registration import at_end, drawing
from ..pipeline.surface.structure_colour import structure_colour
from ..pipeline.volume.bone.isosurface import RemovedField
from ..pipeline.volume.bone.structures import structure_name, without_bone
from ..pipeline.volume.slices.slice_planes import SlicePlane
from ..pipeline.volume.slices.slice_views import BONE_COLOUR, DRILL_COLOUR
from ..ui.rectangle import bound_rectangle, rectangle_shader
from ..ui.strokes import TEXT_SIZE, Colour, Strokes
from . import drill_session
from .loaded import LoadedCT
from .slice_areas import SliceView

INK: Colour = (0.95, 0.95, 0.95, 1.0)
CROSS: Colour = (0.35, 0.75, 1.0, 0.8)
TINT_OPACITY = 0.4
LINE_PX = 1.6
BAR_SHARE = 0.3
"""Most of the area's width that the scale bar takes."""

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

_textures: dict[int, tuple[object, gpu.types.GPUTexture, gpu.types.GPUTexture]] = {}
"""By the number of the plane: what it was made of, the slice, its tints."""


def draw_slice() -> None:
    """Draw the slice of the area that Blender is drawing now (a POST_PIXEL draw handler)."""
    context = bpy.context
    view = SliceView.of(context)
    if view is None:
        return
    _draw_picture(context.scene, view)
    _draw_marks(context, view)


def _draw_picture(scene: bpy.types.Scene, view: SliceView) -> None:
    settings = scene.oneframe_ct
    hu, tints = _uploaded(view)
    width, height = view.plane.size_wh
    corners_px = np.array([[-0.5, -0.5], [width - 0.5, -0.5], [width - 0.5, height - 0.5], [-0.5, height - 0.5]])
    shader = slice_shader()
    batch = bound_rectangle(shader, corners_px * view.scale + view.offset, corners_px)
    shader.uniform_float("window", (settings.level_hu, settings.width_hu))
    shader.uniform_float("threshold", settings.threshold_hu)
    shader.uniform_float("line_colour", (*BONE_COLOUR, 1.0))
    shader.uniform_float("line_px", LINE_PX * bpy.context.preferences.system.ui_scale)
    shader.uniform_sampler("slice", hu)
    shader.uniform_sampler("tints", tints)
    batch.draw(shader)


def _uploaded(view: SliceView) -> tuple[gpu.types.GPUTexture, gpu.types.GPUTexture]:
    session = drill_session.of(bpy.context.scene)
    strokes = bpy.context.scene.oneframe_ct.strokes_text
    made_of = (id(view.ct), view.number, strokes if session is None else (id(session), session.revision))
    number = view.ct.planes.index(view.plane)
    found = _textures.get(number)
    if found is None or found[0] != made_of:
        tints = _tints(view.ct, view.plane, view.number, drill_session.removed_in(bpy.context.scene, view.ct))
        found = made_of, hu_texture(view.plane.slice_of(view.ct.volume.values, view.number)), tint_texture(tints)
        _textures[number] = found
    return found[1], found[2]


def _tints(ct: LoadedCT, plane: SlicePlane, number: int, removed: RemovedField | None) -> np.ndarray:
    """``(H, W, 4)``, or a single pixel if nothing is tinted."""
    width, height = plane.size_wh
    tints = np.zeros((1, 1, 4), np.float32)
    if ct.labels is not None and ct.label_values is not None:
        colours = np.zeros((int(max(ct.labels.names, default=0)) + 1, 4), np.float32)
        for label, name in without_bone(ct.labels).names.items():
            colours[label] = *structure_colour(structure_name(name)), TINT_OPACITY
        tints = colours[plane.slice_of(ct.label_values, number)]
    if removed is not None:
        across = plane.axes[0]
        at = number - int(removed.first[across])
        if 0 <= at < removed.distance_mm.shape[2 - across]:
            gone = np.zeros([ct.volume.values.shape[axis] for axis in range(3) if axis != 2 - across], np.bool_)
            box = tuple(
                slice(int(removed.first[2 - axis]), int(removed.first[2 - axis]) + removed.distance_mm.shape[axis])
                for axis in range(3)
                if axis != 2 - across
            )
            gone[box] = np.take(removed.distance_mm, at, axis=2 - across) <= 0
            if tints.shape[:2] != (height, width):
                tints = np.zeros((height, width, 4), np.float32)
            tints[plane.oriented(gone)] = *DRILL_COLOUR, TINT_OPACITY
    return tints


def _draw_marks(context: bpy.types.Context, view: SliceView) -> None:
    """Cross of the scene's point, directions at the sides, the slice's place, a scale bar."""
    region, plane, point = context.region, view.plane, np.array(context.scene.oneframe_ct.cursor_mm)
    strokes = Strokes()
    unit = strokes.unit
    _, u, v = plane.place_of(point)
    x, y = view.region_from_px(np.array([u, v]))
    gap, wide, high = 10 * unit, float(region.width), float(region.height)
    for start, end in (
        ((0, y), (x - gap, y)),
        ((x + gap, y), (wide, y)),
        ((x, 0), (x, y - gap)),
        ((x, y + gap), (x, high)),
    ):
        strokes.line(np.array([start, end]), CROSS, width=1.0)
    left, right, top, bottom = tuple(plane.directions)
    middle, size = (wide / 2, high / 2), TEXT_SIZE * unit
    for letter, at in (
        (left, (8 * unit, middle[1])),
        (right, (wide - 8 * unit - size, middle[1])),
        (top, (middle[0], high - 8 * unit - size)),
        (bottom, (middle[0], 8 * unit)),
    ):
        strokes.text(np.array(at), letter, INK)
    axis, number = {"axial": ("z", 2), "coronal": ("y", 1), "sagittal": ("x", 0)}[plane.name]
    place = point[number]
    strokes.text(np.array([8 * unit, high - 8 * unit - size]), f"{plane.name.capitalize()}  {axis} {place:.1f} mm", INK)
    _scale_bar(strokes, view, wide)
    strokes.text(np.array([wide - 92 * unit, 8 * unit]), f"{_hu_at(view, u, v)} HU", INK)
    strokes.draw()


def _hu_at(view: SliceView, u: float, v: float) -> int:
    part = view.plane.slice_of(view.ct.volume.values, view.number)
    row, column = (int(np.clip(round(at), 0, count - 1)) for at, count in zip((v, u), part.shape, strict=True))
    return int(part[row, column])


def _scale_bar(strokes: Strokes, view: SliceView, wide: float) -> None:
    px_per_mm = abs(float(view.scale[0])) / view.plane.pixel_mm[0]
    longest = BAR_SHARE * wide / px_per_mm
    decade = 10 ** np.floor(np.log10(max(longest, 1e-6)))
    length = decade * max((step for step in (1, 2, 5) if step * decade <= longest), default=1)
    x, y, unit = 10 * strokes.unit, 12 * strokes.unit, strokes.unit
    strokes.line(np.array([[x, y], [x + length * px_per_mm, y]]), INK, width=3.0)
    strokes.text(np.array([x, y + 8 * unit]), f"{length:g} mm", INK)


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


PARTS = (at_end(_textures.clear), drawing(bpy.types.SpaceImageEditor, draw_slice, "POST_PIXEL"))
