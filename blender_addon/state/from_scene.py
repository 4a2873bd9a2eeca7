"""Reads the scene: checks what operators need and returns it in the pipeline's types.

Files are cached until they, or the settings with which they are read, change. Nothing here changes the scene.
"""

import json
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path

import bpy
import numpy as np

from ..pipeline.blender.alignment.alignment_scene import camera_of
from ..pipeline.blender.alignment.surface_object import mesh_from_model_of, pose_of
from ..pipeline.blender.bridge.data_blocks import absolute_path
from ..pipeline.camera.distortion import Distortion
from ..pipeline.camera.pinhole import PinholeCamera
from ..pipeline.case.case_file import MM_PER_UNIT, Case, Structure
from ..pipeline.case.frame import PosedFrame, load_frame
from ..pipeline.case.loaded_case import LoadedCase, LoadedSurface, check_poses, load_surface
from ..pipeline.errors import InputError
from ..pipeline.surface.mesh import TriangleMesh
from ..pipeline.surface.mesh_reader import read_mesh
from ..pipeline.transforms import inverse_rigid, is_same_pose
from .case_of_file import case_of_file, further_frames, lamp_of
from .landmarks import landmarks_mesh

EDIT_TOLERANCE = 1e-5
"""Vertices count as unedited up to this difference from the file, relative to the mesh's size: single precision."""


def present_camera(scene: bpy.types.Scene) -> bpy.types.Object | None:
    """The frame's camera object; ``None`` if there is none or it was deleted."""
    return _present(scene, scene.oneframe.camera_object, "CAMERA")


def present_surface(scene: bpy.types.Scene) -> bpy.types.Object | None:
    """The surface object; ``None`` if there is none or it was deleted."""
    return _present(scene, scene.oneframe.surface, "MESH")


def _present(scene: bpy.types.Scene, found: bpy.types.Object | None, kind: str) -> bpy.types.Object | None:
    return found if found is not None and found.name in scene.objects and found.type == kind else None


def camera_object_of(scene: bpy.types.Scene) -> bpy.types.Object:
    """The frame's camera object."""
    found = present_camera(scene)
    if found is None:
        raise InputError("expected a camera, none is set up; load K from a file, or type it and press Set Camera")
    return found


def surface_of(scene: bpy.types.Scene) -> bpy.types.Object:
    """The surface object."""
    found = present_surface(scene)
    if found is None:
        raise InputError("expected a surface, none is in the scene; load a mesh, or undo if it was deleted")
    return found


def is_set_up(scene: bpy.types.Scene) -> bool:
    """Whether the scene has a camera and a surface, which most tools need."""
    return present_camera(scene) is not None and present_surface(scene) is not None


def camera(scene: bpy.types.Scene) -> PinholeCamera:
    """The frame's intrinsics."""
    return camera_of(camera_object_of(scene))


def cam_from_model(scene: bpy.types.Scene) -> np.ndarray:
    """``(4, 4)`` the current pose, mm."""
    return pose_of(camera_object_of(scene), surface_of(scene))


def cam_from_mesh(scene: bpy.types.Scene) -> np.ndarray:
    """``(4, 4)`` the current pose in the frame of the mesh file, mm; its case's to the last bit, until it moves.

    A run goes on, and what registration found is found again, in another session too.
    """
    pose, known = cam_from_model(scene) @ inverse_rigid(mesh_from_model_of(surface_of(scene))), case_of_file(scene)
    is_known = known is not None and known.posed and is_same_pose(known.cam_from_mesh, pose)
    return known.cam_from_mesh.copy() if known is not None and is_known else pose


def pose_in_file(scene: bpy.types.Scene) -> np.ndarray:
    """The same in the units of the mesh file, as in a case file."""
    pose = cam_from_mesh(scene)
    pose[:3, 3] /= MM_PER_UNIT[scene.oneframe.units]
    return pose


def distortion(scene: bpy.types.Scene) -> Distortion | None:
    """The frame's lens distortion; ``None`` if it has none."""
    text = scene.oneframe.distortion_text
    return Distortion(*json.loads(text)) if text else None


