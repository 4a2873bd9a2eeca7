"""Puts structures into the scene, from their files."""

from collections.abc import Mapping
from pathlib import Path

import bpy

from ..pipeline.blender.alignment import alignment_scene, surface_object
from ..pipeline.blender.bridge.data_blocks import absolute_path
from ..pipeline.surface.mesh_reader import read_mesh

Colour = tuple[float, float, float]
"""sRGB, 0..1."""


def put_structures(surface: bpy.types.Object, files: Mapping[str, tuple[Path, Colour]]) -> list[str]:
    """Add structures in mm to the surface, by their names; those of the same names are replaced.

    Returns
    -------
    Messages about the files.

    Raises
    ------
    InputError
        A file holds no usable mesh; nothing is changed then.
    """
    like = absolute_path(surface.oneframe.mesh_path)
    read = {name: read_mesh(path, like=like) for name, (path, _) in files.items()}
    offset = surface_object.mesh_from_model_of(surface)[:3, 3]
    old = [child for child in surface.children if child.name in files and child.oneframe.role == "STRUCTURE"]
    alignment_scene.remove_objects(old)
    for name, (path, colour) in files.items():
        mesh = read[name][0].moved(-offset)
        structure = alignment_scene.put_structure(surface, mesh, name, colour)
        structure.oneframe.role, structure.oneframe.mesh_path = "STRUCTURE", str(path.resolve())
    alignment_scene.hide_context(surface)
    return [message for _, messages in read.values() for message in messages]
