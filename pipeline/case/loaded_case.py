"""A case in memory, checked: its files fit together, and its pose shows the surface at a microscope's distance."""

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ..camera.distortion import lens_doubts
from ..camera.pinhole import whereabouts
from ..errors import InputError
from ..files.keys import nearest_name
from ..images.overlay import draw_overlay
from ..images.pixel_values import to_uint8
from ..poses.pose_file import OTHER_CONVENTION
from ..projection.initial_pose import initial_pose
from ..projection.overlay_scene import OverlayScene
from ..surface.mesh import TriangleMesh
from ..surface.mesh_reader import read_mesh
from ..surface.structure_colour import OTHER
from ..transforms import inverse_rigid, rigid, transform_points
from .case_file import Case, Structure
from .case_writer import UNIT_OF
from .frame import PosedFrame, load_posed_frame
from .pose_record import INITIAL_GUESS, PoseRecord
from .surface_doubts import FARTHEST_MM, NEAREST_MM, extents_of, precision_doubts, size_doubt

_LISTED_POINTS = 500
"""Vertices by which a listed pose is checked: a list may have a million of them."""

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

    def posed(self, cam_from_mesh: np.ndarray, record: PoseRecord) -> "LoadedCase":
        """The case with another pose ``(4, 4)``, mm, of its frame, and the record of how it was found."""
        case = replace(self.case, cam_from_mesh=cam_from_mesh, alignment=record)
        pose = cam_from_mesh @ self.surface.mesh_from_model
        return replace(self, case=case, frames=(replace(self.frame, cam_from_model=pose), *self.frames[1:]))

    def with_shown_structures(self, only: Collection[str] = ()) -> "LoadedCase":
        """The case with the structures that overlays show: those named in ``only``, else those that are not white.

        White ones are context, such as the dura and the ear canal, and would hide the nerve; they are shown where no
        structure has another colour.
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


def load_case(case: Case, *, aligned: bool = True) -> LoadedCase:
    """Open the files of a case and check that they fit together.

    Parameters
    ----------
    case
        The case.
    aligned
        False accepts any pose, and puts an initial guess in the place of none: use it before the alignment.
    """
    mesh, mesh_from_model, messages = load_surface(case.mesh, case.mm_per_unit)
    if not case.posed and not aligned:
        guess = initial_pose(mesh, case.camera) @ inverse_rigid(mesh_from_model)
        case = replace(case, cam_from_mesh=guess, posed=True, alignment=PoseRecord(INITIAL_GUESS))
        messages = [*messages, "the case has no pose and begins with an initial guess"]
    messages = [*messages, *lens_doubts(case.distortion, case.camera)]
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


def load_surface(path: Path, mm_per_unit: float) -> tuple[TriangleMesh, np.ndarray, list[str]]:
    """Read the surface and move it to the model frame.

    Returns
    -------
    The surface in the model frame, mm; ``mesh_from_model`` (4x4, mm); and messages about what was dropped.
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
    """Check that a pose (4x4, mm) shows the surface (model frame) to the frame's camera, at a plausible distance."""
    points_cam = transform_points(cam_from_model, mesh.vertices)
    _check_distance(case, mesh, points_cam)
    place = whereabouts(points_cam, case.camera, np.eye(4))
    if place is not None:
        camera = case.camera
        u, v = camera.project(points_cam[points_cam[:, 2] > 0]).T
        raise InputError(
            f"{case.path.name}: expected the surface in the frame, it lies {place}: u {u.min():.0f} to {u.max():.0f}, "
            f"v {v.min():.0f} to {v.max():.0f} px of {camera.width}x{camera.height}; align the pose first"
        )


def check_listed(loaded: LoadedCase, poses: Iterable[np.ndarray | None], name: str) -> None:
    """Check that listed poses ``cam_from_model`` have the unit and the axes of the case; they may show what they like.

    ``name`` is their file's.
    """
    mesh = loaded.surface.mesh
    points = mesh.vertices[:: 1 + len(mesh.vertices) // _LISTED_POINTS]
    for number, pose in enumerate(poses):
        if pose is not None:
            case = replace(loaded.case, path=Path(f"{name}: pose {number} (counted from 0)"))
            _check_distance(case, mesh, transform_points(pose, points))


def _check_distance(case: Case, mesh: TriangleMesh, points_cam: np.ndarray) -> None:
    """Whether points of a surface are in front of a camera, and as far away as a microscope may be."""
    name, depth = case.path.name, points_cam[:, 2]
    in_front = depth > 0
    if not in_front.any():
        raise InputError(
            f"{name}: expected the surface in front of the camera, all of it is behind (depth {depth.min():.4g} to "
            f"{depth.max():.4g} mm); {OTHER_CONVENTION}"
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


def frame_overlay(loaded: LoadedCase, surface_depth_mm: np.ndarray | None = None) -> np.ndarray:
    """The frame with its overlay, ``(H, W, 3)`` uint8.

    Parameters
    ----------
    loaded
        The case, at its pose; of its structures, those of :meth:`.LoadedCase.with_shown_structures`.
    surface_depth_mm
        ``(H, W)`` depth of the surface in the frame, 0 where there is none; rasterised if left out.
    """
    frame = loaded.frame
    camera, pose = frame.camera, frame.cam_from_model
    scene = overlay_scene(loaded.with_shown_structures())
    surface = scene.surface_layer(camera, pose, surface_depth_mm)
    return draw_overlay(to_uint8(frame.image), surface, scene.layers(camera, pose))


def overlay_scene(loaded: LoadedCase) -> OverlayScene:
    """The surface and the structures of a case."""
    surface = loaded.surface
    return OverlayScene.of(surface.mesh, [(mesh, structure.colour) for structure, mesh in surface.structures])
