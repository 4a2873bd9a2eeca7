"""The scene in which a frame is aligned: the frame's camera at the world's origin and the surface in front of it.

The world is the camera's frame with Blender's axes (x right, y up, looking along -z); one unit is a millimetre. The
camera never moves; aligning moves the surface (:mod:`oneframe.blender.alignment.surface_object`). Structures are
children of the surface.
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
from ...images.masked_frame import with_mask_tinted
from ...images.pixel_values import to_uint8
from ...images.png import encode_png
from ...surface.mesh import TriangleMesh
from ...surface.structure_colour import OTHER
from ..bridge.camera import new_camera, set_clip, set_intrinsics
from ..bridge.data_blocks import exact, new_mesh_object, set_exact
from ..bridge.image import new_packed_image
from ..bridge.versions import new_node_material
from .surface_object import new_surface_object

COLLECTION, CAMERA = "OneFrame", "OneFrame camera"

INTRINSICS = "oneframe_intrinsics"
"""Custom property of the camera object."""

DISPLAY_SIZE_MM = 1.0
"""Width of the camera's symbol in the view."""

BONE_RGBA = (0.75, 0.72, 0.62, 1.0)


@dataclass(frozen=True)
class AlignmentObjects:
    """The objects of an alignment: camera, surface, and structures in the order of the case."""

    camera: bpy.types.Object
    surface: bpy.types.Object
    structures: tuple[bpy.types.Object, ...]


def set_up(scene: bpy.types.Scene, loaded: LoadedCase) -> AlignmentObjects:
    """Set up the alignment of a case in a scene; replaces an existing one."""
    clear(scene)
    set_alignment_units(scene)
    camera_object = put_camera(scene, None, loaded.frame.camera)
    changed = shown_frame(loaded.frame.image, loaded.frame.valid, undistorted=loaded.case.distortion is not None)
    show_frame(camera_object, frame_image(loaded.case.image, changed))
    surface = put_surface(scene, loaded.surface.mesh, loaded.surface.mesh_from_model, loaded.frame.cam_from_model)
    structures = [put_structure(surface, mesh, entry.name, entry.colour) for entry, mesh in loaded.surface.structures]
    hide_context(surface)
    fit_clip(camera_object, loaded.surface.mesh.radius, loaded.frame.cam_from_model)
    return AlignmentObjects(camera_object, surface, tuple(structures))


def clear(scene: bpy.types.Scene) -> None:
    """Remove the alignment from a scene; keep all other objects."""
    for collection in list(scene.collection.children):
        if collection.name.split(".")[0] == COLLECTION:
            remove_objects(collection.objects)
            bpy.data.collections.remove(collection)


def remove_objects(objects: Iterable[bpy.types.Object]) -> None:
    """Remove objects, and their meshes or cameras unless something else uses them."""
    data = [found.data for found in objects if found.data is not None]
    bpy.data.batch_remove(list(objects))
    bpy.data.batch_remove([block for block in data if block.users == 0])


def alignment_collection(scene: bpy.types.Scene) -> bpy.types.Collection:
    """The collection of the alignment's objects; created and linked to the scene if it does not exist."""
    for collection in scene.collection.children:
        if collection.name.split(".")[0] == COLLECTION:
            return collection
    collection = bpy.data.collections.new(COLLECTION)
    scene.collection.children.link(collection)
    return collection


def set_alignment_units(scene: bpy.types.Scene) -> None:
    """Set millimetres as the scene's unit, and a view transform that shows colours as recorded."""
    scene.unit_settings.system = "METRIC"
    scene.unit_settings.scale_length = 0.001
    scene.unit_settings.length_unit = "MILLIMETERS"
    scene.view_settings.view_transform = "Standard"
    scene.view_settings.look = "None"


def put_camera(
    scene: bpy.types.Scene, camera_object: bpy.types.Object | None, camera: PinholeCamera
) -> bpy.types.Object:
    """Put a camera with these intrinsics at the world's origin: ``camera_object``, or a new one if it is ``None``."""
    if camera_object is None:
        camera_object = new_camera(scene, camera, clip_mm=(1.0, 10_000.0), name=CAMERA)
        scene.collection.objects.unlink(camera_object)
        alignment_collection(scene).objects.link(camera_object)
    else:
        scene.camera = camera_object
        set_intrinsics(scene, camera_object, camera)
    camera_object.matrix_world = Matrix.Identity(4)
    # locked, so that navigating the view never moves the camera
    camera_object.lock_location = camera_object.lock_rotation = camera_object.lock_scale = (True,) * 3
    camera_object.hide_select = True
    camera_object.data.show_passepartout = True
    # as small as possible: orbiting begins where the camera is, and its symbol would cover the surface
    camera_object.data.display_size = DISPLAY_SIZE_MM
    set_exact(camera_object, INTRINSICS, [camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy])
    return camera_object


