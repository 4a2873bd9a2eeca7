"""Pinhole camera <-> Blender camera: the intrinsics, exactly.

Blender spans ``sensor_width`` over the larger of width and height in *pixel aspect* units (``sensor_fit='AUTO'``), so
with aspects ax, ay >= 1 and S = max(W ax, H ay)::

    lens    = fx ax sensor_width / S
    shift_x = ((W - 1) / 2 - cx) ax / S
    shift_y = (cy - (H - 1) / 2) ay / S

where the -1 accounts for the half pixel between the origin (the centre of the top-left pixel) and the image's corner.
Blender stores all of it in single precision: a relative error of 1e-7, below 1e-3 px everywhere in a 1920 px frame.
"""

import bpy
import numpy as np
from mathutils import Matrix

from ...camera.pinhole import PinholeCamera
from ...errors import InputError
from ...transforms import CAM_FROM_OPENGL_CAM, inverse_rigid

SENSOR_MM = 36.0
MIN_LENS_MM = 1.0
MAX_PIXEL_ASPECT = 200.0
"""Blender keeps a scene's pixel aspects within 1 to 200."""
SMALLEST_VIEW_PX = 4
"""Blender keeps a scene's width and height from 4 px on, and renders that size instead of a smaller one."""


def new_camera(
    scene: bpy.types.Scene, camera: PinholeCamera, *, clip_mm: tuple[float, float], name: str = "camera"
) -> bpy.types.Object:
    """A camera object with these intrinsics, linked to the scene as its active camera.

    Parameters
    ----------
    scene
        Gets the resolution and pixel aspect, which Blender stores in scenes.
    camera
        Intrinsics, px.
    clip_mm
        Nearest and farthest rendered distance along the optical axis.
    """
    camera_object = bpy.data.objects.new(name, bpy.data.cameras.new(name))
    scene.collection.objects.link(camera_object)
    scene.camera = camera_object
    set_intrinsics(scene, camera_object, camera)
    set_clip(camera_object, clip_mm)
    return camera_object


def set_intrinsics(scene: bpy.types.Scene, camera_object: bpy.types.Object, camera: PinholeCamera) -> None:
    """Give a camera object (and the scene's resolution and pixel aspect) the intrinsics of ``camera``."""
    if min(camera.size_wh) < SMALLEST_VIEW_PX:
        raise InputError(
            f"view: expected at least {SMALLEST_VIEW_PX} px along each side, found {camera.width}x{camera.height}; "
            "use a larger frame or --scale"
        )
    aspect_x, aspect_y = max(1.0, camera.fy / camera.fx), max(1.0, camera.fx / camera.fy)
    if max(aspect_x, aspect_y) > MAX_PIXEL_ASPECT:
        raise InputError(
            f"K: expected fx and fy within a factor of {MAX_PIXEL_ASPECT:g}, found {camera.fx:g} and {camera.fy:g}; "
            "check the intrinsics"
        )
    span = max(camera.width * aspect_x, camera.height * aspect_y)
    data = camera_object.data
    data.type = "PERSP"
    data.sensor_fit = "AUTO"
    # a very short lens would fall below Blender's 1 mm: a larger sensor gives the same field of view
    data.sensor_width = max(SENSOR_MM, 1.01 * MIN_LENS_MM * span / (camera.fx * aspect_x))
    # read the sensor width back: the lens must match the value that Blender rounds to single precision
    data.lens = camera.fx * aspect_x * data.sensor_width / span
    data.shift_x = ((camera.width - 1) / 2 - camera.cx) * aspect_x / span
    data.shift_y = (camera.cy - (camera.height - 1) / 2) * aspect_y / span
    data.dof.use_dof = False
    render = scene.render
    render.resolution_x, render.resolution_y, render.resolution_percentage = camera.width, camera.height, 100
    render.pixel_aspect_x, render.pixel_aspect_y = aspect_x, aspect_y


def set_clip(camera_object: bpy.types.Object, clip_mm: tuple[float, float]) -> None:
    """Set the nearest and farthest rendered distance along the optical axis, mm."""
    camera_object.data.clip_start, camera_object.data.clip_end = clip_mm


def place_camera(camera_object: bpy.types.Object, cam_from_model: np.ndarray) -> None:
    """Set the pose of a camera object to ``cam_from_model`` (4x4, mm)."""
    camera_object.matrix_world = Matrix(inverse_rigid(cam_from_model) @ CAM_FROM_OPENGL_CAM)


def cam_from_model_of(camera_object: bpy.types.Object) -> np.ndarray:
    """The pose of a camera object as ``cam_from_model``: the inverse of :func:`place_camera`."""
    return inverse_rigid(np.array(camera_object.matrix_world, dtype=np.float64) @ CAM_FROM_OPENGL_CAM)
