"""A case file -> everything in memory, checked, in the model frame."""

from pathlib import Path

import numpy as np

from ...camera.distortion import Distortion, undistort
from ...camera.pinhole import PinholeCamera
from ...case.case_file import Case
from ...case.loaded_case import LoadedCase, check_pose, load_surface
from ...errors import InputError
from ...surface.mesh_reader import read_mesh
from ..bridge.image import read_image


def load_case(case: Case, *, aligned: bool = True) -> LoadedCase:
    """Open the files of a case and check that they fit together.

    Parameters
    ----------
    case
        The case.
    aligned
        False for a rough pose, before it is aligned: it may be anything.

    Raises
    ------
    InputError
        A file that cannot be used, an image of another size than the camera's, and, for an aligned case, a surface that
        lies behind the camera, outside the frame or at a distance that no microscope has.
    """
    image, valid = load_frame(case.image, case.camera, case.distortion, name=case.path.name)
    mesh, mesh_from_model, messages = load_surface(case.mesh, case.mm_per_unit)
    cam_from_model = case.cam_from_mesh @ mesh_from_model
    if aligned:
        check_pose(case, mesh, cam_from_model)
    structures = []
    for structure in case.structures:
        structure_mesh, structure_messages = read_mesh(structure.mesh)
        centre = mesh_from_model[:3, 3]
        structures.append((structure, structure_mesh.scaled(case.mm_per_unit).moved(-centre)))
        messages += structure_messages
    return LoadedCase(
        case, image, valid, mesh, mesh_from_model, cam_from_model, tuple(structures), (*case.messages, *messages)
    )


def load_frame(
    path: Path, camera: PinholeCamera, distortion: Distortion | None, *, name: str
) -> tuple[np.ndarray, np.ndarray]:
    """The undistorted frame of a case called ``name``, as an array and where it is valid.

    ``(H, W, 3)`` float32 code values 0..1, and ``(H, W)`` bool, False where it shows nothing.

    Raises
    ------
    InputError
        No image, or one of another size than the camera's.
    """
    image, valid = read_image(path, f"{name}: [frame] image {path.name}")
    height, width = image.shape[:2]
    if (width, height) != camera.size_wh:
        raise InputError(
            f"{name}: expected a frame of {camera.width}x{camera.height} px as [camera] size says, "
            f"{path.name} has {width}x{height}; K belongs to one size: give the K of this image"
        )
    if distortion is not None:
        image, inside = undistort(image, camera, distortion)
        valid &= inside
    return image, valid
