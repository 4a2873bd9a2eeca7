"""What a lamp at the lens makes of a frame, as a picture to judge it by."""

import numpy as np

from ..images.contact_sheet import contact_sheet
from ..images.pixel_values import codes_from_linear, linear_from_codes
from ..projection.visible_surface import central_point
from ..projection.z_buffer import rasterise_depth
from ..surface.mesh import TriangleMesh
from .lens_light import LensLight, shading, working_distance_mm
from .shaded_points import Image, surface_at

LEAST_SHADING = 0.05
TILE_PX = 800
GREY = 0.5
"""Linear light of the middle of shading and albedo: each is shown as bright as the frame's own middle."""


def lamp_picture(mesh: TriangleMesh, frame: Image, light: LensLight) -> np.ndarray:
    """``(H, W, 3)`` code values 0..1: the frame, its shading by the lamp, and the frame without it, side by side."""
    pose = frame.cam_from_model
    raster = rasterise_depth(mesh, frame.camera, pose)
    shown = (raster.face >= 0) & frame.valid
    points, normals = surface_at(mesh, raster, frame, np.argwhere(shown)[:, ::-1])
    distance_mm = working_distance_mm(pose, central_point(raster.depth_mm, frame.camera, pose))
    shade = shading(light, points, normals, pose, distance_mm)
    shade = np.maximum(shade / max(float(np.median(shade)), LEAST_SHADING), LEAST_SHADING)
    albedo = linear_from_codes(frame.image[shown], light.curve) / shade[:, None]
    tiles = [frame.image]
    for linear in (GREY * np.repeat(shade[:, None], 3, axis=1), albedo):
        tile = np.zeros_like(frame.image)
        tile[shown] = np.clip(codes_from_linear(linear, light.curve), 0, 1)
        tiles.append(tile)
    return contact_sheet(tiles, columns=3, tile_width=TILE_PX)
