"""Load everything that a case file names into memory, checked, in the model frame."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ..camera.distortion import Distortion, checked_distortion, undistort
from ..camera.pinhole import PinholeCamera
from ..errors import InputError
from ..files.content import read_content
from ..files.tables import parsed_json
from ..images.image_reader import read_image
from ..poses.pose_file import POSE_KEY, is_without_pose, read_poses
from ..projection.initial_pose import initial_pose
from ..surface.mesh_reader import read_mesh
from ..transforms import inverse_rigid
from .alignment_record import INITIAL_GUESS
from .case_file import Case
from .case_writer import UNIT_OF
from .loaded_case import LoadedCase, LoadedSurface, check_poses, load_surface
from .posed_frame import PosedFrame, UnreadFrame
from .precision import precision_doubts
from .surface_size import extents_of, size_doubt

DISTORTION = "distortion"
"""Key of an entry in a list of photographs."""


def load_case(case: Case, *, aligned: bool = True) -> LoadedCase:
    """Open the files of a case and check that they fit together.

    Parameters
    ----------
    case
        The case.
    aligned
        False accepts any pose, and puts an initial guess in the place of none: use it before the alignment.

    Raises
    ------
    InputError
        A file cannot be used; the image's size differs from the camera's; or, for an aligned case, the surface is
        behind the camera, outside the frame or at an implausible distance.
    """
    mesh, mesh_from_model, messages = load_surface(case.mesh, case.mm_per_unit)
    if not case.posed and not aligned:
        guess = initial_pose(mesh, case.camera) @ inverse_rigid(mesh_from_model)
        case = replace(case, cam_from_mesh=guess, posed=True, alignment={"method": INITIAL_GUESS})
        messages = [*messages, "the case has no pose: an initial guess is shown, not aligned"]
    frames = tuple(load_posed_frame(frame, mesh_from_model, name=case.path.name) for frame in case.every_frame)
    cam_from_model = case.cam_from_mesh @ mesh_from_model
    doubt = size_doubt(extents_of(mesh), UNIT_OF[case.mm_per_unit], case.camera, case.mesh.name)
    messages = messages if doubt is None else [*messages, doubt.message]
    if aligned:
        check_poses(case, mesh, frames)
        messages = [*messages, *precision_doubts(case.mesh.name, case.camera, mesh, mesh_from_model, cam_from_model)]
    structures = []
    for structure in case.structures:
        structure_mesh, structure_messages = read_mesh(structure.mesh, like=case.mesh)
        centre = mesh_from_model[:3, 3]
        structures.append((structure, structure_mesh.scaled(case.mm_per_unit).moved(-centre)))
        messages += structure_messages
    surface = LoadedSurface(mesh, mesh_from_model, tuple(structures))
    return LoadedCase(case, surface, frames, (*case.messages, *messages))


def read_photographs(path: Path, case: Case) -> tuple[list[UnreadFrame], list[str]]:
    """Read a JSON list of ``{"image": file, "cam_from_mesh": 4x4}``, poses as in the case file, or ``null``: left out.

    Photographs as the lens took them have its ``"distortion"`` in their entry, as in the case file.

    Returns
    -------
    The photographs, of the case's camera; and messages about what was corrected.

    Raises
    ------
    InputError
        As :func:`.read_poses`, an entry names no image, or its distortion is none.
    """
    poses, messages = read_poses(path, mesh_from_model=np.eye(4), mm_per_unit=case.mm_per_unit)
    entries: Any = parsed_json(read_content(path, "a list of photographs"), path.name)
    entries = [entry for entry in entries if not is_without_pose(entry)]
    images: list[Any] = [entry.get("image") if isinstance(entry, dict) else None for entry in entries]
    for number, image in enumerate(images):
        if not isinstance(image, str) or not image:
            raise InputError(
                f'{path.name}: entry {number}: expected {{"image": file, "{POSE_KEY}": ...}}, found image {image!r}'
            )
    lenses = [
        checked_distortion(entry[DISTORTION], case.camera, f"{path.name}: entry {number}: {DISTORTION}")
        if DISTORTION in entry
        else None
        for number, entry in enumerate(entries)
    ]
    return [
        UnreadFrame(path.parent / image, case.camera, lens, pose)
        for image, lens, pose in zip(images, lenses, poses, strict=True)
    ], messages


def load_posed_frame(frame: UnreadFrame, mesh_from_model: np.ndarray, *, name: str) -> PosedFrame:
    """Read and undistort a posed frame; ``name`` begins messages.

    Raises
    ------
    InputError
        As :func:`load_frame`.
    """
    image, valid = load_frame(frame.image, frame.camera, frame.distortion, name=name)
    return PosedFrame(image, valid, frame.camera, frame.cam_from_mesh @ mesh_from_model, path=frame.image)


def load_frame(
    path: Path, camera: PinholeCamera, distortion: Distortion | None, *, name: str
) -> tuple[np.ndarray, np.ndarray]:
    """Read and undistort the frame of a case; ``name`` is the case's name in messages.

    Returns
    -------
    ``(H, W, 3)`` float32 code values 0..1, and ``(H, W)`` bool, False where it has no image.

    Raises
    ------
    InputError
        The image cannot be read, or its size differs from the camera's.
    """
    image, valid = read_image(path, f"{name}: [frame] image {path.name}")
    height, width = image.shape[:2]
    if (width, height) != camera.size_wh:
        raise InputError(
            f"{name}: expected a frame of {camera.width}x{camera.height} px as in [camera] size, "
            f"{path.name} has {width}x{height}; K belongs to one size: give the K of this image"
        )
    if distortion is not None:
        image, inside = undistort(image, camera, distortion)
        valid &= inside
    return image, valid
