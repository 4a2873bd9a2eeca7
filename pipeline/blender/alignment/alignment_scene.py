"""The scene in which a frame is aligned: the frame's camera at the world's origin and the surface before it.

The world is the camera's frame with Blender's axes (x right, y up, looking along -z), one unit is a millimetre. The
camera stays where it is; aligning moves the surface, whose object has the ``model`` frame. Structures are its children.
The pose is what the two objects' matrices say, whoever moved them. Blender holds these in single precision, so the pose
that was set is kept beside them exactly and holds for as long as the objects stand where it put them.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import bpy
import numpy as np
from mathutils import Matrix

from ...camera.pinhole import PinholeCamera
from ...case.loaded_case import LoadedCase
from ...errors import InputError
from ...images.pixel_values import to_uint8
from ...images.png import encode_png
from ...surface.mesh import TriangleMesh, checked_mesh
from ...transforms import CAM_FROM_OPENGL_CAM, checked_rigid, inverse_rigid, nearest_rotation, rigid
from ..bridge.camera import SENSOR_MM, new_camera, set_clip, set_intrinsics
from ..bridge.data_blocks import new_mesh_object
from ..bridge.exact_values import exact, set_exact
from ..bridge.versions import new_node_material


@dataclass(frozen=True)
class AlignmentObjects:
    """The objects of an alignment: camera, surface, and structures in the order of the case."""

    camera: bpy.types.Object
    surface: bpy.types.Object
    structures: tuple[bpy.types.Object, ...]


def set_up(scene: bpy.types.Scene, loaded: LoadedCase) -> AlignmentObjects:
    """Put a case into a scene in place of the alignment that is there."""
    clear(scene)
    set_alignment_units(scene)
    camera_object = put_camera(scene, None, loaded.case.camera)
    show_frame(camera_object, frame_image(loaded.case.image, loaded.image if loaded.case.distortion else None))
    surface = put_surface(scene, loaded.mesh, loaded.mesh_from_model, loaded.cam_from_model)
    structures = [put_structure(surface, mesh, entry.name, entry.colour) for entry, mesh in loaded.structures]
    fit_clip(camera_object, loaded.mesh.radius, loaded.cam_from_model)
    return AlignmentObjects(camera_object, surface, tuple(structures))


def clear(scene: bpy.types.Scene) -> None:
    """Remove all that an alignment brought to a scene; what else lies in the scene stays."""
    for collection in list(scene.collection.children):
        if collection.name.split(".")[0] == COLLECTION:
            remove_objects(collection.objects)
            bpy.data.collections.remove(collection)


def remove_objects(objects: Iterable[bpy.types.Object]) -> None:
    """Remove objects and their meshes or cameras, where nothing else uses these."""
    data = [found.data for found in objects if found.data is not None]
    bpy.data.batch_remove(list(objects))
    bpy.data.batch_remove([block for block in data if block.users == 0])


def frame_image(path: Path, undistorted: np.ndarray | None) -> bpy.types.Image:
    """The frame for display: the file itself, or the undistorted ``(H, W, 3)`` values packed into the .blend file."""
    if undistorted is None:
        return bpy.data.images.load(str(path.resolve()), check_existing=True)
    data = encode_png(to_uint8(undistorted))
    name = f"{path.name} (undistorted)"
    existing = bpy.data.images.get(name)
    if existing is not None:
        bpy.data.images.remove(existing)
    height, width = undistorted.shape[:2]
    image = bpy.data.images.new(name, width, height)
    image.source = "FILE"
    image.pack(data=data, data_len=len(data))
    return image


COLLECTION, CAMERA, SURFACE = "OneFrame", "OneFrame camera", "OneFrame surface"


POSE, OFFSET, INTRINSICS = "oneframe_cam_from_model", "oneframe_given_from_model", "oneframe_intrinsics"
"""Custom properties: of the surface object twice, of the camera object."""


SCALE_TOLERANCE = 1e-4
"""Largest departure of an object's axes from unit length, or from right angles, that is rounding (single precision
leaves 1e-6; the smallest change a user can type in Blender's panel is 1e-3)."""


