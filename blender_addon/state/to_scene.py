"""Writes to the scene: sets frame, camera and surface in any order and keeps them consistent."""

import json
from collections.abc import Mapping
from dataclasses import astuple
from pathlib import Path

import bpy
import numpy as np

from ..pipeline.blender.alignment import alignment_scene, surface_object
from ..pipeline.blender.bridge.data_blocks import absolute_path
from ..pipeline.camera.distortion import Distortion, checked_distortion
from ..pipeline.camera.pinhole import PinholeCamera
from ..pipeline.case.case_file import MM_PER_UNIT
from ..pipeline.case.case_writer import UNIT_OF
from ..pipeline.case.loaded_case import LoadedCase
from ..pipeline.errors import InputError
from ..pipeline.files.content import reading
from ..pipeline.images.image_check import may_have_alpha
from ..pipeline.surface.mesh import Ball, TriangleMesh
from ..pipeline.surface.mesh_reader import read_mesh
from ..pipeline.transforms import inverse_rigid, rigid
from . import from_scene, workbench
from .camera_view import look_through_camera, show_shape
from .case_of_file import part_from_case, remember_file
from .frame_in_view import leave_frame
from .initial_pose import is_initial, set_focus, set_initial_pose
from .landmarks import replace_landmarks

Colour = tuple[float, float, float]
"""sRGB, 0..1."""

HEAD_BYTES = 1 << 16
"""Of an image, to tell whether it may have alpha."""


def remember_case(scene: bpy.types.Scene, loaded: LoadedCase, objects: alignment_scene.AlignmentObjects) -> None:
    """Fill in the scene's settings from a case whose objects are in the scene."""
    case, settings = loaded.case, scene.oneframe
    if settings.case_path != str(case.path.resolve()):
        part_from_case(scene)
    settings.units = UNIT_OF[case.mm_per_unit]
    remember_file(scene, case)
    settings.frame_path = str(case.image.resolve())
    settings.frame_size = case.camera.size_wh
    settings.property_unset("began_at_guess")
    settings.video_text = json.dumps(case.video) if case.video else ""
    settings.refused = case.refused
    settings.camera_object, settings.surface = objects.camera, objects.surface
    _remember_camera(scene, case.camera, case.distortion)
    objects.surface.oneframe.role, objects.surface.oneframe.mesh_path = "SURFACE", str(case.mesh.resolve())
    for structure, child in zip(case.structures, objects.structures, strict=True):
        child.oneframe.role, child.oneframe.mesh_path = "STRUCTURE", str(structure.mesh.resolve())
    for entry in settings.dataset.bl_rna.properties:
        if entry.identifier not in ("rna_type", "name"):
            settings.dataset.property_unset(entry.identifier)
    for name, value in case.dataset.items():
        if hasattr(settings.dataset, name):
            setattr(settings.dataset, name, value)
    replace_landmarks(scene, case.landmarks)


def frame_size(scene: bpy.types.Scene) -> tuple[int, int] | None:
    """``(width, height)`` of the loaded frame; ``None`` if there is none."""
    width, height = scene.oneframe.frame_size
    return (width, height) if width and height else None


def set_frame(
    context: bpy.types.Context, path: Path, picture: tuple[np.ndarray, np.ndarray], video: tuple[str, int] | None = None
) -> tuple[str, ...]:
    """Use an image file as the frame; gives warnings if K does not fit it.

    Parameters
    ----------
    context, path
        Its workbench gets the frame; the image file.
    picture
        What :func:`.read_image` has read from it.
    video
        Name of the film that the frame was taken from, and the frame's number in it.
    """
    scene = workbench.enter(context)
    settings = scene.oneframe
    height, width = picture[1].shape
    if not leave_frame(scene, *picture) or video:
        settings.video_text = json.dumps(video) if video else ""
    if settings.frame_path != str(path.resolve()):
        part_from_case(scene)
        settings.refused = ""
    settings.frame_path, settings.frame_size = str(path.resolve()), (width, height)
    typed = settings.camera
    if settings.camera_object is None:
        # drawn in the view until there is K
        alignment_scene.frame_image(path, None).reload()
        typed.width, typed.height = width, height
        typed.cx, typed.cy = number_text((width - 1) / 2), number_text((height - 1) / 2)
    else:
        show_frame(scene)
    look_through_camera(context)
    return frame_warnings(scene)


def frame_warnings(scene: bpy.types.Scene) -> tuple[str, ...]:
    """Warnings about a camera that does not fit the frame."""
    size = frame_size(scene)
    if size is None or from_scene.present_camera(scene) is None:
        return ()
    camera = from_scene.camera(scene)
    if camera.size_wh != size:
        return (
            f"K is for {camera.width} x {camera.height} px, the frame has {size[0]} x {size[1]} px: "
            "load the K of this frame, or correct the fields and press Set Camera",
        )
    return ()


def typed_camera(scene: bpy.types.Scene) -> tuple[PinholeCamera, Distortion | None]:
    """Intrinsics, for the size of the loaded frame, and distortion from the panel's fields."""
    typed = scene.oneframe.camera
    fx, fy, cx, cy = (_number(getattr(typed, name), name) for name in ("fx", "fy", "cx", "cy"))
    k = [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]
    size = frame_size(scene) or (typed.width, typed.height)
    camera = PinholeCamera.from_matrix(k, size=size, pixel_origin=typed.pixel_origin, where="K")
    if not typed.distortion.strip():
        return camera, None
    try:
        values = [float(word) for word in typed.distortion.replace(",", " ").split()]
    except ValueError:
        raise InputError(f"distortion: expected numbers k1, k2, p1, p2, k3, found {typed.distortion!r}") from None
    return camera, checked_distortion(values, camera, "distortion")


