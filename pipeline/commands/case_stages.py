"""The stages of ``oneframe case``: inputs, K for the frame, pose, files."""

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ..alignment.manual.initial_pose import initial_pose
from ..blender.bridge.image import read_image
from ..blender.case.load_case import load_case
from ..camera.distortion import Distortion
from ..camera.intrinsics_file import CameraFile, read_camera
from ..camera.pinhole import PinholeCamera
from ..camera.plausibility import fit_of
from ..case.alignment_record import INITIAL_GUESS
from ..case.case_file import Case, Structure, read_case
from ..case.case_folder import (
    CASE,
    FRAME,
    OVERLAY,
    KeptFile,
    folder_outputs,
    keep_files,
    kept_case,
    kept_mesh,
    rounding_message,
    without_kept,
)
from ..case.loaded_case import LoadedCase, check_pose
from ..case.structure_colour import OTHER, structure_colour
from ..case.structure_place import place_doubt
from ..case.surface_folder import RECORD, SURFACE, SurfaceFolder, read_surface_folder, structure_file
from ..case.surface_size import extents_of, size_doubt, size_text
from ..errors import InputError
from ..files.content import read_content
from ..files.kinds import PNG
from ..files.numbers import MM_PER_UNIT
from ..files.outputs import check_outputs
from ..files.signature import signed
from ..images.image_header import JPEG_SIGNATURE
from ..images.masked_frame import encoded_frame, joined_mask, shown_by_mask
from ..images.overlay import Layer, draw_overlay
from ..images.pixel_values import to_uint8
from ..images.png import encode_png
from ..poses.pose_file import read_pose
from ..projection.z_buffer import rasterise_depth
from ..surface.mesh import TriangleMesh
from ..surface.mesh_reader import read_mesh
from ..transforms import inverse_rigid, rigid


@dataclass(frozen=True)
class _Frame:
    """The frame in memory: ``(H, W, 3)`` code values 0..1 and ``(H, W)`` bool, False where it shows no surface."""

    colours: np.ndarray
    shown: np.ndarray

    @property
    def size_wh(self) -> tuple[int, int]:
        return self.shown.shape[1], self.shown.shape[0]


def made_case(arguments: argparse.Namespace) -> Iterator[str]:
    """Make the case that the arguments of ``oneframe case`` describe.

    Yields
    ------
    What it holds, and what is doubtful.

    Raises
    ------
    InputError
        An input cannot be used, the inputs do not fit together, or an output must not be replaced.
    RunError
        A file cannot be written.
    """
    out: Path = arguments.out
    surface = _surface(arguments)
    inputs = _inputs(arguments, surface)
    names = [structure.name for structure in surface.structures]
    check_outputs(without_kept(folder_outputs(out, names, overlay=True), inputs), inputs)
    file = _camera_file(arguments)
    frame = _frame(arguments)
    camera, distortion, doubts = _camera(file, frame.size_wh, rescale=arguments.rescale_camera)
    yield f"frame: {frame.size_wh[0]} x {frame.size_wh[1]} px, {1 - frame.shown.mean():.1%} masked"
    yield f"K: fx {camera.fx:g}, fy {camera.fy:g}, cx {camera.cx:g}, cy {camera.cy:g} px" + (
        "" if distortion is None else ", with distortion"
    )
    yield from (f"note: {message}" for message in file.messages)
    yield from (f"warning: {message}" for message in doubts)

    units = arguments.units or "mm"
    mesh, messages = read_mesh(surface.mesh)
    mesh = mesh.scaled(MM_PER_UNIT[units])
    yield f"surface: {len(mesh.faces):,} triangles, {size_text(extents_of(mesh))}"
    yield from (f"note: {message}" for message in messages)
    if size := size_doubt(extents_of(mesh), units, camera, surface.mesh.name):
        yield f"warning: {size.message}"
    yield from _structure_lines(surface, mesh, MM_PER_UNIT[units])

    case = Case(
        path=out / CASE,
        mm_per_unit=MM_PER_UNIT[units],
        image=out / FRAME,
        camera=camera,
        distortion=distortion,
        mesh=out / SURFACE,
        cam_from_mesh=np.eye(4),
        structures=tuple(replace(each, mesh=out / structure_file(each.name)) for each in surface.structures),
    )
    case, lines = _with_pose(case, arguments.pose, surface, mesh)
    yield from lines
    files = [
        KeptFile(out / FRAME, encoded_frame(frame.colours, frame.shown, arguments.frame.name), PNG),
        kept_mesh(surface.mesh, out / SURFACE),
        *(kept_mesh(each.mesh, out / structure_file(each.name)) for each in surface.structures),
        kept_case(case),
    ]
    keep_files(files, inputs)
    yield f"case: {case.path}"
    # as every other command reads it
    picture = signed(encode_png(to_uint8(_overlay(load_case(read_case(case.path), aligned=False)))))
    keep_files([KeptFile(out / OVERLAY, picture, PNG)], inputs)
    yield f"frame with the surface at this pose: {out / OVERLAY}"