POSE_TOLERANCE = 2e-6
"""How far a matrix may be from the stored pose, relative to its size, to be the same in single precision."""


def alignment_collection(scene: bpy.types.Scene) -> bpy.types.Collection:
    """The collection of all that the alignment brings, made and linked to the scene if it is not there."""
    for collection in scene.collection.children:
        if collection.name.split(".")[0] == COLLECTION:
            return collection
    collection = bpy.data.collections.new(COLLECTION)
    scene.collection.children.link(collection)
    return collection


def set_alignment_units(scene: bpy.types.Scene) -> None:
    """Millimetres as units and colours shown as recorded."""
    scene.unit_settings.system = "METRIC"
    scene.unit_settings.scale_length = 0.001
    scene.unit_settings.length_unit = "MILLIMETERS"
    scene.view_settings.view_transform = "Standard"
    scene.view_settings.look = "None"


def put_camera(
    scene: bpy.types.Scene, camera_object: bpy.types.Object | None, camera: PinholeCamera
) -> bpy.types.Object:
    """Give the scene a camera with these intrinsics at the world's origin, or change the one that is given."""
    if camera_object is None:
        camera_object = new_camera(scene, camera, clip_mm=(1.0, 10_000.0), name=CAMERA)
        scene.collection.objects.unlink(camera_object)
        alignment_collection(scene).objects.link(camera_object)
    else:
        scene.camera = camera_object
        set_intrinsics(scene, camera_object, camera)
    camera_object.matrix_world = Matrix.Identity(4)
    # the view is navigated, never the camera moved by accident
    camera_object.lock_location = camera_object.lock_rotation = camera_object.lock_scale = (True,) * 3
    camera_object.hide_select = True
    camera_object.data.show_passepartout = True
    camera_object.data.passepartout_alpha = 0.6
    camera_object.data.display_size = SENSOR_MM
    set_exact(camera_object, INTRINSICS, [camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy])
    return camera_object


def camera_of(camera_object: bpy.types.Object) -> PinholeCamera:
    """The intrinsics that :func:`put_camera` set, exactly.

    Raises
    ------
    InputError
        The object has none.
    """
    values = exact(camera_object, INTRINSICS)
    if values is None or values.shape != (6,):
        raise InputError(
            f"{camera_object.name}: expected a camera with intrinsics K, found none; load the camera again"
        )
    width, height, fx, fy, cx, cy = values.tolist()
    return PinholeCamera(int(width), int(height), fx, fy, cx, cy)


def show_frame(camera_object: bpy.types.Object, image: bpy.types.Image) -> None:
    """Make an image the camera's background: it fills the camera's frame, pixel by pixel, behind everything."""
    data = camera_object.data
    data.show_background_images = True
    background = data.background_images[0] if data.background_images else data.background_images.new()
    background.image = image
    background.alpha, background.display_depth, background.frame_method = 1.0, "BACK", "STRETCH"
    background.scale, background.rotation, background.offset = 1.0, 0.0, (0.0, 0.0)
    background.use_flip_x = background.use_flip_y = False


def put_surface(
    scene: bpy.types.Scene, mesh: TriangleMesh, mesh_from_model: np.ndarray, cam_from_model: np.ndarray
) -> bpy.types.Object:
    """A new surface object in the scene.

    Parameters
    ----------
    scene
        Gets the object, in the alignment's collection.
    mesh
        In the model frame.
    mesh_from_model, cam_from_model
        4x4, mm; kept with the object.
    """
    surface = new_mesh_object(SURFACE, mesh)
    alignment_collection(scene).objects.link(surface)
    surface.data.materials.append(_plain_material("OneFrame bone", (0.75, 0.72, 0.62, 1.0)))
    # the frame is seen through it from the start
    surface.color = (0.75, 0.72, 0.62, 0.6)
    surface.rotation_mode = "QUATERNION"
    set_exact(surface, OFFSET, mesh_from_model)
    set_pose(None, surface, cam_from_model)
    return surface


