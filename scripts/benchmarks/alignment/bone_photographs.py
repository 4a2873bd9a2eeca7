"""Temporal bones from CT as cases, with path-traced photographs: their shape is real, paint and light are not."""

from pathlib import Path

import numpy as np

from oneframe.case.case_file import Case
from oneframe.files.content import write_bytes_atomically
from oneframe.images.pixel_values import to_uint8
from oneframe.images.png import encode_png
from oneframe.poses.distributions import ReferencePose
from oneframe.sample.temporal_bone import MICROSCOPE
from oneframe.surface.mesh_reader import read_mesh
from oneframe.transforms import camera_centre, rigid

from ..published import CaseFiles, written_case
from .side_lit_photographs import side_lit_photographs
from .side_lit_relief import Relief, SideLitShot

BONES = {"LT143": 1.0, "RT143": -1.0}
"""A specimen, and the sign of its lateral side along x, which points to the patient's left."""
CAMERA, DISTANCE_MM = MICROSCOPE.resized(640, 480), 300.0
TILTS_DEG, ROLLS_DEG = (0.0, 12.0, 16.0, 20.0, 25.0), (0.0, 8.0, -10.0, 15.0, -6.0)
WAVES_MM, WAVES = (0.8, 12.0), 200
"""Shortest and longest waves of the paint, and their number."""


def bone_cases(folder: Path, out: Path, *, most: int | None = None) -> list[CaseFiles]:
    """Write a case for each bone, seen from lateral; the others of its photographs tilt to all sides.

    ``folder`` holds ``ply/SPECIMEN/bone.ply``; ``most`` is the largest number of photographs besides the frame.

    Raises
    ------
    InputError
        A file is missing or holds something else.
    """
    written = []
    for name, side in BONES.items():
        path, rng = folder / "ply" / name / "bone.ply", np.random.default_rng(0)
        mesh = read_mesh(path)[0]
        centre = mesh.bounds.mean(axis=0)
        bone = mesh.moved(-centre)
        forward, down = np.array([-side, 0.0, 0.0]), np.array([0.0, 0.0, -1.0])
        lateral = rigid(np.stack([np.cross(down, forward), down, forward]), np.array([0.0, 0.0, DISTANCE_MM]))
        lengths = np.geomspace(*WAVES_MM, WAVES)
        waves = rng.normal(size=(WAVES, 3)) * (2 * np.pi / np.sqrt(3) / lengths)[:, None]
        paint = np.tanh(np.cos(bone.vertices @ waves.T + rng.uniform(0, 2 * np.pi, WAVES)).sum(axis=1) / np.sqrt(WAVES))
        relief = Relief(bone, np.array([0.5, 0.4, 0.3]) * (0.65 + 0.3 * paint[:, None]), bone)
        turns = 2 * np.pi * np.arange(len(TILTS_DEG)) / len(TILTS_DEG)
        reference, shots = ReferencePose(lateral, np.zeros(3)), []
        for tilt, roll, turn in zip(np.radians(TILTS_DEG), np.radians(ROLLS_DEG), turns, strict=True):
            pose = reference.orbit((tilt * np.cos(turn), tilt * np.sin(turn)), roll, DISTANCE_MM)
            shots.append(SideLitShot("lens", pose, camera_centre(pose) / DISTANCE_MM))
        shots, photographs = shots[: None if most is None else most + 1], []
        out.mkdir(parents=True, exist_ok=True)
        for number, image in enumerate(side_lit_photographs(relief, CAMERA, shots)):
            file = out / f"{name}_{number}.png"
            write_bytes_atomically(file, encode_png(to_uint8(image)))
            photographs.append((file, shots[number].cam_from_model @ rigid(translation=-centre)))
        case = Case(out / f"{name}.toml", 1.0, photographs[0][0], CAMERA, None, path, photographs[0][1])
        written.append(written_case(case, photographs[1:]))
    return written
