"""The burr under the pointer, with the distance from the nearest structure in colour and number."""

import bpy
import gpu
import numpy as np
from bpy_extras import view3d_utils
from mathutils import Matrix, Vector

from ..ui.strokes import Colour, Strokes
from ..view.fit import free_rectangle
from . import drill_session
from .drill_drawing import world_from_mesh
from .drill_gesture import Burr, burr_at, is_ready

FREE: Colour = (0.45, 0.95, 0.5, 1.0)
NEAR: Colour = (1.0, 0.8, 0.2, 1.0)
STOPPED: Colour = (1.0, 0.3, 0.25, 1.0)
NEAR_MM = 2.0
"""Up to this distance of the burr from a structure it is drawn as near."""

_handle: object | None = None


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
    left = aside if middle[0] + aside + strokes.width_of(text) < high[0] else -aside - strokes.width_of(text)
    strokes.text(middle + np.array([left, 0.7 * radius]), text, colour)
    # Blender draws cursors in pixels of the window
    from_left, below, *target = gpu.state.viewport_get()
    with gpu.matrix.push_pop(), gpu.matrix.push_pop_projection():
        width, height = target
        gpu.matrix.load_matrix(Matrix.Translation((region.x - from_left, region.y - below, 0.0)))
        clip_from_px = ((2 / width, 0, 0, -1), (0, 2 / height, 0, -1), (0, 0, -1, 0), (0, 0, 0, 1))
        gpu.matrix.load_projection_matrix(Matrix(clip_from_px))
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


def register() -> None:
    """Draw the burr with the cursor of 3D views."""
    global _handle
    _handle = bpy.types.WindowManager.draw_cursor_add(draw_burr, (), "VIEW_3D", "WINDOW")


def unregister() -> None:
    """Stop drawing."""
    global _handle
    bpy.types.WindowManager.draw_cursor_remove(_handle)
    _handle = None
