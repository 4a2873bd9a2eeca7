"""Maps pixels of the frame to a 3D view through the frame's camera, at any zoom and pan, and to the surface."""

from dataclasses import dataclass

import bpy
import numpy as np
from bpy_extras import view3d_utils
from mathutils import Matrix, Vector
from numpy.typing import ArrayLike

from ..pipeline.blender.alignment.surface_object import first_hit
from ..pipeline.blender.bridge.camera import cam_from_model_of
from ..pipeline.camera.pinhole import PinholeCamera
from ..pipeline.errors import InputError
from ..pipeline.transforms import inverse_rigid, transform_points
from ..state import from_scene


@dataclass(frozen=True)
class FrameView:
    """A view through the frame's camera: ``region = px * scale + offset``, in region pixels (origin bottom-left).

    Attributes
    ----------
    camera
        The frame's intrinsics.
    scale
        ``(2,)`` region pixels per frame pixel; the second is negative, since a region's y axis points up.
    offset
        ``(2,)`` position of the top-left pixel's centre in the region.
    """

    camera: PinholeCamera
    scale: np.ndarray
    offset: np.ndarray

    @classmethod
    def of(cls, scene: bpy.types.Scene, region: bpy.types.Region, region_3d: bpy.types.RegionView3D) -> "FrameView":
        """The mapping for a region that looks through the frame's camera (see :func:`shows_frame`)."""
        camera_object = from_scene.camera_object_of(scene)
        camera = from_scene.camera(scene)
        corners = np.array([[0.0, 0.0], [camera.width - 1.0, camera.height - 1.0]])
        # far enough for single precision; the clip planes have no effect
        points_cam = camera.rays_cam(corners) * 100.0
        world_from_cam = inverse_rigid(cam_from_model_of(camera_object))
        seen = [
            view3d_utils.location_3d_to_region_2d(region, region_3d, Vector(point))
            for point in transform_points(world_from_cam, points_cam)
        ]
        first, last = np.array(seen[0], float), np.array(seen[1], float)
        scale = (last - first) / np.maximum(corners[1] - corners[0], 1.0)
        return cls(camera, scale, first)

    def region_from_px(self, pixels: ArrayLike) -> np.ndarray:
        """``(..., 2)`` frame pixels -> ``(..., 2)`` region pixels."""
        return np.asarray(pixels, float) * self.scale + self.offset

    def px_from_region(self, points: ArrayLike) -> np.ndarray:
        """``(..., 2)`` region pixels -> ``(..., 2)`` frame pixels."""
        return (np.asarray(points, float) - self.offset) / self.scale

    @property
    def magnification(self) -> float:
        """Region pixels per frame pixel."""
        return float(np.abs(self.scale).mean())


def shows_frame(context: bpy.types.Context) -> bool:
    """Whether the context's 3D view looks through the frame's camera."""
    space = context.space_data
    if space is None or space.type != "VIEW_3D" or space.region_3d.view_perspective != "CAMERA":
        return False
    camera_object = context.scene.oneframe.camera_object
    active = space.camera if space.use_local_camera else context.scene.camera
    return camera_object is not None and active == camera_object


def window_region(area: bpy.types.Area) -> bpy.types.Region:
    """The region of a 3D view that shows the scene; the context's region may be another, such as the sidebar."""
    return next(region for region in area.regions if region.type == "WINDOW")


def surface_point(scene: bpy.types.Scene, origin_world: Vector, direction_world: Vector) -> np.ndarray | None:
    """``(3,)`` first hit of a ray with the surface, in the model frame, mm; ``None`` if it misses."""
    surface = from_scene.surface_of(scene)
    model_from_world: Matrix = surface.matrix_world.inverted()
    if surface.mode == "EDIT":
        raise InputError("expected Object mode; press Tab to leave Edit mode, then pick")
    start = model_from_world @ origin_world
    direction = (model_from_world.to_3x3() @ direction_world).normalized()
    hit = first_hit(surface, start, direction)
    return None if hit is None else np.array(hit[0], float)


def surface_point_at(scene: bpy.types.Scene, pixel: np.ndarray) -> np.ndarray | None:
    """``(3,)`` surface point (model frame, mm) that a frame pixel ``(2,)`` shows at the current pose, or ``None``."""
    camera_object = from_scene.camera_object_of(scene)
    world_from_cam = inverse_rigid(cam_from_model_of(camera_object))
    ray = world_from_cam[:3, :3] @ from_scene.camera(scene).rays_cam(np.asarray(pixel, float)[None])[0]
    return surface_point(scene, Vector(world_from_cam[:3, 3]), Vector(ray))