def number_text(value: float) -> str:
    """The shortest text of a number, without a decimal point for whole ones: what a user would type."""
    return repr(float(value)).removesuffix(".0")


def _number(text: str, name: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise InputError(f"{name}: expected a number of pixels such as 1081.37, found {text!r}") from None


def set_camera(context: bpy.types.Context, camera: PinholeCamera, distortion: Distortion | None) -> None:
    """Set the frame's intrinsics and distortion; the pose stays."""
    if context.scene.oneframe.frame_path:
        from_scene.stamp(absolute_path(context.scene.oneframe.frame_path))
    scene = workbench.enter(context)
    settings = scene.oneframe
    existing, surface = from_scene.present_camera(scene), from_scene.present_surface(scene)
    pose = None if surface is None else surface_object.pose_of(existing, surface)
    alignment_scene.set_alignment_units(scene)
    camera_object = settings.camera_object = alignment_scene.put_camera(scene, existing, camera)
    _remember_camera(scene, camera, distortion)
    if surface is not None and pose is not None:
        if is_initial(scene, pose):
            set_initial_pose(scene)
        else:
            surface_object.set_pose(camera_object, surface, pose)
            alignment_scene.fit_clip(camera_object, surface_object.radius_of(surface), pose)
    if settings.frame_path:
        show_frame(scene)
    look_through_camera(context)


def set_surface(
    context: bpy.types.Context, path: Path, given: TriangleMesh, units: str, focus: Ball | None = None
) -> None:
    """Use a mesh (frame of its file, mm) as the surface; removes the old one, its structures and landmarks.

    The initial pose looks at ``focus``, in the frame of the file, mm, if there is one.
    """
    scene = workbench.enter(context)
    settings = scene.oneframe
    old = settings.surface
    if old is None or old.oneframe.mesh_path != str(path.resolve()):
        part_from_case(scene, surface=True)
    if old is not None:
        alignment_scene.remove_objects([*old.children, old])
    centre = given.vertices.mean(axis=0)
    alignment_scene.set_alignment_units(scene)
    surface = alignment_scene.put_surface(scene, given.moved(-centre), rigid(translation=centre), np.eye(4))
    surface.oneframe.role, surface.oneframe.mesh_path = "SURFACE", str(path.resolve())
    settings.surface, settings.units = surface, units
    set_focus(scene, focus)
    set_initial_pose(scene)
    replace_landmarks(scene, ())
    show_shape(context)
    look_through_camera(context)


def put_structures(surface: bpy.types.Object, files: Mapping[str, tuple[Path, Colour]]) -> list[str]:
    """Add structures in mm to the surface, by their names; those of the same names are replaced.

    It gives messages about the files.
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


def rescale(context: bpy.types.Context, units: str) -> None:
    """Read the files' numbers in another unit: all scales about the camera's centre, so the picture stays the same."""
    scene, settings = context.scene, context.scene.oneframe
    camera_object, surface = from_scene.present_camera(scene), from_scene.surface_of(scene)
    surface_object.scale(camera_object, surface, MM_PER_UNIT[units] / MM_PER_UNIT[settings.units])
    settings.units = units
    if camera_object is not None:
        alignment_scene.fit_clip(camera_object, surface_object.radius_of(surface), from_scene.cam_from_model(scene))


def exchange_surface(context: bpy.types.Context, path: Path, given: TriangleMesh) -> None:
    """Replace the surface by another version of it (frame of its file, mm); pose, landmarks and structures stay."""
    camera_object, surface = from_scene.present_camera(context.scene), from_scene.surface_of(context.scene)
    model_from_mesh = inverse_rigid(surface_object.mesh_from_model_of(surface))
    cam_from_mesh = surface_object.pose_of(camera_object, surface) @ model_from_mesh
    mesh_from_model = rigid(translation=given.vertices.mean(axis=0))
    surface_object.replace_mesh(surface, given.moved(-mesh_from_model[:3, 3]), mesh_from_model)
    surface_object.set_pose(camera_object, surface, cam_from_mesh @ mesh_from_model)
    surface.oneframe.mesh_path = str(path.resolve())


def _remember_camera(scene: bpy.types.Scene, camera: PinholeCamera, distortion: Distortion | None) -> None:
    typed = scene.oneframe.camera
    typed.width, typed.height = camera.size_wh
    for name in ("fx", "fy", "cx", "cy"):
        setattr(typed, name, number_text(getattr(camera, name)))
    typed.pixel_origin = "center"
    values = () if distortion is None else astuple(distortion)
    typed.distortion = ", ".join(map(number_text, values))
    scene.oneframe.distortion_text = json.dumps(values) if values else ""


def relink_frame(scene: bpy.types.Scene, path: Path) -> None:
    """Use another file of the present frame: its copy beside the case, or the frame with a mask."""
    scene.oneframe.frame_path = str(path.resolve())
    if from_scene.present_camera(scene) is not None:
        show_frame(scene)


def show_frame(scene: bpy.types.Scene) -> None:
    """Show the frame behind the camera: if K fits, without distortion and with its mask in blue."""
    settings = scene.oneframe
    path = absolute_path(settings.frame_path)
    changed = None
    if not frame_warnings(scene) and (settings.distortion_text or _may_have_alpha(path)):
        image, valid = from_scene.frame_at(scene, path)
        changed = alignment_scene.shown_frame(image, valid, undistorted=bool(settings.distortion_text))
    shown = alignment_scene.frame_image(path, changed)
    if changed is None:
        # another one may have had this name
        shown.reload()
    alignment_scene.show_frame(from_scene.camera_object_of(scene), shown)


def _may_have_alpha(path: Path) -> bool:
    with reading(path, "an image file"), path.open("rb") as file:
        return may_have_alpha(file.read(HEAD_BYTES))
