"""The surface as an object in the scene: its pose in front of the frame's camera, and its mesh.

The object's coordinates are the ``model`` frame. The matrices of camera and surface define the pose, however they were
moved. Blender stores them in single precision, so the exact pose that was set is stored as well and is valid until one
of the objects moves.
"""

from collections.abc import Sequence
from functools import lru_cache

import bpy
import numpy as np
from mathutils import Matrix, Vector

from ...camera.pinhole import PinholeCamera
from ...errors import InputError
from ...projection.visible_surface import VisibleSurface, cast_grid
from ...surface.mesh import TriangleMesh, checked_mesh
from ...transforms import CAM_FROM_OPENGL_CAM, checked_rigid, inverse_rigid, nearest_rotation, rigid
from ..bridge.data_blocks import exact, new_mesh_object, set_exact

SURFACE = "OneFrame surface"

POSE, OFFSET = "oneframe_cam_from_model", "oneframe_given_from_model"
"""Custom properties of the surface object: its pose ``cam_from_model``, and ``mesh_from_model``."""

SCALE_TOLERANCE = 1e-4
"""Largest deviation of an object's axes from unit length and right angles that counts as rounding.

Single precision causes 1e-6; the smallest change that a user can type in Blender's panel is 1e-3.
"""

POSE_TOLERANCE = 2e-6
"""Largest difference between a matrix and the stored pose, relative to its size, that counts as rounding."""

GRID = 12
"""Number of rays along the longer side of the frame, by which the part of the surface that it sees is found."""


def new_surface_object(mesh: TriangleMesh, mesh_from_model: np.ndarray, cam_from_model: np.ndarray) -> bpy.types.Object:
    """A surface object with its mesh (model frame) and pose (4x4, mm), not linked to any collection."""
    surface = new_mesh_object(SURFACE, mesh)
    surface.rotation_mode = "QUATERNION"
    set_exact(surface, OFFSET, mesh_from_model)
    set_pose(None, surface, cam_from_model)
    return surface


def set_pose(camera_object: bpy.types.Object | None, surface: bpy.types.Object, cam_from_model: np.ndarray) -> None:
    """Move the surface so that its pose relative to the camera object is ``cam_from_model`` (4x4, mm)."""
    world_from_opengl_cam = np.eye(4) if camera_object is None else _rigid_placement(camera_object)
    surface.parent = None
    surface.matrix_world = Matrix(world_from_opengl_cam @ CAM_FROM_OPENGL_CAM @ cam_from_model)
    set_exact(surface, POSE, cam_from_model)


def pose_of(camera_object: bpy.types.Object | None, surface: bpy.types.Object) -> np.ndarray:
    """``cam_from_model`` (4x4, mm) of the objects; the exact pose that was set if they have not moved since."""
    camera = None if camera_object is None else (_placement(camera_object).tobytes(), camera_object.name)
    placed = _placed(camera, _placement(surface).tobytes(), surface.name)
    stored = exact(surface, POSE)
    if stored is not None and stored.shape == (4, 4):
        size = np.array([1.0, 1.0, 1.0, max(1.0, float(np.abs(stored[:3, 3]).max()))])
        if (np.abs(placed - stored) <= POSE_TOLERANCE * size).all():
            return stored
    return placed.copy()


@lru_cache(maxsize=8)
def _placed(camera: tuple[bytes, str] | None, world_from_model: bytes, name: str) -> np.ndarray:
    """``cam_from_model`` by a camera's placement and name, and a surface's; a window that is drawn asks many times."""
    opengl_cam_from_world = np.eye(4)
    if camera is not None:
        world_from_cam = np.frombuffer(camera[0]).reshape(4, 4)
        opengl_cam_from_world = inverse_rigid(_checked_placement(world_from_cam, camera[1]))
    placement = np.frombuffer(world_from_model).reshape(4, 4)
    _check_unscaled(placement, name)
    return checked_rigid(CAM_FROM_OPENGL_CAM @ opengl_cam_from_world @ placement, name)[0]


def make_rigid(camera_object: bpy.types.Object | None, surface: bpy.types.Object) -> None:
    """Remove scale, shear and mirroring from the surface object; its origin keeps its place in the image."""
    world_from_model = np.array(surface.matrix_world, dtype=np.float64)
    rotation = nearest_rotation(world_from_model[:3, :3])
    opengl_cam_from_world = np.eye(4) if camera_object is None else inverse_rigid(_rigid_placement(camera_object))
    cam_from_model = CAM_FROM_OPENGL_CAM @ opengl_cam_from_world @ rigid(rotation, world_from_model[:3, 3])
    surface.delta_scale = (1.0, 1.0, 1.0)
    set_pose(camera_object, surface, cam_from_model)
    surface.scale = (1.0, 1.0, 1.0)


def mesh_from_model_of(surface: bpy.types.Object) -> np.ndarray:
    """``mesh_from_model`` (4x4, mm) of the surface object; the identity for an object without one."""
    stored = exact(surface, OFFSET)
    return np.eye(4) if stored is None or stored.shape != (4, 4) else stored


