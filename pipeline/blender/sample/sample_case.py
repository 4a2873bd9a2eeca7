"""The built-in sample case as a folder of files like a user's own: frame, surface, structures, case file."""

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from ...camera.pinhole import PinholeCamera
from ...case.case_file import Case, Structure
from ...case.case_writer import write_case
from ...case.structure_colour import structure_colour
from ...files.content import write_bytes_atomically
from ...sample.temporal_bone import MICROSCOPE, SampleSurface, frame_pose, held_out_poses
from ...surface.mesh_writer import write_ply
from .photograph import take_photographs

COMMENT = "A photograph of a drilled temporal bone: generated, not a patient"


def write_sample_case(
    folder: Path, surface: SampleSurface, *, camera: PinholeCamera = MICROSCOPE, held_out: bool = True
) -> Iterator[Path]:
    """Write the sample case and photographs of it.

    The files are ``surface.ply``, ``structures/*.ply``, ``frame.png``, ``case.toml``, and, to judge novel views,
    ``held_out/view_*.png`` with ``held_out.json``: a list of ``image`` (path) and ``cam_from_mesh`` (4x4, mm, OpenCV
    axes, in the frame of the mesh file).

    Parameters
    ----------
    folder
        Created if it does not exist; files of these names are replaced.
    surface
        From :func:`pipeline.sample.temporal_bone.sample_surface`.
    camera
        Intrinsics of all photographs.
    held_out
        Also take the photographs for judging novel views, which takes most of the time.

    Yields
    ------
    Each file's path once it is complete; ``case.toml`` is the last.
    """
    for part in ("structures", "held_out") if held_out else ("structures",):
        (folder / part).mkdir(parents=True, exist_ok=True)
    write_ply(folder / "surface.ply", surface.bone)
    yield folder / "surface.ply"
    for name, mesh in surface.structures.items():
        write_ply(folder / f"structures/{name}.ply", mesh)
        yield folder / f"structures/{name}.ply"

    others = held_out_poses() if held_out else []
    views = {f"held_out/view_{number}.png": pose for number, pose in enumerate(others, start=1)}
    shots = {"frame.png": frame_pose(), **views}
    yield from take_photographs(surface, camera, [(pose, folder / name) for name, pose in shots.items()])
    if held_out:
        listed = [{"image": name, "cam_from_mesh": pose.tolist()} for name, pose in views.items()]
        write_bytes_atomically(folder / "held_out.json", (json.dumps(listed, indent=1) + "\n").encode())
        yield folder / "held_out.json"
    path = folder / "case.toml"
    write_case(path, _case(path, camera, shots["frame.png"], surface), comment=COMMENT)
    yield path


def _case(path: Path, camera: PinholeCamera, cam_from_mesh: np.ndarray, surface: SampleSurface) -> Case:
    folder = path.parent
    structures = [
        Structure(name, folder / f"structures/{name}.ply", structure_colour(name)) for name in surface.structures
    ]
    return Case(
        path=path,
        mm_per_unit=1.0,
        image=folder / "frame.png",
        camera=camera,
        distortion=None,
        mesh=folder / "surface.ply",
        cam_from_mesh=cam_from_mesh,
        structures=tuple(structures),
    )
