"""Find the pose of a frame from landmarks, and say how sure it is; or refine it against the image.

    python scripts/align.py CASE.toml [--pairs PAIRS.csv] [--refine] [--out CASE] [--json JSON] [--picture PNG]

Landmarks are those of --pairs (CSV or JSON: name, point of the mesh file, pixel of the undistorted frame), or else the
case file's own. Prints the pose in both directions, the residual of every pair and the uncertainty. The case's pose may
be rough: it only decides where two poses fit equally well. Exit code 2: the pairs do not determine a pose.
"""

import sys
from pathlib import Path

# Blender puts neither the script's folder nor the current one on the module path
sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import datetime
import json
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TextIO

import numpy as np

from pipeline import __version__
from pipeline.blender.alignment.frame_overlay import frame_overlay
from pipeline.blender.case.load_case import load_case
from pipeline.blender.command_line import ArgumentParser, own_output, run_script
from pipeline.case.case_file import Case, read_case
from pipeline.case.case_writer import write_case
from pipeline.case.landmark_file import read_landmarks
from pipeline.case.loaded_case import LoadedCase
from pipeline.errors import InputError, RunError
from pipeline.files.content import write_bytes_atomically
from pipeline.images.pixel_values import to_uint8
from pipeline.images.png import encode_png
from pipeline.surface.mesh_reader import read_mesh
from pipeline.transforms import inverse_rigid

try:
    from pipeline.alignment.landmarks.picture import marked
    from pipeline.alignment.landmarks.report import (
        Alignment,
        alignment_record,
        complete_landmarks,
        off_surface,
        pose_lines,
        pose_table,
        report_lines,
        report_table,
    )
    from pipeline.alignment.landmarks.solver import solve_pose
    from pipeline.alignment.refinement.refine import refine_pose
except ModuleNotFoundError as error:  # a Blender program without the extension
    if error.name != "cv2":
        raise
    HAS_OPENCV = False
else:
    HAS_OPENCV = True


def main(argv: Sequence[str]) -> int:
    parser = ArgumentParser(prog="align.py", description=__doc__.splitlines()[0], epilog=__doc__.split("\n\n")[-1])
    parser.add_argument("case", metavar="CASE.toml", type=Path)
    parser.add_argument("--pairs", metavar="FILE", type=Path, help="landmarks as CSV or JSON (default: the case's own)")
    parser.add_argument("--out", metavar="FILE", type=Path, help="write the case with its new pose and these landmarks")
    parser.add_argument("--json", metavar="FILE", type=Path, help="write pose, residuals and covariance")
    parser.add_argument("--picture", metavar="FILE", type=Path, help="write the frame with overlay and residuals (PNG)")
    parser.add_argument(
        "--click-sigma-px", metavar="X", type=float, default=2.0,
        help="standard deviation of a click in each image direction (default 2)",
    )  # fmt: skip
    parser.add_argument(
        "--refine", action="store_true",
        help="fit the surface to the image, from the landmarks' pose or, without landmarks, the case's",
    )  # fmt: skip
    arguments = parser.parse(argv)
    if not HAS_OPENCV:
        raise RunError(
            "expected OpenCV, which solves for the pose, this Blender has none; run the script with the Python of "
            "`make setup`, or in a Blender in which the OneFrame extension, which brings it, is enabled"
        )
    output = own_output()
    case = read_case(arguments.case)
    if arguments.pairs:
        case = replace(case, landmarks=read_landmarks(arguments.pairs, mm_per_unit=case.mm_per_unit))
    tool, today = f"OneFrame {__version__}, align.py", datetime.date.today().isoformat()
    alignment, messages = None, []
    if complete_landmarks(case.landmarks) or not arguments.refine:
        alignment = aligned(case, arguments.click_sigma_px)
        # before the rest of the case, whose pose would be blamed for landmarks of another mesh
        messages = [*landmarks_off_surface(alignment, case), *alignment.estimate.messages]
        record = alignment_record(alignment, tool, today)
        case = replace(case, cam_from_mesh=alignment.estimate.cam_from_model, alignment=record)
        output.write("\n".join(report_lines(alignment)) + "\n")
    loaded = load_case(case, aligned=alignment is not None)
    for sentence in (*loaded.messages, *messages):
        output.write(f"note: {sentence}\n")
    if arguments.refine:
        case, loaded = refined(loaded, {"method": "refined", "tool": tool, "date": today}, output, alignment is None)
    if arguments.json:
        table = report_table(alignment) if alignment else {}
        text = json.dumps({**table, **pose_table(case.cam_from_mesh)}, indent=2, allow_nan=False) + "\n"
        written(arguments.json, lambda path: write_bytes_atomically(path, text.encode()))
    if arguments.picture:
        overlay = frame_overlay(loaded)
        picture = encode_png(to_uint8(marked(overlay, alignment) if alignment else overlay))
        written(arguments.picture, lambda path: write_bytes_atomically(path, picture))
        drawn = "frame, overlay, residuals (10 times their length), 95 % ellipses" if alignment else "frame, overlay"
        output.write(f"{drawn}: {arguments.picture}\n")
    if arguments.out:
        written(arguments.out, lambda path: write_case(path, case))
        output.write(f"aligned case: {arguments.out}\n")
    output.flush()
    return 0


