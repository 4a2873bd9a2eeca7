"""This program and the paper's method on the sample and on published photographs, in one run.

Writes cases and lists of photographs into a temporary folder and does what `oneframe evaluate` does; --out gets the
evaluation.
The poses of bloster agree to 2 px, those of LM-O to 2 to 6 px. Pictures of data without a licence to publish them stay
out of the documentation.
"""

import argparse
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from oneframe.blender.render.engines import RENDERERS
from oneframe.blender.sample.sample_case import HELD_OUT, write_sample_case
from oneframe.case.case_file import read_case
from oneframe.case.case_writer import write_case
from oneframe.errors import InputError
from oneframe.evaluation.evaluation_files import evaluation_run, run_evaluation
from oneframe.evaluation.methods import DEFAULT, chosen_methods
from oneframe.files.temporary import temporary_folder
from oneframe.sample.temporal_bone import MICROSCOPE, sample_surface

from .alignment.bone_photographs import bone_cases
from .published import LOADERS as PUBLISHED
from .published import CaseFiles, Loader

LOADERS: dict[str, Loader] = {**PUBLISHED, "bones": bone_cases}
QUICK = {"photographs": 2, "width": 240}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this topic."""
    for name in LOADERS:
        parser.add_argument(f"--{name}", metavar="FOLDER", type=Path, help=f"the data set {name}")
    parser.add_argument("--no-sample", action="store_true", help="leave out the sample case")
    parser.add_argument("--methods", nargs="+", metavar="METHOD", default=DEFAULT, help="as oneframe evaluate")
    parser.add_argument("--inception", metavar="FILE.onnx", type=Path, help="as oneframe evaluate")
    parser.add_argument("--photographs", metavar="N", type=int, help="of each case of a data set at most (default all)")
    parser.add_argument("--width", metavar="PX", type=int, default=MICROSCOPE.width, help="of the sample's images")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--pictures", type=int, default=2, help="as oneframe evaluate")


def measure(arguments: argparse.Namespace, report: Callable[[str], None]) -> None:
    """Evaluate."""
    with temporary_folder() as folder:
        prepared = evaluation_run(
            case_files(arguments, folder), arguments.out, chosen_methods(arguments.methods, RENDERERS),
            seed=arguments.seed, inception=arguments.inception, pictures=arguments.pictures,
        )  # fmt: skip
        for line in run_evaluation(prepared, stream=sys.stderr):
            report(line)


def case_files(arguments: argparse.Namespace, folder: Path) -> list[CaseFiles]:
    """Write the cases of all data sets that were named."""
    pairs = []
    if not arguments.no_sample:
        camera = MICROSCOPE.resized(arguments.width, arguments.width * MICROSCOPE.height // MICROSCOPE.width)
        for _ in write_sample_case(folder / "sample", sample_surface(), camera=camera):
            pass
        path = folder / "sample" / "case.toml"
        write_case(path, replace(read_case(path), object_name="sample (rendered)"))
        pairs.append((path, folder / "sample" / HELD_OUT))
    for name, loader in LOADERS.items():
        if (given := getattr(arguments, name)) is not None:
            pairs += loader(given, folder / name, most=arguments.photographs)
    if not pairs:
        raise InputError("command line: expected a data set with --no-sample, found none")
    return pairs