def put_structure(
    surface: bpy.types.Object, mesh: TriangleMesh, name: str, colour: tuple[float, float, float]
) -> bpy.types.Object:
    """A structure (model frame) that moves with the surface, in its colour (sRGB 0..1)."""
    structure = new_mesh_object(name, mesh)
    surface.users_collection[0].objects.link(structure)
    structure.parent = surface
    structure.color = (*colour, 1.0)
    structure.data.materials.append(_plain_material(f"OneFrame {name}", (*colour, 1.0)))
    # anatomy in the bone: an annotator wants to see it whatever lies before it
    structure.show_in_front = True
    structure.hide_select = True
    return structure


def mesh_from_model_of(surface: bpy.types.Object) -> np.ndarray:
    """4x4, mm: leads from the surface's model frame to that of its mesh file; the identity for a foreign object."""
    stored = exact(surface, OFFSET)
    return np.eye(4) if stored is None or stored.shape != (4, 4) else stored


def set_pose(camera_object: bpy.types.Object | None, surface: bpy.types.Object, cam_from_model: np.ndarray) -> None:
    """Put the surface where ``cam_from_model`` (4x4, mm) says, as seen from the camera object."""
    world_from_opengl_cam = np.eye(4) if camera_object is None else _placed(camera_object)
    surface.parent = None
    surface.matrix_world = Matrix(world_from_opengl_cam @ CAM_FROM_OPENGL_CAM @ cam_from_model)
    set_exact(surface, POSE, cam_from_model)


def pose_of(camera_object: bpy.types.Object | None, surface: bpy.types.Object) -> np.ndarray:
    """``cam_from_model`` (4x4, mm), as the objects stand now; the exact one that was set if they have not moved.

    Raises
    ------
    InputError
        The surface or the camera is scaled, sheared or mirrored: no rigid pose describes that.
    """
    opengl_cam_from_world = np.eye(4) if camera_object is None else inverse_rigid(_placed(camera_object))
    world_from_model = np.array(surface.matrix_world, dtype=np.float64)
    _check_unscaled(world_from_model, surface.name)
    placed, _ = checked_rigid(CAM_FROM_OPENGL_CAM @ opengl_cam_from_world @ world_from_model, surface.name)
    stored = exact(surface, POSE)
    if stored is not None and stored.shape == (4, 4):
        size = np.array([1.0, 1.0, 1.0, max(1.0, float(np.abs(stored[:3, 3]).max()))])
        if (np.abs(placed - stored) <= POSE_TOLERANCE * size).all():
            return stored
    return placed


def edited_mesh(surface: bpy.types.Object) -> TriangleMesh:
    """The surface object's mesh as it is in Blender now (model frame, mm), polygons cut into triangles.

    Raises
    ------
    InputError
        It has no faces any more.
    """
    if surface.mode == "EDIT":
        surface.update_from_editmode()
    data = surface.data
    vertices = np.empty(3 * len(data.vertices), np.float32)
    data.vertices.foreach_get("co", vertices)
    data.calc_loop_triangles()
    faces = np.empty(3 * len(data.loop_triangles), np.int32)
    data.loop_triangles.foreach_get("vertices", faces)
    return checked_mesh(vertices.reshape(-1, 3), faces.reshape(-1, 3), surface.name)[0]


def radius_of(surface: bpy.types.Object) -> float:
    """Largest distance of a vertex from the surface object's origin, mm; of a large mesh far quicker than its faces."""
    vertices = np.empty(3 * len(surface.data.vertices), np.float32)
    surface.data.vertices.foreach_get("co", vertices)
    return float(np.sqrt((vertices.reshape(-1, 3).astype(float) ** 2).sum(axis=1).max(initial=0.0)))


