"""A case in memory, and a check that its pose is plausible: the surface in view, at a microscope's distance."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ..camera.pinhole import whereabouts
from ..errors import InputError
from ..files.keys import nearest_name
from ..surface.mesh import TriangleMesh
from ..surface.mesh_reader import read_mesh
from ..surface.structure_colour import OTHER
from ..transforms import rigid, transform_points
from .case_file import Case, Structure
from .posed_frame import PosedFrame

NEAREST_MM, FARTHEST_MM = 2.0, 30_000.0
"""Working distances outside this range indicate wrong units; an error by a factor of 1000 is always outside."""

MAX_EXTENT_RATIO = 200.0
"""Largest ratio of the surface's extent to the frame's at the pose, or of the frame's to the surface's: wrong units
make it 1000 times as large or small."""


@dataclass(frozen=True)
class LoadedSurface:
    """A surface in memory.

    Attributes
    ----------
    mesh
        The surface in the model frame (demeaned), mm.
    mesh_from_model
        4x4, mm: the translation by the mean of the file's vertices.
    structures
        The structures and their meshes in the model frame, for overlays.
    """

    mesh: TriangleMesh
    mesh_from_model: np.ndarray
    structures: tuple[tuple[Structure, TriangleMesh], ...] = ()


@dataclass(frozen=True)
class LoadedCase:
    """A case in memory: the case file, its surface, its frames, and messages about what was corrected or dropped."""

    case: Case
    surface: LoadedSurface
    frames: tuple[PosedFrame, ...]
    messages: tuple[str, ...] = ()

    @property
    def frame(self) -> PosedFrame:
        """The frame that the case file names: overlays show it, poses are drawn around its own."""
        return self.frames[0]

    def posed(self, cam_from_mesh: np.ndarray, record: dict[str, object]) -> "LoadedCase":
        """The case with another pose ``(4, 4)``, mm, of its frame, and the record of how it was found."""
        case = replace(self.case, cam_from_mesh=cam_from_mesh, alignment=record)
        pose = cam_from_mesh @ self.surface.mesh_from_model
        return replace(self, case=case, frames=(replace(self.frame, cam_from_model=pose), *self.frames[1:]))

    def zoomed(self, factor: float) -> "LoadedCase":
        """The case with another focal length of its frame, relative to its own."""
        case = replace(self.case, camera=self.case.camera.zoomed(factor))
        frame = replace(self.frame, camera=self.frame.camera.zoomed(factor))
        return replace(self, case=case, frames=(frame, *self.frames[1:]))

    def with_shown_structures(self, only: Collection[str] = ()) -> "LoadedCase":
        """The case with the structures that overlays show: those named in ``only``, else those that are not white.

        White ones are context, such as the dura and the ear canal, and would hide the nerve; they are shown where no
        structure has another colour.

        Raises
        ------
        InputError
            There is no structure of a name in ``only``.
        """
        structures = self.surface.structures
        names = [structure.name for structure, _ in structures]
        for name in only:
            if name not in names:
                raise InputError(
                    f"{self.case.path.name}: no structure is named {name!r}; {nearest_name(name, tuple(names))}"
                )
        if only:
            shown = tuple(each for each in structures if each[0].name in only)
        else:
            shown = tuple(each for each in structures if each[0].colour != OTHER) or structures
        return replace(self, surface=replace(self.surface, structures=shown))


def load_surface(path: Path, mm_per_unit: float) -> tuple[TriangleMesh, np.ndarray, list[str]]:
    """Read the surface and move it to the model frame.

    Returns
    -------
    The surface in the model frame, mm; ``mesh_from_model`` (4x4, mm); and messages about what was dropped.

    Raises
    ------
    InputError
        No usable mesh.
    """
    given, messages = read_mesh(path)
    given = given.scaled(mm_per_unit)
    centre = given.vertices.mean(axis=0)
    return given.moved(-centre), rigid(translation=centre), messages


def check_poses(case: Case, mesh: TriangleMesh, frames: Sequence[PosedFrame]) -> None:
    """:func:`check_pose` for each of the case's frames, the own one first; messages name the others."""
    for number, frame in enumerate(frames, start=1):
        path = case.path if number == 1 else case.path.with_name(f"{case.path.name}: frame {number}")
        check_pose(replace(case, path=path, camera=frame.camera), mesh, frame.cam_from_model)


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
            f"{name}: expected the surface in front of the camera, all of it is behind (depth {depth.min():.4g} to "
            f"{depth.max():.4g} mm); cam_from_mesh maps the mesh to OpenCV axes (z forward): "
            "invert the matrix if it is mesh_from_cam, negate its 2nd and 3rd row if its axes are OpenGL's, "
            "and give mesh and translation in the same unit"
        )
    distance = float(np.median(depth[in_front]))
    if not NEAREST_MM <= distance <= FARTHEST_MM:
        raise InputError(
            f"{name}: expected a working distance of {NEAREST_MM:g} mm to {FARTHEST_MM / 1000:g} m, the surface is "
            f"{distance:.4g} mm away: wrong units suspected; units is "
            f'"{"mm" if case.mm_per_unit == 1 else "m"}", are the mesh and the pose in this unit?'
        )
    camera = case.camera
    extent_px = 2 * mesh.radius / distance * min(camera.fx, camera.fy)
    ratio = extent_px / max(camera.size_wh)
    if not 1 / MAX_EXTENT_RATIO <= ratio <= MAX_EXTENT_RATIO:
        raise InputError(
            f"{name}: expected a surface about as large as the frame, it spans {extent_px:.3g} px of "
            f"{max(camera.size_wh)}: wrong units suspected; are mesh and translation in the same unit?"
        )
    place = whereabouts(points_cam, camera, np.eye(4))
    if place is not None:
        u, v = camera.project(points_cam[in_front]).T
        raise InputError(
            f"{name}: expected the surface in the frame, it lies {place}: u {u.min():.0f} to {u.max():.0f}, "
            f"v {v.min():.0f} to {v.max():.0f} px of {camera.width}x{camera.height}; align the pose first"
        )
