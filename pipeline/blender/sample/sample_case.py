"""The built-in sample case as a folder of files like a user's own: frame, surface, structures, case file."""

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from ...camera.pinhole import PinholeCamera
from ...case.case_file import Case, Structure
from ...case.case_writer import case_text, write_case
from ...errors import InputError
from ...files.content import read_content
from ...files.outputs import check_outputs, check_own_folder, made_folder, write_output, writing
from ...files.temporary import temporary_folder
from ...images.image_reader import read_image
from ...images.pixel_values import to_uint8
from ...sample.film import disturbance, disturbed, film_poses
from ...sample.temporal_bone import MICROSCOPE, SampleSurface, frame_pose, held_out_poses
from ...surface.mesh_writer import write_ply
from ...surface.structure_colour import structure_colour
from ..render.video import write_video
from .photograph import take_photographs

STRUCTURES = ("facial_nerve", "chorda_tympani", "ossicles")
HELD_OUT, UNALIGNED = "held_out.json", "unaligned.toml"
FILM, FILM_POSES = "film.mp4", "film.json"
_NAMES = r"surface\.ply|structures|frame\.png|case\.toml|unaligned\.toml|held_out|held_out\.json|film\.mp4|film\.json"
COMMENT = "A photograph of a drilled temporal bone: generated, not a patient"


def check_sample_case(folder: Path, *, camera: PinholeCamera = MICROSCOPE, held_out: bool = True) -> None:
    """Check before any work that the files of :func:`write_sample_case` can be written."""
    case, text = folder / "case.toml", case_text(folder / "case.toml", _case(folder, camera), comment=COMMENT)
    images = ("frame.png", *(_held_out_views() if held_out else ()))
    names = ["surface.ply", *map(_structure_file, STRUCTURES), *images, UNALIGNED, "case.toml"]
    check_outputs([folder / name for name in (*names, *([HELD_OUT] if held_out else []))], {})
    if not case.exists():
        check_own_folder(folder, _NAMES, {}, alone=False)
    elif read_content(case, "a case file") != text.encode():
        raise InputError(f"{case}: expected no such file or the sample's, found another case; choose another folder")


def write_sample_case(
    folder: Path, surface: SampleSurface, *, camera: PinholeCamera = MICROSCOPE, held_out: bool = True
) -> Iterator[Path]:
    """Write the sample case and photographs of it.

    The files are ``surface.ply``, ``structures/*.ply``, ``frame.png``, ``case.toml``, the same without its pose to
    practise with, ``unaligned.toml``, and, to judge novel views,
    ``held_out/view_*.png`` with ``held_out.json``: a list of ``image`` (path) and ``cam_from_mesh`` (4x4, mm, OpenCV
    axes, in the frame of the mesh file).

    Parameters
    ----------
    folder
        Created if it does not exist; the files of an earlier sample case are replaced.
    surface
        From :func:`oneframe.sample.temporal_bone.sample_surface`.
    camera
        Intrinsics of all photographs.
    held_out
        Also take the photographs for judging novel views, which takes most of the time.

    Yields
    ------
    Each file's path once it is complete; ``case.toml`` is the last.
    """
    check_sample_case(folder, camera=camera, held_out=held_out)
    with writing(folder / "case.toml"):
        (folder / "case.toml").unlink(missing_ok=True)
    meshes = {"surface.ply": surface.bone}
    meshes |= {_structure_file(name): mesh for name, mesh in surface.structures.items()}
    for name, mesh in meshes.items():
        with writing(made_folder(folder / name)):
            write_ply(folder / name, mesh)
        yield folder / name

    shots = {"frame.png": frame_pose(), **(_held_out_views() if held_out else {})}
    yield from take_photographs(surface, camera, [(pose, made_folder(folder / name)) for name, pose in shots.items()])
    if held_out:
        write_output(folder / HELD_OUT, _held_out_list())
        yield folder / HELD_OUT
    case = _case(folder, camera)
    for path, written in ((folder / UNALIGNED, replace(case, posed=False)), (folder / "case.toml", case)):
        with writing(path):
            write_case(path, written, comment=COMMENT)
        yield path


def write_sample_film(folder: Path, surface: SampleSurface, *, camera: PinholeCamera = MICROSCOPE) -> Iterator[Path]:
    """Write a film of the sample at half its size, path traced, beside its case.

    ``film.json`` lists for each frame ``frame``, ``cam_from_mesh`` as in ``held_out.json``, and ``disturbance``: what
    spoils the frame, if anything does.

    Yields
    ------
    Each file's path once it is complete.
    """
    small, poses = camera.resized(camera.width // 2, camera.height // 2), film_poses()
    with temporary_folder() as pictures:
        shots = [(pose, pictures / f"{number:03d}.png") for number, pose in enumerate(poses)]
        photographs = take_photographs(surface, small, shots)
        frames = (
            disturbed(to_uint8(read_image(path)[0]), number).astype(np.float32) / 255
            for number, path in enumerate(list(photographs))
        )
        with writing(folder / FILM):
            write_video(folder / FILM, frames)
    yield folder / FILM
    listed = [
        {"frame": number, "cam_from_mesh": pose.tolist(), "disturbance": disturbance(number)}
        for number, pose in enumerate(poses)
    ]
    write_output(folder / FILM_POSES, (json.dumps(listed, indent=1) + "\n").encode())
    yield folder / FILM_POSES


def _structure_file(name: str) -> str:
    return f"structures/{name}.ply"


def _held_out_views() -> dict[str, np.ndarray]:
    return {f"held_out/view_{number}.png": pose for number, pose in enumerate(held_out_poses(), start=1)}


def _held_out_list() -> bytes:
    listed = [{"image": name, "cam_from_mesh": pose.tolist()} for name, pose in _held_out_views().items()]
    return (json.dumps(listed, indent=1) + "\n").encode()


def _case(folder: Path, camera: PinholeCamera) -> Case:
    structures = [Structure(name, folder / _structure_file(name), structure_colour(name)) for name in STRUCTURES]
    return Case(
        path=folder / "case.toml",
        mm_per_unit=1.0,
        image=folder / "frame.png",
        camera=camera,
        distortion=None,
        mesh=folder / "surface.ply",
        cam_from_mesh=frame_pose(),
        structures=tuple(structures),
    )
