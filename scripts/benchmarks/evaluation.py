"""This program and the paper's method on the sample and on published photographs, in one run.

Writes cases and lists of photographs into a temporary folder and does what `oneframe evaluate` does; --out gets the
evaluation.
The poses of bloster agree to 2 px, those of LM-O to 2 to 6 px. Pictures of data without a licence to publish them stay
out of the documentation.
--light compares views with the frame's shading, in the light of the lens, and with its shadows instead: on the sample,
from one frame and from four, at its held-out photographs and at poses of its film; and on the drilled --bones.
"""

import argparse
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from oneframe.blender.render.engines import RENDERERS
from oneframe.blender.sample.photograph import AMBIENT_STRENGTH, LAMP_OFFSET_MM, take_photographs
from oneframe.blender.sample.sample_case import HELD_OUT, write_sample_case
from oneframe.case.case_file import Case, read_case
from oneframe.case.case_writer import write_case
from oneframe.case.frame import UnreadFrame
from oneframe.errors import InputError
from oneframe.evaluation.evaluate import evaluation_run, run_evaluation
from oneframe.evaluation.methods import DEFAULT, chosen_methods
from oneframe.files.temporary import temporary_folder
from oneframe.light.lens_light import LensLight
from oneframe.registration.pose_list import read_photographs
from oneframe.sample.film import disturbance, film_poses
from oneframe.sample.temporal_bone import MICROSCOPE, SPACING_MM, SampleSurface, microscope_pose, sample_surface

from .alignment.bone_photographs import bone_cases, lit_bone_cases
from .published import LOADERS as PUBLISHED
from .published import CaseFiles, Loader, written_case

LOADERS: dict[str, Loader] = {**PUBLISHED, "bones": bone_cases}
QUICK = {"photographs": 2, "width": 240, "spacing_mm": 0.6}
IN_LIGHT = [
    f"projective{unseen}{light}-raster" for unseen in ("", "-fill") for light in ("", "-lens", "-shadows")
]  # fmt: skip
"""The methods of --light."""
FILM_STEP, FURTHER = 3, 3
"""Every third clear pose of the film is photographed; frames of the sample's second case besides its own."""
WIDE = (45, 328), (52, 345), (38, 280), (5, 148), (12, 148)
"""Tilts and azimuths, degrees, of further photographs: 20 to 35 degrees from the frame."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this topic."""
    for name in LOADERS:
        parser.add_argument(f"--{name}", metavar="FOLDER", type=Path, help=f"the data set {name}")
    parser.add_argument("--no-sample", action="store_true", help="leave out the sample case")
    parser.add_argument("--light", action="store_true", help="what the light at the lens is worth")
    parser.add_argument(
        "--methods", nargs="+", metavar="METHOD", help="as oneframe evaluate; of --light those in the light"
    )
    parser.add_argument("--inception", metavar="FILE.onnx", type=Path, help="as oneframe evaluate")
    parser.add_argument(
        "--photographs", metavar="N", type=int, help="of each case of a data set, and of --light, at most (default all)"
    )
    parser.add_argument("--width", metavar="PX", type=int, default=MICROSCOPE.width, help="of the sample's images")
    parser.add_argument("--spacing-mm", metavar="MM", type=float, default=SPACING_MM, help="of the sample's surface")
    parser.add_argument("--seed", type=int, default=0)


def measure(arguments: argparse.Namespace, report: Callable[[str], None]) -> None:
    """Evaluate."""
    with temporary_folder() as folder:
        files = lit_files(arguments, folder) if arguments.light else case_files(arguments, folder)
        if not files:
            report("left out: the sample and --bones have a lamp at their lens, neither is asked for")
            return
        methods = arguments.methods or (IN_LIGHT if arguments.light else DEFAULT)
        prepared = evaluation_run(
            files, arguments.out, chosen_methods(methods, RENDERERS),
            seed=arguments.seed, inception=arguments.inception,
        )  # fmt: skip
        for line in run_evaluation(prepared, stream=sys.stderr):
            report(line)


def case_files(arguments: argparse.Namespace, folder: Path) -> list[CaseFiles]:
    """Write the cases of all data sets that were named."""
    pairs = list[CaseFiles]()
    if not arguments.no_sample:
        pairs.append(sample_files(sample_surface(spacing_mm=arguments.spacing_mm), folder / "sample", arguments.width))
    for name, loader in LOADERS.items():
        if (given := getattr(arguments, name)) is not None:
            pairs += loader(given, folder / name, most=arguments.photographs)
    if not pairs:
        raise InputError("command line: expected a data set with --no-sample, found none")
    return pairs


def sample_files(surface: SampleSurface, folder: Path, width: int) -> CaseFiles:
    """Write the sample's case and its held-out photographs, ``width`` px wide."""
    camera = MICROSCOPE.resized(width, width * MICROSCOPE.height // MICROSCOPE.width)
    for _ in write_sample_case(folder, surface, camera=camera):
        pass
    path = folder / "case.toml"
    write_case(path, replace(read_case(path), object_name="sample (rendered)"))
    return path, folder / HELD_OUT


def lit_files(arguments: argparse.Namespace, folder: Path) -> list[CaseFiles]:
    """Write the cases that know the lamp at their lens: the sample, with its frame and with further ones, and bones."""
    pairs = []
    if not arguments.no_sample:
        surface = sample_surface(spacing_mm=arguments.spacing_mm)
        path, held_out = sample_files(surface, folder / "sample", arguments.width)
        case = lit_case(path)
        most = arguments.photographs
        poses = [pose for number, pose in enumerate(film_poses()) if not disturbance(number)][::FILM_STEP][:most]
        wide = [microscope_pose(tilt_deg, azimuth_deg, 0, 300) for tilt_deg, azimuth_deg in WIDE[:most]]
        (folder / "sample" / "film").mkdir()
        shots = [(pose, folder / "sample" / "film" / f"{number:02d}.png") for number, pose in enumerate(poses + wide)]
        list(take_photographs(surface, case.camera, shots))
        film = [UnreadFrame(image, case.camera, None, pose) for pose, image in shots]
        further = film[: len(poses) : -(-len(poses) // FURTHER)]
        held = read_photographs(held_out, case)[0][:most]
        listed = [(each.image, each.cam_from_mesh) for each in (*held, *film) if each not in further]
        for name, frames in (("one", ()), ("four", further)):
            named = replace(case, path=path.with_name(f"sample_{name}.toml"), frames=tuple(frames))
            pairs.append(written_case(named, listed))
    if arguments.bones is not None:
        pairs += lit_bone_cases(arguments.bones, folder / "lit", most=arguments.photographs)
    return pairs


def lit_case(path: Path) -> Case:
    """The sample's case with the lamp that its photographs have."""
    x, y, z = LAMP_OFFSET_MM.tolist()
    return replace(read_case(path), light=LensLight((x, y, z), AMBIENT_STRENGTH))
