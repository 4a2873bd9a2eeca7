"""Draws the drilled bone in blocks, of which only those that have changed go to the GPU again, and the burr."""

from functools import cache

import bpy
import gpu
import numpy as np
from bpy_extras import view3d_utils
from gpu_extras.batch import batch_for_shader
from mathutils import Matrix, Vector

from ..class_registration import at_end, cursor, drawing
from ..pipeline.blender.alignment.alignment_scene import BONE_RGBA
from ..pipeline.images.pixel_values import linear_from_codes
from ..pipeline.surface.structure_colour import OTHER, structure_colour
from ..state import from_scene
from ..ui.strokes import Colour, Strokes, in_window_pixels
from ..view.zoom import free_rectangle
from . import drill_session
from .drill_gesture import is_ready
from .drill_session import BlockKey, Burr, DrillSession, burr_at, world_from_mesh

FRESH_RGB = (0.95, 0.80, 0.66)
"""Bone that the drill has opened."""

HIDDEN_ALPHA = 0.22
"""Of structures behind bone that have a colour of their own."""

FREE: Colour = (0.45, 0.95, 0.5, 1.0)
NEAR: Colour = (1.0, 0.8, 0.2, 1.0)
STOPPED: Colour = (1.0, 0.3, 0.25, 1.0)
NEAR_MM = 2.0
"""Up to this distance of the burr from a structure it is drawn as near."""

_VERTEX = """
void main()
{
  vec4 point = view_from_mesh * vec4(position, 1.0);
  gl_Position = clip_from_view * point;
  place = point.xyz;
  fresh = drilled;
}
"""

_FRAGMENT = """
void main()
{
  /* flat: blocks need no normals, and meet without a seam */
  vec3 n = normalize(cross(dFdx(place), dFdy(place)));
  vec3 light = normalize(vec3(0.25, 0.45, 0.85));
  float shade = 0.25 + 0.55 * abs(dot(n, light)) + 0.2 * abs(n.z);
  vec3 tone = mix(tones.bone.rgb, tones.fresh_bone.rgb, step(0.5, fresh));
  colour = vec4(tone * shade * shade, tones.bone.a);
}
"""

_uploaded: dict[BlockKey | str, gpu.types.GPUBatch] = {}
_of: DrillSession | None = None


@cache
def block_shader() -> gpu.types.GPUShader:
    """Faces with a mark of what was drilled, in light from the viewer."""
    between = gpu.types.GPUStageInterfaceInfo("oneframe_block")
    between.smooth("VEC3", "place")
    between.smooth("FLOAT", "fresh")
    info = gpu.types.GPUShaderCreateInfo()
    info.vertex_in(0, "VEC3", "position")
    info.vertex_in(1, "FLOAT", "drilled")
    info.vertex_out(between)
    info.push_constant("MAT4", "view_from_mesh")
    info.push_constant("MAT4", "clip_from_view")
    info.typedef_source("struct Tones { vec4 bone; vec4 fresh_bone; };")
    info.uniform_buf(0, "Tones", "tones")
    info.fragment_out(0, "VEC4", "colour")
    info.vertex_source(_VERTEX)
    info.fragment_source(_FRAGMENT)
    return gpu.shader.create_from_info(info)


def _batch(vertices: np.ndarray, drilled: np.ndarray, faces: np.ndarray) -> gpu.types.GPUBatch:
    return batch_for_shader(block_shader(), "TRIS", {"position": vertices, "drilled": drilled}, indices=faces)


def _upload(session: DrillSession) -> None:
    global _of
    if _of is not session:
        _uploaded.clear()
        _of, session.changed = session, set(session.blocks)
        for name, mesh in session.structures.items():
            vertices = mesh.vertices.astype(np.float32)
            _uploaded[name] = _batch(vertices, np.zeros(len(vertices), np.float32), mesh.faces.astype(np.int32))
    for key in session.changed:
        block = session.blocks.get(key)
        if block is None:
            _uploaded.pop(key, None)
        else:
            _uploaded[key] = _batch(block.vertices, block.drilled, block.faces)
    session.changed.clear()


