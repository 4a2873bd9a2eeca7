"""A new case from the files that a user has: K for the frame, initial pose, and the folder with all of it."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ..camera.distortion import Distortion, lens_doubts
from ..camera.intrinsics_file import CameraFile
from ..camera.pinhole import PinholeCamera
from ..camera.plausibility import fit_of
from ..errors import InputError
from ..files.keys import file_and_place
from ..files.numbers import MM_PER_UNIT
from ..files.outputs import check_outputs, writing
from ..images.masked_frame import with_mask_tinted
from ..images.png import encode_png
from ..poses.pose_file import read_pose
from ..projection.initial_pose import initial_pose
from ..surface.mesh import TriangleMesh
from ..surface.mesh_reader import read_mesh
from ..transforms import inverse_rigid, rigid
from .case_file import Case, Structure, read_case
from .case_folder import (
    CASE,
    FRAME,
    OVERLAY,
    KeptFile,
    check_new,
    folder_outputs,
    keep_files,
    kept_case,
    kept_mesh,
    remove_unnamed,
    without_kept,
)
from .frame import Frame
from .loaded_case import LoadedCase, check_pose, frame_overlay, load_case
from .pose_record import INITIAL_GUESS, PoseRecord
from .surface_doubts import extents_of, place_doubt, size_doubt, size_text
from .surface_folder import RECORD, SURFACE, SurfaceFolder, read_surface_folder, structure_file


@dataclass(frozen=True)
class CaseInputs:
    """What a new case is made of.

    Attributes
    ----------
    surface
        The folder of ``oneframe surface``, or a mesh file.
    structures
        Further structures, with their meshes in the frame and unit of the surface.
    units
        ``"mm"`` or ``"m"``: the unit of the meshes and the pose; ``None``: nobody said it, so it is mm.
    frame
        With its mask, if it has one.
    camera
        K and distortion.
    rescale_camera
        Whether a K for another size of the same picture is rescaled.
    pose
        A file with ``cam_from_mesh``; ``None`` for an initial guess.
    """

    surface: Path
    structures: tuple[Structure, ...]
    units: str | None
    frame: Frame
    camera: CameraFile
    rescale_camera: bool
    pose: Path | None = None

    def files(self, folder: SurfaceFolder) -> dict[str, Path]:
        """All files that are read, by what they are; ``folder`` is what ``surface`` holds."""
        files = {"frame": self.frame.path, "camera": self.camera.path, "surface": folder.mesh}
        files |= {name: path for name, path in (("mask", self.frame.mask), ("pose", self.pose)) if path is not None}
        if self.surface.is_dir():
            files["report of the surface"] = self.surface / RECORD
        return files | {f"structure {structure.name}": structure.mesh for structure in folder.structures}


def make_case(given: CaseInputs, out: Path, *, overwrite: bool) -> Iterator[str]:
    """Check everything, then write the folder ``out``; ``overwrite`` replaces another frame or surface in it.

    Yields
    ------
    What it holds, and what is doubtful.
    """
    surface = _surface(given)
    inputs = given.files(surface)
    names = [structure.name for structure in surface.structures]
    check_outputs(without_kept(folder_outputs(out, names), inputs), inputs)
    frame = given.frame
    kept_frame = KeptFile(out / FRAME, frame.encoded())
    camera, distortion, doubts = _camera(given.camera, frame, rescale=given.rescale_camera)
    yield f"frame: {frame.size_wh[0]} x {frame.size_wh[1]} px, {frame.masked:.1%} masked"
    yield from (f"note: {message}" for message in frame.notes)
    yield f"K: fx {camera.fx:g}, fy {camera.fy:g}, cx {camera.cx:g}, cy {camera.cy:g} px" + (
        "" if distortion is None else ", with distortion"
    )
    yield from (f"warning: {message}" for message in doubts)

    mesh, messages = read_mesh(surface.mesh)
    units = given.units or "mm"
    mesh = mesh.scaled(MM_PER_UNIT[units])
    yield f"surface: {len(mesh.faces):,} triangles, {size_text(extents_of(mesh))}"
    yield from (f"note: {message}" for message in messages)
    if size := size_doubt(extents_of(mesh), units, camera, surface.mesh.name):
        yield f"warning: {size.message}"
    yield from _structure_lines(surface, mesh, MM_PER_UNIT[units])

    kept_surface = kept_mesh(surface.mesh, out / SURFACE)
    structures = [kept_mesh(each.mesh, out / structure_file(each.name)) for each in surface.structures]
    files = [file.beside(another=overwrite) for file in (kept_frame, kept_surface, *structures)]
    kept_frame, kept_surface, *structures = files
    case = Case(
        path=out / CASE,
        mm_per_unit=MM_PER_UNIT[units],
        image=kept_frame.path,
        camera=camera,
        distortion=distortion,
        mesh=kept_surface.path,
        cam_from_mesh=np.eye(4),
        structures=tuple(
            replace(each, mesh=file.path) for each, file in zip(surface.structures, structures, strict=True)
        ),
    )
    case, lines = _with_pose(case, given, surface, mesh)
    yield from lines
    written, replaced = kept_case(case), _files_before(out / CASE)
    check_outputs([file.path for file in (*files, written) if not file.is_there], inputs)
    if not overwrite:
        check_new([*files, written], "choose another folder, or replace it with --overwrite")
    keep_files(files, inputs)
    if not written.is_there:
        with writing(out / OVERLAY):
            (out / OVERLAY).unlink(missing_ok=True)
    keep_files([written], inputs)
    remove_unnamed(out, replaced, inputs=inputs.values())
    yield f"case: {case.path}"
    # as every other command reads it
    picture = encode_png(_overlay(load_case(read_case(case.path), aligned=False)))
    keep_files([KeptFile(out / OVERLAY, picture)], inputs)
    yield f"frame with the surface at this pose: {out / OVERLAY}"


def _files_before(path: Path) -> list[Path]:
    """The files of the case that is replaced, if there is one that can be read."""
    try:
        return [file for name, file in read_case(path, posed=False).input_files().items() if name != "case"]
    except InputError:
        return []


def _surface(given: CaseInputs) -> SurfaceFolder:
    if given.surface.is_dir():
        if given.units == "m":
            raise InputError(f"{given.surface}: expected mm, the unit of the meshes in it, found 'm'")
        found = read_surface_folder(given.surface)
    else:
        found = SurfaceFolder(given.surface)
    structures = [*found.structures, *given.structures]
    names = [structure.name for structure in structures]
    if repeated := sorted({name for name in names if names.count(name) > 1}):
        raise InputError(f"structures: expected a different name for each, found {repeated[0]!r} twice")
    # in the order of the window's
    return replace(found, structures=tuple(sorted(structures, key=lambda structure: structure.name)))


def _camera(file: CameraFile, frame: Frame, *, rescale: bool) -> tuple[PinholeCamera, Distortion | None, Sequence[str]]:
    """K and distortion for the frame, and what is doubtful about them."""
    size_wh = frame.size_wh
    fit = fit_of(file, size_wh, frame.pixel_aspect)
    camera, doubts = fit.camera, list(fit.messages)
    if file.size is not None and file.size != size_wh:
        mismatch, *doubts = fit.messages
        if fit.rescaled is None:
            raise InputError(f"{file.path.name}: {mismatch}")
        if not rescale:
            raise InputError(
                f"{file.path.name}: {mismatch} with --rescale-camera, or give the K and the frame of one size"
            )
        camera = fit.rescaled
    else:
        # checks it for this size
        camera = file.camera(size_wh)
    lens = file.distortion_for(camera)
    return camera, lens, [*doubts, *lens_doubts(lens, camera)]


def _structure_lines(surface: SurfaceFolder, mesh: TriangleMesh, mm_per_unit: float) -> Iterator[str]:
    for structure in surface.structures:
        found, messages = read_mesh(structure.mesh, like=surface.mesh)
        yield from (f"note: {message}" for message in messages)
        bounds = found.scaled(mm_per_unit).bounds
        if doubt := place_doubt(bounds, mesh.bounds, structure.name, surface.mesh.name):
            yield f"warning: {doubt}"
    if surface.structures:
        yield f"structures: {', '.join(structure.name for structure in surface.structures)}"


def _with_pose(case: Case, given: CaseInputs, surface: SurfaceFolder, mesh: TriangleMesh) -> tuple[Case, Sequence[str]]:
    """The case with the given pose, or with an initial one."""
    centre = mesh.vertices.mean(axis=0)
    mesh_from_model, model = rigid(translation=centre), mesh.moved(-centre)
    if (file := given.pose) is not None:
        cam_from_mesh, message = read_pose(file, mm_per_unit=case.mm_per_unit if given.units else None)
        found = replace(case, cam_from_mesh=cam_from_mesh)
        check_pose(replace(found, path=file_and_place(file)[0]), model, cam_from_mesh @ mesh_from_model)
        return found, [f"pose: {file}", *([f"note: {message}"] if message else [])]
    focus = surface.focus_of(mesh)
    if focus is not None:
        focus = replace(focus, centre=focus.centre - centre)
    cam_from_model = initial_pose(model, case.camera, focus)
    found = replace(
        case, cam_from_mesh=cam_from_model @ inverse_rigid(mesh_from_model), alignment=PoseRecord(INITIAL_GUESS)
    )
    return found, ["pose: an initial guess, not aligned"]


def _overlay(loaded: LoadedCase) -> np.ndarray:
    """``(H, W, 3)`` uint8: the frame with outline and structures, and its mask in blue."""
    tinted = with_mask_tinted(loaded.frame.image, loaded.frame.valid)
    return frame_overlay(replace(loaded, frames=(replace(loaded.frame, image=tinted),)))