def shortest(value: float) -> float:
    """The number with the fewest digits that Blender stores as this one: 0.9 for 0.8999999762."""
    return float(str(np.float32(value)))


def case(scene: bpy.types.Scene, path: Path) -> Case:
    """The scene as a case; its path is that of the opened file, or ``path`` if none was opened."""
    settings = scene.oneframe
    surface = surface_of(scene)
    if not settings.frame_path:
        raise InputError("expected a frame, none is loaded; load the image first")
    size, k_size = tuple(settings.frame_size), camera(scene).size_wh
    if all(size) and size != k_size:
        raise InputError(
            f"expected a frame of {k_size[0]}x{k_size[1]} px, the size that K is for, found {size[0]}x{size[1]} px; "
            "load the K of this frame, or press Rescale K to Frame if both show the same picture"
        )
    if not surface.oneframe.mesh_path:
        raise InputError(f"{surface.name}: expected a surface that was loaded from a file; load it with Load Surface")
    landmarks = landmarks_mesh(scene)
    structures = tuple(
        Structure(child.name, absolute_path(child.oneframe.mesh_path), _of_codes(child.color))
        for child in sorted(surface.children, key=lambda child: child.name)
        if child.oneframe.role == "STRUCTURE"
    )
    known = case_of_file(scene)
    return Case(
        path=absolute_path(settings.case_path) if settings.case_path else path,
        mm_per_unit=MM_PER_UNIT[settings.units],
        image=absolute_path(settings.frame_path),
        camera=camera(scene),
        distortion=distortion(scene),
        frames=further_frames(scene),
        mesh=absolute_path(surface.oneframe.mesh_path),
        cam_from_mesh=cam_from_mesh(scene),
        structures=structures,
        dataset=dataset_table(scene),
        landmarks=landmarks,
        video=video(scene),
        refused=settings.refused,
        object_name=None if known is None else known.object_name,
        light=lamp_of(scene),
    )


def video(scene: bpy.types.Scene) -> tuple[str, int] | None:
    """Name of the video that the frame is from, and its number in it; ``None`` if it is from none."""
    text = scene.oneframe.video_text
    return tuple(json.loads(text)) if text else None


def dataset_table(scene: bpy.types.Scene) -> dict[str, object]:
    """The case's [dataset] table: what the opened file states, and options that differ from the defaults."""
    options, known = scene.oneframe.dataset, case_of_file(scene)
    read = {} if known is None else known.dataset
    table = {key: value for key, value in read.items() if not hasattr(options, key)}
    for key, declared in options.bl_rna.properties.items():
        if key in ("rna_type", "name"):
            continue
        value = getattr(options, key)
        if key in read or value != declared.default:
            table[key] = shortest(value) if declared.type == "FLOAT" else value
    return table


def _of_codes(rgba: Sequence[float]) -> tuple[float, float, float]:
    """A colour in single precision as the 8-bit codes that files hold, 0..1."""
    red, green, blue = (round(255 * min(max(value, 0.0), 1.0)) / 255 for value in rgba[:3])
    return red, green, blue


def loaded_case(scene: bpy.types.Scene, *, aligned: bool = True) -> LoadedCase:
    """The scene as a loaded case, equal to the saved case loaded from disk.

    Parameters
    ----------
    scene
        The scene.
    aligned
        Whether to check that the pose shows the surface to the camera; a rough pose need not.
    """
    settings = scene.oneframe
    wanted = case(scene, Path(bpy.path.abspath(settings.case_path) or "the scene"))
    image, valid = frame_at(scene, wanted.image)
    mesh, mesh_from_model, messages = _surface(wanted.mesh, stamp(wanted.mesh), wanted.mm_per_unit)
    _check_unedited(surface_of(scene), mesh)
    pose = cam_from_model(scene)
    frames = [PosedFrame(image, valid, wanted.camera, pose, path=wanted.image)]
    for given in wanted.frames:
        shown = _frame(given.image, stamp(given.image), given.camera, given.distortion)
        frames.append(PosedFrame(*shown, given.camera, given.cam_from_mesh @ mesh_from_model, path=given.image))
    if aligned:
        check_poses(wanted, mesh, frames)
    structures = tuple(
        (structure, _mesh(structure.mesh, stamp(structure.mesh), wanted.mesh).scaled(wanted.mm_per_unit).moved(-offset))
        for offset in (mesh_from_model[:3, 3],)
        for structure in wanted.structures
    )
    surface = LoadedSurface(mesh, mesh_from_model, structures)
    return LoadedCase(wanted, surface, tuple(frames), tuple(messages))