def refined(loaded: LoadedCase, record: dict[str, object], output: TextIO, needed: bool) -> tuple[Case, LoadedCase]:
    """Fit the surface to the image; where that is not believable the pose stays, and is refused if it is ``needed``."""
    result = refine_pose(loaded.image, loaded.valid, loaded.case.camera, loaded.mesh, loaded.cam_from_model)
    if not result.accepted:
        if needed:
            raise InputError(f"{loaded.case.path.name}: {result.message}")
        output.write(f"note: {result.message}\n")
        return loaded.case, loaded
    cam_from_mesh = result.cam_from_model @ inverse_rigid(loaded.mesh_from_model)
    output.write("\n".join([result.message, *pose_lines(cam_from_mesh)]) + "\n")
    case = replace(loaded.case, cam_from_mesh=cam_from_mesh, alignment=record)
    return case, replace(loaded, case=case, cam_from_model=result.cam_from_model)


def aligned(case: Case, click_sigma_px: float) -> "Alignment":
    """Solve the landmarks of a case, in the frame of its mesh file."""
    used = complete_landmarks(case.landmarks)
    estimate = solve_pose(
        np.array([landmark.point for landmark in used]),
        np.array([landmark.pixel for landmark in used]),
        case.camera,
        click_sigma_px=click_sigma_px,
        start=case.cam_from_mesh,
        names=[landmark.name for landmark in used],
    )
    return Alignment(used, case.camera, estimate, click_sigma_px)


def landmarks_off_surface(alignment: "Alignment", case: Case) -> list[str]:
    """Sentences on landmarks that do not lie on the surface; refused if none does."""
    mesh, _ = read_mesh(case.mesh)
    off = off_surface(alignment, mesh.scaled(case.mm_per_unit))
    if len(off) == len(alignment.landmarks):
        raise InputError(
            f"landmarks: expected points on {case.mesh.name}, all lie beside it, {min(off.values()):.3g} mm and more "
            "from its nearest vertex; were they picked on this mesh, in this frame and unit?"
        )
    return [
        f"{name!r} lies {distance:.3g} mm from the nearest vertex of {case.mesh.name}: was it picked on this mesh?"
        for name, distance in off.items()
    ]


def written(path: Path, write: Callable[[Path], None]) -> None:
    """Write a file that the user named."""
    try:
        write(path)
    except OSError as error:
        raise RunError(f"{path}: cannot write it ({error.strerror}); name another place") from None


if __name__ == "__main__":
    run_script(main)
