"""A case in memory -> the objects of its alignment in a scene; frames as Blender images for the camera's background."""

from dataclasses import dataclass
from pathlib import Path

import bpy
import numpy as np

from ..image_file import eight_bit, encode_png
from .alignment_scene import (
    COLLECTION,
    fit_clip,
    put_camera,
    put_structure,
    put_surface,
    set_alignment_units,
    show_frame,
)
from .loading import LoadedCase


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
    surface = put_surface(scene, loaded.mesh, loaded.given_from_model, loaded.cam_from_model)
    structures = [put_structure(surface, mesh, entry.name, entry.color) for entry, mesh in loaded.structures]
    fit_clip(camera_object, loaded.mesh.radius, loaded.cam_from_model)
    return AlignmentObjects(camera_object, surface, tuple(structures))


def clear(scene: bpy.types.Scene) -> None:
    """Remove all that an alignment brought to a scene; what else lies in the scene stays."""
    for collection in list(scene.collection.children):
        if collection.name.split(".")[0] == COLLECTION:
            remove_objects(collection.objects)
            bpy.data.collections.remove(collection)


def remove_objects(objects: list[bpy.types.Object]) -> None:
    """Remove objects and their meshes or cameras, where nothing else uses these."""
    data = [found.data for found in objects if found.data is not None]
    bpy.data.batch_remove(list(objects))
    bpy.data.batch_remove([block for block in data if block.users == 0])


def frame_image(path: Path, undistorted: np.ndarray | None) -> bpy.types.Image:
    """The frame for display: the file itself, or the undistorted ``(H, W, 3)`` values packed into the .blend file."""
    if undistorted is None:
        return bpy.data.images.load(str(path.resolve()), check_existing=True)
    data = encode_png(eight_bit(undistorted))
    name = f"{path.name} (undistorted)"
    existing = bpy.data.images.get(name)
    if existing is not None:
        bpy.data.images.remove(existing)
    height, width = undistorted.shape[:2]
    image = bpy.data.images.new(name, width, height)
    image.source = "FILE"
    image.pack(data=data, data_len=len(data))
    return image