def frame_at(scene: bpy.types.Scene, path: Path) -> tuple[np.ndarray, np.ndarray]:
    """An image file undistorted with the scene's camera, and its valid pixels, as :func:`load_frame` returns them."""
    return _frame(path, stamp(path), camera(scene), distortion(scene))


def surface_extents(scene: bpy.types.Scene) -> np.ndarray:
    """``(3,)`` sides of the surface object's bounding box in its own axes, mm; reads no vertices, so panels may."""
    corners = np.array(surface_of(scene).bound_box)
    return corners.max(axis=0) - corners.min(axis=0)


def surface_bounds(scene: bpy.types.Scene) -> np.ndarray:
    """``(2, 3)`` smallest and largest coordinates of the surface object, mm, in the frame of its file."""
    surface = surface_of(scene)
    corners = np.array(surface.bound_box) + mesh_from_model_of(surface)[:3, 3]
    return np.stack([corners.min(axis=0), corners.max(axis=0)])


def surface_in_file(scene: bpy.types.Scene) -> TriangleMesh:
    """The surface in the model frame, mm, as its file holds it."""
    path = absolute_path(surface_of(scene).oneframe.mesh_path)
    return _surface(path, stamp(path), MM_PER_UNIT[scene.oneframe.units])[0]


def check_mesh_unedited(scene: bpy.types.Scene) -> None:
    """Raise :class:`InputError` if the surface's mesh differs from its file."""
    _check_unedited(surface_of(scene), surface_in_file(scene))


def stamp(path: Path) -> tuple[int, int]:
    """``(modification time in ns, size)`` of a file, which change when its content does."""
    try:
        status = path.stat()
    except OSError as error:
        raise InputError(
            f"{path}: cannot read the file ({error.strerror}); correct the path or load it again"
        ) from None
    return status.st_mtime_ns, status.st_size


@lru_cache(maxsize=4)
def _frame(
    path: Path, _stamp: tuple[int, int], camera: PinholeCamera, distortion: Distortion | None
) -> tuple[np.ndarray, np.ndarray]:
    return load_frame(path, camera, distortion, name=path.name)


@lru_cache(maxsize=2)
def _surface(path: Path, _stamp: tuple[int, int], mm_per_unit: float) -> tuple[TriangleMesh, np.ndarray, list[str]]:
    return load_surface(path, mm_per_unit)


@lru_cache(maxsize=16)
def _mesh(path: Path, _stamp: tuple[int, int], like: Path) -> TriangleMesh:
    return read_mesh(path, like=like)[0]


def _check_unedited(surface: bpy.types.Object, mesh: TriangleMesh) -> None:
    advice = "undo the edit, so that every tool uses the same mesh"
    if surface.mode == "EDIT":
        surface.update_from_editmode()
    data = surface.data
    if len(data.vertices) != len(mesh.vertices) or len(data.polygons) != len(mesh.faces):
        raise InputError(
            f"{surface.name}: expected the {len(mesh.vertices)} vertices and {len(mesh.faces)} faces of its file, "
            f"found {len(data.vertices)} and {len(data.polygons)}: it was edited in Blender; {advice}"
        )
    vertices = np.empty(mesh.vertices.size, np.float32)
    data.vertices.foreach_get("co", vertices)
    moved = float(np.abs(vertices.reshape(-1, 3) - mesh.vertices).max())
    if moved > EDIT_TOLERANCE * mesh.radius:
        raise InputError(
            f"{surface.name}: expected the vertices of its file, found some displaced by up to {moved:.3g} mm: "
            f"it was edited in Blender; {advice}"
        )
