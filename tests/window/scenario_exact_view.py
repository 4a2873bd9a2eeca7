"""The window shows frame and surface where K and pose project them, to 0.1 px of the frame.

The frame shows dots. The surface consists of small plates that project to the same pixels, at depths from 240 to
360 mm; the principal point is off centre. The scenario measures the centres of both in pictures of the window.
"""

import itertools

import bpy
import numpy as np
from bl_ext.user_default.oneframe.pipeline.camera.pinhole import PinholeCamera
from bl_ext.user_default.oneframe.pipeline.case.case_file import Case
from bl_ext.user_default.oneframe.pipeline.case.case_writer import write_case
from bl_ext.user_default.oneframe.pipeline.images.png import encode_png
from bl_ext.user_default.oneframe.pipeline.surface.mesh import TriangleMesh
from bl_ext.user_default.oneframe.pipeline.surface.mesh_writer import write_ply
from bl_ext.user_default.oneframe.pipeline.transforms import (
    inverse_rigid,
    rigid,
    rotation_from_vector,
    transform_points,
)

CAMERA = PinholeCamera(960, 720, 5100.0, 4980.0, 402.3, 415.8)
CAM_FROM_MODEL = rigid(rotation_from_vector(np.array([0.3, -0.5, 1.1])), [2.0, -3.0, 300.0])
RADIUS_PX = 9.0
TOLERANCE_PX = 0.1
MARGIN_PX = 65


def scenario(user):
    rng = np.random.default_rng(4)
    grid = np.stack(np.meshgrid(np.linspace(40, 919, 7), np.linspace(40, 679, 6)), -1).reshape(-1, 2)
    dots = grid + rng.uniform(-15, 15, grid.shape)
    yield from user.open_case(write_dotted_case(user.folder, dots, rng))
    scene, space = bpy.context.scene, user.area.spaces.active
    surface = scene.oneframe.surface
    # smoothed pictures come to rest after several redraws, and the first ones are shifted
    bpy.context.preferences.system.viewport_aa = "OFF"
    space.shading.light, space.shading.show_cavity, space.shading.background_type = "FLAT", False, "VIEWPORT"
    space.shading.background_color = (0.0, 0.0, 0.0)
    surface.color = (1.0, 1.0, 1.0, 1.0)
    # the surface as Blender draws it
    scene.oneframe_view.opacity, scene.oneframe_view.contour = 1.0, False
    with user.context():
        bpy.ops.wm.tool_set_by_id(name="builtin.select_box")
    space.show_gizmo = space.show_region_ui = space.show_region_toolbar = space.show_region_tool_header = False
    background = scene.oneframe.camera_object.data.background_images[0]

    # zoom in until the window's pixels are smaller than the tolerance
    user.view.view_camera_zoom = 90.0
    per_offset, at_zero = yield from pan_rule(user)
    scale = user.frame_view.scale
    region_middle = np.array([user.region().width, user.region().height]) / 2
    # the frame is drawn with the overlays: switch off all others
    for what in ("show_floor", "show_axis_x", "show_axis_y", "show_cursor", "show_text", "show_extras"):
        setattr(space.overlay, what, False)
    for shown in ("frame", "surface"):
        space.overlay.show_overlays = background.show_background_image = shown == "frame"
        surface.hide_viewport = shown == "frame"
        off = {}
        for middle in itertools.product((120, 360, 600, 840), (60, 180, 300, 420, 540, 660)):
            user.view.view_camera_offset = (region_middle - middle * scale - at_zero) / per_offset
            yield from user.redraw()
            view = user.frame_view
            off |= distances((yield from user.look()), user.region(), view, dots)
        yield from user.picture(shown)
        user.facts[shown] = {"dots": len(off), "largest_px": round(max(off.values()), 4)}
        user.facts["magnification"] = round(view.magnification, 2)
        assert len(off) == len(dots), f"only {len(off)} of {len(dots)} dots were in view"
        assert max(off.values()) < TOLERANCE_PX, f"{shown}: up to {max(off.values()):.3f} px off"


def pan_rule(user):
    """Region pixels by which the frame moves per unit of the view's offset, and its position at offset 0."""
    seen = []
    for offset in (0.0, 0.01):
        user.view.view_camera_offset = offset, offset
        yield from user.redraw()
        seen.append(user.frame_view.offset)
    return (seen[1] - seen[0]) / 0.01, seen[0]


def write_dotted_case(folder, dots, rng):
    """Write a case with the dots as its frame, and plates parallel to the image as its surface."""
    v, u = np.mgrid[: CAMERA.height, : CAMERA.width]
    image = np.zeros(CAMERA.shape_hw)
    for x, y in dots:
        # smooth edges, so that the centre is known to a fraction of a pixel
        image = np.maximum(image, np.clip(RADIUS_PX + 0.5 - np.hypot(u - x, v - y), 0, 1))
    codes = np.repeat(np.rint(image * 255).astype(np.uint8)[..., None], 3, axis=2)
    (folder / "dots.png").write_bytes(encode_png(codes))
    angles = np.linspace(0, 2 * np.pi, 25)[:-1]
    vertices, faces = [], []
    for dot, depth in zip(dots, rng.uniform(240, 360, len(dots)), strict=True):
        rim = dot + RADIUS_PX * np.stack([np.cos(angles), np.sin(angles)], axis=1)
        first = len(vertices) * 25
        vertices.append(CAMERA.rays_cam(np.concatenate([dot[None], rim])) * depth)
        corners = np.arange(24)
        faces.append(first + np.stack([np.zeros(24, int), 1 + (corners + 1) % 24, 1 + corners], axis=1))
    points = transform_points(inverse_rigid(CAM_FROM_MODEL), np.concatenate(vertices))
    write_ply(folder / "plates.ply", TriangleMesh(points, np.concatenate(faces).astype(np.int32)))
    path = folder / "dots.toml"
    write_case(path, Case(path, 1.0, folder / "dots.png", CAMERA, None, folder / "plates.ply", CAM_FROM_MODEL))
    return path


def distances(picture, region, view, dots):
    """Index of each dot in view -> distance of its bright spot's centroid in the window from it, px of the frame."""
    grey = picture.astype(float).mean(axis=2)[::-1]
    grey = grey[region.y : region.y + region.height, region.x : region.x + region.width]
    reach = 1.6 * RADIUS_PX * view.magnification
    off = {}
    for number, dot in enumerate(dots):
        x, y = view.region_from_px(dot)
        low = np.floor([x - reach, y - reach]).astype(int)
        high = np.ceil([x + reach, y + reach]).astype(int)
        # toolbar and headers lie over the view
        if (low < MARGIN_PX).any() or (high > [region.width - MARGIN_PX, region.height - MARGIN_PX]).any():
            continue
        found = centroid(grey[low[1] : high[1], low[0] : high[0]])
        # in the window, a pixel's centre is half a pixel from its corner
        off[number] = float(np.abs(view.px_from_region(found + low + 0.5) - dot).max())
    return off


def centroid(spot):
    """(x, y) of a spot's centroid; the first pixel's centre is at 0."""
    weight = np.clip(spot - spot.min(), 0, None)
    y, x = np.mgrid[: spot.shape[0], : spot.shape[1]]
    return np.array([(x * weight).sum(), (y * weight).sum()]) / weight.sum()