def _surface(arguments: argparse.Namespace) -> SurfaceFolder:
    path: Path = arguments.surface
    if path.is_dir():
        if arguments.units == "m":
            raise InputError(f"--units m: expected mm, the unit of the meshes that oneframe surface wrote to {path}")
        found = read_surface_folder(path)
    else:
        found = SurfaceFolder(path, (), None)
    structures = [*found.structures, *map(_structure, arguments.structures)]
    names = [structure.name for structure in structures]
    if repeated := sorted({name for name in names if names.count(name) > 1}):
        raise InputError(f"--structure: expected a different name for each structure, found {repeated[0]!r} twice")
    # in the order of the window's
    return replace(found, structures=tuple(sorted(structures, key=lambda structure: structure.name)))


def _structure(text: str) -> Structure:
    name, equals, file = text.partition("=")
    if not equals or Path(text).exists():
        name, file = Path(text).stem, text
    if not name or not file:
        raise InputError(f"--structure: expected NAME=FILE or a file, found {text!r}")
    return Structure(name, Path(file), structure_colour(name))


def _inputs(arguments: argparse.Namespace, surface: SurfaceFolder) -> dict[str, Path]:
    inputs = {name: path for name in ("frame", "mask", "camera", "pose") if (path := getattr(arguments, name))}
    inputs["surface"] = surface.mesh
    if arguments.surface.is_dir():
        inputs["report of the surface"] = arguments.surface / RECORD
    return inputs | {f"structure {structure.name}": structure.mesh for structure in surface.structures}


def _camera_file(arguments: argparse.Namespace) -> CameraFile:
    if arguments.camera is not None:
        return read_camera(arguments.camera)
    fx, fy, cx, cy = arguments.K
    size = None if arguments.size is None else (arguments.size[0], arguments.size[1])
    distortion = None
    if arguments.distortion is not None:
        if len(arguments.distortion) not in (4, 5):
            raise InputError(f"--distortion: expected k1 k2 p1 p2 [k3], found {len(arguments.distortion)} numbers")
        k1, k2, p1, p2, k3 = (*arguments.distortion, 0.0)[:5]
        distortion = (k1, k2, p1, p2, k3)
    if size is not None:
        # checks the size
        PinholeCamera.from_matrix([[fx, 0, cx], [0, fy, cy], [0, 0, 1]], size=size, where="--K")
    return CameraFile(Path("--K"), fx, fy, cx, cy, size=size, distortion=distortion, pixel_origin="")


def _camera(
    file: CameraFile, size_wh: tuple[int, int], *, rescale: bool
) -> tuple[PinholeCamera, Distortion | None, Sequence[str]]:
    """K and distortion for the frame, and what is doubtful about them."""
    fit = fit_of(file, size_wh)
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
    return camera, file.distortion_for(camera), doubts


