"""The files that a scene was made of: no operator ever replaces one of them."""

from pathlib import Path

import bpy

from . import from_scene
from .session_files import is_temporary


def usual_folder(scene: bpy.types.Scene) -> Path:
    """The folder of the case, the frame, the surface or the CT: of the first that is no file of this session."""
    for text in (*map(str, input_files(scene).values()), scene.oneframe_ct.path):
        if text and not is_temporary(path := from_scene.absolute_path(text)):
            return path.parent
    return Path()


def input_files(scene: bpy.types.Scene) -> dict[str, Path]:
    """Case file, frame, surface and structures, by what they are; those that the scene has."""
    settings = scene.oneframe
    texts = {"case": settings.case_path, "frame": settings.frame_path}
    surface = from_scene.present_surface(scene)
    if surface is not None:
        texts["surface"] = surface.oneframe.mesh_path
        structures = [child for child in surface.children if child.oneframe.role == "STRUCTURE"]
        texts |= {f"structure {child.name}": child.oneframe.mesh_path for child in structures}
    return {name: from_scene.absolute_path(text) for name, text in texts.items() if text}