def replace_mesh(surface: bpy.types.Object, mesh: TriangleMesh, mesh_from_model: np.ndarray) -> None:
    """Give the surface object another mesh (model frame) in place of its own."""
    old = surface.data
    fresh = new_mesh_object(SURFACE, mesh)
    surface.data = fresh.data
    bpy.data.objects.remove(fresh)
    for material in old.materials:
        surface.data.materials.append(material)
    if old.users == 0:
        bpy.data.meshes.remove(old)
    set_exact(surface, OFFSET, mesh_from_model)


def make_rigid(camera_object: bpy.types.Object | None, surface: bpy.types.Object) -> None:
    """Take scale, shear and mirroring out of the surface object; its origin stays where it is in the image."""
    world_from_model = np.array(surface.matrix_world, dtype=np.float64)
    rotation = nearest_rotation(world_from_model[:3, :3])
    opengl_cam_from_world = np.eye(4) if camera_object is None else inverse_rigid(_placed(camera_object))
    cam_from_model = CAM_FROM_OPENGL_CAM @ opengl_cam_from_world @ rigid(rotation, world_from_model[:3, 3])
    surface.delta_scale = (1.0, 1.0, 1.0)
    set_pose(camera_object, surface, cam_from_model)
    surface.scale = (1.0, 1.0, 1.0)


def fit_clip(camera_object: bpy.types.Object, mesh_radius_mm: float, cam_from_model: np.ndarray) -> None:
    """Clip planes that enclose the surface with room to move it."""
    depth = max(float(cam_from_model[2, 3]), 1.0)
    set_clip(camera_object, (max(0.01 * depth, 0.1), 10 * (depth + mesh_radius_mm)))


def _placed(camera_object: bpy.types.Object) -> np.ndarray:
    world_from_cam = np.array(camera_object.matrix_world, dtype=np.float64)
    _check_unscaled(world_from_cam, camera_object.name)
    return checked_rigid(world_from_cam, camera_object.name)[0]


def _check_unscaled(world_from_object: np.ndarray, name: str) -> None:
    axes = world_from_object[:3, :3]
    if not np.isfinite(world_from_object).all():
        raise InputError(f"{name}: expected a placed object, its transform holds NaN or infinity; undo the last step")
    lengths = np.linalg.norm(axes, axis=0)
    departure = float(np.abs(axes.T @ axes - np.eye(3)).max())
    if departure <= SCALE_TOLERANCE and np.linalg.det(axes) > 0:
        return
    scales = " x ".join(f"{length:.4g}" for length in lengths)
    kind = "mirrored" if np.linalg.det(axes) < 0 else "scaled"
    if kind == "scaled" and np.abs(lengths - 1).max() <= SCALE_TOLERANCE:
        kind = "sheared"
    raise InputError(
        f"{name}: expected an object that is only moved and turned, it is {kind} ({scales}); "
        "a pose cannot hold that: press Remove Scale, or undo"
    )


def _plain_material(name: str, rgba: tuple[float, float, float, float]) -> bpy.types.Material:
    existing = bpy.data.materials.get(name)
    if existing is not None:
        return existing
    material = new_node_material(name)
    material.diffuse_color = rgba
    nodes, links = material.node_tree.nodes, material.node_tree.links
    shader, output = nodes.new("ShaderNodeBsdfDiffuse"), nodes.new("ShaderNodeOutputMaterial")
    shader.inputs["Color"].default_value = rgba
    links.new(shader.outputs["BSDF"], output.inputs["Surface"])
    return material


def absolute_path(path: str) -> Path:
    """An absolute path from one that Blender may hold relative to the .blend file (``//...``)."""
    return Path(bpy.path.abspath(path)).resolve()
