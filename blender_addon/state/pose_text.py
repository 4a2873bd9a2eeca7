"""The pose as text in the convention of the case file: frame and units of the mesh file, at full precision."""

import bpy
import numpy as np

from ..pipeline.blender.alignment import surface_object
from ..pipeline.case.case_file import MM_PER_UNIT
from ..pipeline.transforms import checked_rigid, inverse_rigid
from . import from_scene


def cam_from_mesh_of(scene: bpy.types.Scene) -> np.ndarray:
    """``(4, 4)`` cam_from_mesh in the frame and units of the mesh file, as in a case file."""
    cam_from_mesh = from_scene.cam_from_mesh(scene).copy()
    cam_from_mesh[:3, 3] /= MM_PER_UNIT[scene.oneframe.units]
    return cam_from_mesh


def pose_rows(scene: bpy.types.Scene, *, inverse: bool = False) -> list[str]:
    """Four rows of four numbers each; reading them gives exactly the same pose."""
    pose = cam_from_mesh_of(scene)
    if inverse:
        pose = inverse_rigid(pose)
    return [" ".join(f"{value!r}" for value in row) for row in pose.tolist()]


def pose_from_text(text: str) -> tuple[np.ndarray, str | None]:
    """Parse ``(4, 4)`` from 16 numbers, or 12 without the last row; brackets and commas are allowed.

    Returns the pose, and a warning if it was not quite rigid; inverse of :func:`pose_rows`.

    Raises
    ------
    InputError
        Not a rigid transform.
    """
    words = text.translate(str.maketrans("[](),;", "      ")).split()
    try:
        values = [float(word) for word in words]
    except ValueError:
        values = []
    if len(values) == 12:
        values += [0.0, 0.0, 0.0, 1.0]
    matrix: object = np.reshape(values, (4, 4)) if len(values) == 16 else text[:40]
    return checked_rigid(matrix, "the clipboard's pose")


def set_cam_from_mesh(scene: bpy.types.Scene, cam_from_mesh: np.ndarray) -> None:
    """Move the surface to a pose ``(4, 4)`` in the frame and units of the mesh file."""
    camera_object, surface = from_scene.camera_object_of(scene), from_scene.surface_of(scene)
    cam_from_mesh = cam_from_mesh.copy()
    cam_from_mesh[:3, 3] *= MM_PER_UNIT[scene.oneframe.units]
    mesh_from_model = surface_object.mesh_from_model_of(surface)
    surface_object.set_pose(camera_object, surface, cam_from_mesh @ mesh_from_model)