def camera_of(camera_object: bpy.types.Object) -> PinholeCamera:
    """The intrinsics that :func:`put_camera` set, exactly."""
    values = exact(camera_object, INTRINSICS)
    if values is None or values.shape != (6,):
        raise InputError(
            f"{camera_object.name}: expected a camera with intrinsics K, found none; load the camera again"
        )
    width, height, fx, fy, cx, cy = values.tolist()
    return PinholeCamera(int(width), int(height), fx, fy, cx, cy)


def shown_frame(image: np.ndarray, valid: np.ndarray, *, undistorted: bool) -> np.ndarray | None:
    """``(H, W, 3)`` values of the frame with its mask in blue, ``None`` if they are those of its file."""
    if valid.all():
        return image if undistorted else None
    return with_mask_tinted(image, valid)


def frame_image(path: Path, changed: np.ndarray | None) -> bpy.types.Image:
    """The frame as a Blender image: the file, or changed ``(H, W, 3)`` values packed into the .blend file."""
    if changed is None:
        return bpy.data.images.load(str(path.resolve()), check_existing=True)
    name = f"{path.name} (as shown)"
    existing = bpy.data.images.get(name)
    if existing is not None:
        bpy.data.images.remove(existing)
    height, width = changed.shape[:2]
    return new_packed_image(name, encode_png(to_uint8(changed)), width=width, height=height)


def show_frame(camera_object: bpy.types.Object, image: bpy.types.Image, *, outside: float = 0.6) -> None:
    """Make an image the camera's background: it fills the camera view pixel by pixel, behind everything.

    ``outside`` is the opacity, 0..1, of what darkens the view beside it.
    """
    data = camera_object.data
    data.passepartout_alpha = outside
    data.show_background_images = True
    background = data.background_images[0] if data.background_images else data.background_images.new()
    background.image = image
    background.alpha, background.display_depth, background.frame_method = 1.0, "BACK", "STRETCH"
    background.scale, background.rotation, background.offset = 1.0, 0.0, (0.0, 0.0)
    background.use_flip_x = background.use_flip_y = False


def fit_clip(camera_object: bpy.types.Object, mesh_radius_mm: float, cam_from_model: np.ndarray) -> None:
    """Set clip planes that enclose the surface with room to move it."""
    depth = max(float(cam_from_model[2, 3]), 1.0)
    set_clip(camera_object, (max(0.01 * depth, 0.1), 10 * (depth + mesh_radius_mm)))


def put_surface(
    scene: bpy.types.Scene, mesh: TriangleMesh, mesh_from_model: np.ndarray, cam_from_model: np.ndarray
) -> bpy.types.Object:
    """Add a new surface object to the scene.

    It goes into the alignment's collection, with its mesh in the model frame; both matrices, 4x4, mm, are stored with
    it.
    """
    surface = new_surface_object(mesh, mesh_from_model, cam_from_model)
    alignment_collection(scene).objects.link(surface)
    surface.data.materials.append(_plain_material("OneFrame bone", BONE_RGBA))
    surface.color = BONE_RGBA
    return surface


def put_structure(
    surface: bpy.types.Object, mesh: TriangleMesh, name: str, colour: tuple[float, float, float]
) -> bpy.types.Object:
    """Add a structure (model frame) that moves with the surface, in its colour (sRGB 0..1)."""
    structure = new_mesh_object(name, mesh)
    surface.users_collection[0].objects.link(structure)
    structure.parent = surface
    structure.color = (*colour, 1.0)
    structure.data.materials.append(_plain_material(f"OneFrame {name}", (*colour, 1.0)))
    # anatomy inside the bone must be visible through the surface: the add-on draws it, fainter where it is hidden
    structure.show_in_front = True
    for scene in structure.users_scene:
        for layer in scene.view_layers:
            layer.update()
            structure.hide_set(True, view_layer=layer)
    structure.hide_select = True
    return structure


def hide_context(surface: bpy.types.Object) -> None:
    """Hide white structures where others have a colour, as overlays do: the ear canal would cover the frame."""
    structures = [child for child in surface.children if child.type == "MESH"]
    coloured = [child for child in structures if not _is_white(child)]
    for child in structures:
        child.hide_viewport = bool(coloured) and _is_white(child)


def _is_white(structure: bpy.types.Object) -> bool:
    return tuple(structure.color[:3]) == OTHER


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