def draw_bone() -> None:
    """Draw into the view that Blender is drawing now (a POST_VIEW draw handler)."""
    context = bpy.context
    scene, region_3d = context.scene, context.region_data
    session = drill_session.of(scene)
    if session is None or region_3d is None or from_scene.present_surface(scene) is None:
        return
    _upload(session)
    view_from_mesh = region_3d.view_matrix @ Matrix(world_from_mesh(scene).tolist())
    shader = block_shader()
    shader.bind()
    shader.uniform_float("view_from_mesh", view_from_mesh)
    shader.uniform_float("clip_from_view", region_3d.window_matrix)
    gpu.state.depth_mask_set(True)
    gpu.state.depth_test_set("LESS_EQUAL")
    gpu.state.blend_set("NONE")
    _draw(shader, [key for key in _uploaded if not isinstance(key, str)], BONE_RGBA[:3], FRESH_RGB, 1.0)
    # white ones are context, such as the ear canal: they would cover the bone
    coloured = {name: colour for name in session.structures if (colour := structure_colour(name)) != OTHER}
    for name, colour in coloured.items():
        _draw(shader, [name], colour, colour, 1.0)
    gpu.state.depth_mask_set(False)
    gpu.state.blend_set("ALPHA")
    for name in session.structures:
        if name not in coloured and name in session.margins_mm:
            _draw(shader, [name], OTHER, OTHER, HIDDEN_ALPHA)
    gpu.state.depth_test_set("GREATER")
    for name, colour in coloured.items():
        _draw(shader, [name], colour, colour, HIDDEN_ALPHA)
    gpu.state.depth_test_set("NONE")
    gpu.state.blend_set("NONE")


def _draw(
    shader: gpu.types.GPUShader,
    keys: list,
    bone: tuple[float, float, float],
    fresh: tuple[float, float, float],
    alpha: float,
) -> None:
    # the overlays of a 3D view take linear values; kept in a variable: the buffer must live until all is drawn
    values = [*linear_from_codes(np.array(bone)), alpha, *linear_from_codes(np.array(fresh)), alpha]
    buffer = gpu.types.GPUUniformBuf(gpu.types.Buffer("FLOAT", 8, values))
    shader.uniform_block("tones", buffer)
    for key in keys:
        _uploaded[key].draw(shader)


def draw_burr(pointer: tuple[int, int]) -> None:
    """Draw at the pointer (window px); called by Blender for the region under it, whenever it moves."""
    context = bpy.context
    region, region_3d = context.region, context.region_data
    if region is None or region_3d is None or not is_ready(context):
        return
    session = drill_session.of(context.scene)
    at = np.array([pointer[0] - region.x + 0.5, pointer[1] - region.y + 0.5])
    low, high = free_rectangle(context.area)
    if session is None or not ((at >= low).all() and (at < high).all()):
        return
    burr = burr_at(context, session, session.removed, (float(at[0]), float(at[1])))
    if burr is None:
        return
    world = world_from_mesh(context.scene)
    centre = Vector(world[:3, :3] @ burr.centre + world[:3, 3])
    across = region_3d.view_rotation @ Vector((burr.radius_mm, 0.0, 0.0))
    ends = [view3d_utils.location_3d_to_region_2d(region, region_3d, place) for place in (centre, centre + across)]
    if None in ends:
        return
    middle, side = (np.array(end, float) for end in ends)
    strokes, colour = Strokes(), colour_of(burr)
    radius = float(np.linalg.norm(side - middle))
    strokes.circle(middle, radius / strokes.unit, colour)
    strokes.cross(middle, 0.0, 3.0, colour, width=1.0)
    text, aside = text_of(burr), 0.8 * radius + 8 * strokes.unit
    shift = aside if middle[0] + aside + strokes.width_of(text) < high[0] else -aside - strokes.width_of(text)
    strokes.text(middle + np.array([shift, 0.7 * radius]), text, colour)
    with in_window_pixels() as (left, below):
        gpu.matrix.load_matrix(Matrix.Translation((region.x - left, region.y - below, 0.0)))
        strokes.draw()


def colour_of(burr: Burr) -> Colour:
    """Green far from structures, amber near one, red where a margin stops the burr."""
    return STOPPED if burr.stopped else NEAR if burr.distance_mm < NEAR_MM else FREE


def text_of(burr: Burr) -> str:
    """Diameter of the burr, and the nearest structure with its distance."""
    size = f"{2 * burr.radius_mm:.1f} mm"
    if not burr.structure:
        return size
    near = f"{burr.structure.replace('_', ' ')} {max(burr.distance_mm, 0.0):.1f} mm"
    return f"{size}   {near}{'   margin' if burr.stopped else ''}"


def _forget() -> None:
    global _of
    _of = None
    _uploaded.clear()


PARTS = (at_end(_forget), drawing(bpy.types.SpaceView3D, draw_bone, "POST_VIEW"), cursor(draw_burr))