def edited_mesh(surface: bpy.types.Object) -> TriangleMesh:
    """The surface object's current mesh (model frame, mm), with polygons split into triangles."""
    if surface.mode == "EDIT":
        surface.update_from_editmode()
    data = surface.data
    vertices = np.empty(3 * len(data.vertices), np.float32)
    data.vertices.foreach_get("co", vertices)
    data.calc_loop_triangles()
    faces = np.empty(3 * len(data.loop_triangles), np.int32)
    data.loop_triangles.foreach_get("vertices", faces)
    return checked_mesh(vertices.reshape(-1, 3), faces.reshape(-1, 3), surface.name)[0]


def replace_mesh(surface: bpy.types.Object, mesh: TriangleMesh, mesh_from_model: np.ndarray) -> None:
    """Replace the mesh of the surface object by another one (model frame); its children stay where they are.

    The pose is to be set again: the new mesh has a model frame of its own.
    """
    old, shift = surface.data, mesh_from_model_of(surface)[:3, 3] - mesh_from_model[:3, 3]
    fresh = new_mesh_object(SURFACE, mesh)
    surface.data = fresh.data
    bpy.data.objects.remove(fresh)
    for material in old.materials:
        surface.data.materials.append(material)
    if old.users == 0:
        bpy.data.meshes.remove(old)
    for child in surface.children:
        child.location = Vector(child.location) + Vector(shift)
    set_exact(surface, OFFSET, mesh_from_model)


def scale(camera_object: bpy.types.Object | None, surface: bpy.types.Object, factor: float) -> None:
    """Scale surface and children about the camera's centre: the picture stays, and so do attributes such as colours."""
    pose, mesh_from_model = pose_of(camera_object, surface).copy(), mesh_from_model_of(surface)
    for scaled in (surface, *surface.children):
        if scaled.type == "MESH":
            vertices = np.empty(3 * len(scaled.data.vertices), np.float32)
            scaled.data.vertices.foreach_get("co", vertices)
            scaled.data.vertices.foreach_set("co", (vertices * factor).astype(np.float32))
            scaled.data.update()
    for child in surface.children:
        child.location = factor * Vector(child.location)
    for b_from_model in (pose, mesh_from_model):
        b_from_model[:3, 3] *= factor
    set_exact(surface, OFFSET, mesh_from_model)
    set_pose(camera_object, surface, pose)


def radius_of(surface: bpy.types.Object) -> float:
    """Largest distance of a vertex from the surface object's origin, mm; reads no faces, so large meshes are fast."""
    vertices = np.empty(3 * len(surface.data.vertices), np.float32)
    surface.data.vertices.foreach_get("co", vertices)
    return float(np.sqrt((vertices.reshape(-1, 3).astype(float) ** 2).sum(axis=1).max(initial=0.0)))


def _rigid_placement(camera_object: bpy.types.Object) -> np.ndarray:
    return _checked_placement(_placement(camera_object), camera_object.name)


def _placement(placed: bpy.types.Object) -> np.ndarray:
    return np.array(placed.matrix_world, dtype=np.float64)


def _checked_placement(world_from_object: np.ndarray, name: str) -> np.ndarray:
    _check_unscaled(world_from_object, name)
    return checked_rigid(world_from_object, name)[0]


def _check_unscaled(world_from_object: np.ndarray, name: str) -> None:
    axes = world_from_object[:3, :3]
    if not np.isfinite(world_from_object).all():
        raise InputError(f"{name}: expected a finite transform, found NaN or infinity; undo the last step")
    lengths = np.linalg.norm(axes, axis=0)
    deviation = float(np.abs(axes.T @ axes - np.eye(3)).max())
    if deviation <= SCALE_TOLERANCE and np.linalg.det(axes) > 0:
        return
    scales = " x ".join(f"{length:.4g}" for length in lengths)
    kind = "mirrored" if np.linalg.det(axes) < 0 else "scaled"
    if kind == "scaled" and np.abs(lengths - 1).max() <= SCALE_TOLERANCE:
        kind = "sheared"
    raise InputError(
        f"{name}: expected an object that is only moved and rotated, it is {kind} ({scales}); "
        "press Remove Scale, or undo"
    )


def first_hit(
    surface: bpy.types.Object, origin: Sequence[float] | Vector, direction: Sequence[float] | Vector
) -> tuple[Vector, Vector] | None:
    """Point and normal where a ray (model frame) first meets the surface object, ``None`` if it misses."""
    try:
        hit, point, normal, _ = surface.ray_cast(origin, direction)
    except RuntimeError:  # Blender raises nothing more specific
        raise InputError(
            f"{surface.name}: expected a surface in the view layer, its collection is excluded or disabled; "
            "enable the collection in the Outliner"
        ) from None
    return (point, normal) if hit else None


def visible_surface(surface: bpy.types.Object, camera: PinholeCamera, cam_from_model: np.ndarray) -> VisibleSurface:
    """Cast a grid of rays from the camera at the surface object (evaluated, in Object mode); see :func:`first_hit`."""
    return cast_grid(
        lambda origin, direction: first_hit(surface, origin, direction), camera, cam_from_model, along=GRID
    )