def _frame(arguments: argparse.Namespace) -> _Frame:
    path: Path = arguments.frame
    if arguments.frame_number is not None:
        # needs OpenCV, which no image does
        from ..video.frame_reader import read_video_frame

        pixels = read_video_frame(path, arguments.frame_number)
        colours, shown = (pixels / np.float32(255)).astype(np.float32), np.ones(pixels.shape[:2], np.bool_)
    else:
        if path.suffix.lower() in _VIDEOS:
            raise InputError(f"{path.name}: expected an image, found a video; say which frame with --frame-number")
        colours, shown = read_image(path, path.name)
    if arguments.mask is not None:
        shown = joined_mask(shown, read_mask(arguments.mask), path.name, arguments.mask.name)
    elif not shown.any():
        raise InputError(f"{path.name}: expected a frame that shows something, its alpha is 0 everywhere")
    return _Frame(colours, shown)


_VIDEOS = (".mp4", ".avi", ".mov", ".mkv", ".m4v", ".mpg", ".mpeg", ".webm")


def read_mask(path: Path) -> np.ndarray:
    """``(H, W)`` bool of a mask's file, True where it shows the surface; see :func:`.shown_by_mask`.

    Raises
    ------
    InputError
        No image without losses, no mask, or one that shows nothing.
    """
    if path.is_file() and read_content(path, "a mask", path.name).startswith(JPEG_SIGNATURE):
        raise InputError(f"{path.name}: expected a mask, found a JPEG, which blurs its zeros; make it as PNG")
    return shown_by_mask(*read_image(path, path.name), path.name)


def _structure_lines(surface: SurfaceFolder, mesh: TriangleMesh, mm_per_unit: float) -> Iterator[str]:
    if message := rounding_message(mesh, surface.mesh.name):
        yield f"note: {message}"
    for structure in surface.structures:
        found, messages = read_mesh(structure.mesh)
        yield from (f"note: {message}" for message in messages)
        bounds = found.scaled(mm_per_unit).bounds
        if doubt := place_doubt(bounds, mesh.bounds, structure.name, surface.mesh.name):
            yield f"warning: {doubt}"
    if surface.structures:
        yield f"structures: {', '.join(structure.name for structure in surface.structures)}"


def _with_pose(case: Case, file: Path | None, surface: SurfaceFolder, mesh: TriangleMesh) -> tuple[Case, Sequence[str]]:
    """The case with the given pose, or with an initial one."""
    centre = mesh.vertices.mean(axis=0)
    mesh_from_model, model = rigid(translation=centre), mesh.moved(-centre)
    if file is not None:
        cam_from_mesh, message = read_pose(file, mm_per_unit=case.mm_per_unit)
        found = replace(case, cam_from_mesh=cam_from_mesh)
        check_pose(replace(found, path=file), model, cam_from_mesh @ mesh_from_model)
        return found, [f"pose: {file}", *([f"note: {message}"] if message else [])]
    focus = None if surface.focus is None else replace(surface.focus, centre=surface.focus.centre - centre)
    cam_from_model = initial_pose(model, case.camera, focus)
    found = replace(
        case, cam_from_mesh=cam_from_model @ inverse_rigid(mesh_from_model), alignment={"method": INITIAL_GUESS}
    )
    return found, ["pose: an initial guess, not aligned"]


def _overlay(loaded: LoadedCase) -> np.ndarray:
    """``(H, W, 3)`` float32 values 0..1: the frame with outline and structures, from a z-buffer."""

    def depth_mm(mesh: TriangleMesh) -> np.ndarray:
        inverse = rasterise_depth(mesh, loaded.case.camera, loaded.cam_from_model).inverse_depth
        return np.divide(1.0, inverse, out=np.zeros_like(inverse), where=inverse > 0)

    # the ear canal and the dura would hide the nerve
    known = [each for each in loaded.structures if each[0].colour != OTHER] or loaded.structures
    layers = [Layer(depth_mm(mesh), structure.colour) for structure, mesh in known]
    return draw_overlay(loaded.image, depth_mm(loaded.mesh), layers)
