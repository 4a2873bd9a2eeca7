"""A case file -> everything in memory, checked, in the model frame."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..camera import PinholeCamera
from ..case import Case, Structure
from ..distortion import Distortion, undistort
from ..errors import InputError
from ..frames import rigid, transform_points
from ..mesh import TriangleMesh
from ..mesh_file import read_mesh
from .image import read_image

NEAREST_MM, FARTHEST_MM = 2.0, 30_000.0
"""Working distances outside of this are taken for a mistake of the units; a factor of 1000 always falls outside."""


@dataclass(frozen=True)
class LoadedCase:
    """A case in memory.

    Attributes
    ----------
    case
        The case file.
    image, valid
        ``(H, W, 3)`` float32 code values 0..1 of the undistorted frame; ``(H, W)`` bool, False where it shows nothing.
    mesh
        The surface in the model frame (demeaned), mm.
    given_from_model
        4x4, the translation by the mean of the given vertices.
    cam_from_model
        4x4, the pose of the frame.
    structures
        What overlays show, in the model frame.
    told
        Sentences about what was corrected or dropped.
    """

    case: Case
    image: np.ndarray
    valid: np.ndarray
    mesh: TriangleMesh
    given_from_model: np.ndarray
    cam_from_model: np.ndarray
    structures: tuple[tuple[Structure, TriangleMesh], ...]
    told: tuple[str, ...]


def load_case(case: Case, *, aligned: bool = True) -> LoadedCase:
    """Open the files of a case and check that they fit together.

    Parameters
    ----------
    case
        The case.
    aligned
        False for a rough pose that is to be aligned yet: it may be anything.

    Raises
    ------
    InputError
        A file that cannot be used, an image of another size than the camera's, and, for an aligned case, a surface that
        lies behind the camera, outside the frame or at a distance that no microscope has.
    """
    image, valid = load_frame(case.image, case.camera, case.distortion, name=case.path.name)
    mesh, given_from_model, told = load_surface(case.mesh, case.mm_per_unit)
    cam_from_model = case.cam_from_given @ given_from_model
    if aligned:
        check_pose(case, mesh, cam_from_model)
    structures = []
    for structure in case.structures:
        structure_mesh, structure_told = read_mesh(structure.mesh)
        centre = given_from_model[:3, 3]
        structures.append((structure, structure_mesh.scaled(case.mm_per_unit).moved(-centre)))
        told += structure_told
    return LoadedCase(
        case, image, valid, mesh, given_from_model, cam_from_model, tuple(structures), (*case.told, *told)
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


def load_surface(path: Path, mm_per_unit: float) -> tuple[TriangleMesh, np.ndarray, list[str]]:
    """The surface in the model frame, mm; ``given_from_model`` (4x4); and sentences about what was dropped.

    Raises
    ------
    InputError
        No usable mesh.
    """
    given, told = read_mesh(path)
    given = given.scaled(mm_per_unit)
    centre = given.vertices.mean(axis=0)
    return given.moved(-centre), rigid(translation=centre), told


def check_pose(case: Case, mesh: TriangleMesh, cam_from_model: np.ndarray) -> None:
    """Check that a pose (4x4, mm) shows the surface (model frame) to the frame's camera, at a plausible distance.

    Raises
    ------
    InputError
        It does not.
    """
    name = case.path.name
    points_cam = transform_points(cam_from_model, mesh.vertices)
    depth = points_cam[:, 2]
    in_front = depth > 0
    if not in_front.any():
        raise InputError(
            f"{name}: expected the surface in front of the camera, all of it lies behind (depth {depth.min():.4g} to "
            f"{depth.max():.4g} mm); cam_from_model maps the mesh to OpenCV axes (z forward): "
            "invert the matrix if it is model_from_cam, negate its 2nd and 3rd row if its axes are OpenGL's, "
            "and give mesh and translation in the same unit"
        )
    distance = float(np.median(depth[in_front]))
    if not NEAREST_MM <= distance <= FARTHEST_MM:
        raise InputError(
            f"{name}: expected a working distance of {NEAREST_MM:g} mm to {FARTHEST_MM / 1000:g} m, the surface is "
            f"{distance:.4g} mm away: wrong units suspected; units is "
            f'"{"mm" if case.mm_per_unit == 1 else "m"}", is that what the mesh and the pose are in?'
        )
    camera = case.camera
    extent_px = 2 * mesh.radius / distance * min(camera.fx, camera.fy)
    ratio = extent_px / max(camera.size_wh)
    if not 1 / 200 <= ratio <= 200:
        raise InputError(
            f"{name}: expected a surface about as large as the frame, it spans {extent_px:.3g} px of "
            f"{max(camera.size_wh)}: wrong units suspected; are mesh and translation in the same unit?"
        )
    pixels = camera.project(points_cam[in_front])
    u, v = pixels[:, 0], pixels[:, 1]
    if u.max() < -0.5 or v.max() < -0.5 or u.min() > camera.width - 0.5 or v.min() > camera.height - 0.5:
        raise InputError(
            f"{name}: expected the surface in the frame, it projects to u {u.min():.0f} to {u.max():.0f}, "
            f"v {v.min():.0f} to {v.max():.0f} px of {camera.width}x{camera.height}; align the pose first"
        )
