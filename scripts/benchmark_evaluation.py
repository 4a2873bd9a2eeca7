"""Evaluate this program and the paper's method on the sample and on published photographs, in one run.

    python scripts/benchmark_evaluation.py --out FOLDER [--quick]
    python scripts/benchmark_evaluation.py --bloster FOLDER --lmo FOLDER --stereo FOLDER --out FOLDER

Writes cases and lists of photographs into a temporary folder and does what evaluate.py does; --out gets the evaluation.
The poses of bloster agree to 2 px, those of LM-O to 2 to 6 px. Pictures of data without a licence to publish them stay
out of the documentation. --quick takes two photographs of each case and a smaller sample.
"""

import os
import sys
from pathlib import Path

# before numpy is imported: the matrices are small, so BLAS threads cost more than they save
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
# the repository's root: scripts are run from a checkout
sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import argparse
import tempfile
from collections.abc import Sequence

from pipeline.blender.command_line import ArgumentParser, run_script
from pipeline.blender.evaluation.evaluation_run import evaluation_run, run_evaluation
from pipeline.blender.evaluation.methods import DEFAULT, chosen_methods
from pipeline.blender.process import own_output
from pipeline.blender.sample.sample_case import HELD_OUT, write_sample_case
from pipeline.evaluation.scenes.evaluation_scenes import LOADERS, CaseFiles
from pipeline.sample.temporal_bone import MICROSCOPE, sample_surface

QUICK_PHOTOGRAPHS = 2
QUICK_WIDTH, QUICK_HEIGHT = 240, 180


def main(argv: Sequence[str]) -> int:
    parser = ArgumentParser(prog="benchmark_evaluation.py", description=(__doc__ or "").partition("\n")[0])
    for name in LOADERS:
        parser.add_argument(f"--{name}", metavar="FOLDER", type=Path, help=f"the data set {name}")
    parser.add_argument("--no-sample", action="store_true", help="leave out the sample case")
    parser.add_argument("--methods", nargs="+", metavar="METHOD", default=DEFAULT, help="as evaluate.py")
    parser.add_argument("--inception", metavar="FILE.onnx", type=Path, help="as evaluate.py")
    parser.add_argument("--quick", action="store_true", help="two photographs of each case, and a smaller sample")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--pictures", type=int, default=2, help="as evaluate.py")
    parser.add_argument("--out", metavar="FOLDER", type=Path, required=True)
    arguments = parser.parse(argv)
    if arguments.no_sample and not any(getattr(arguments, name) for name in LOADERS):
        parser.error("expected a data set with --no-sample, found none")
    methods = chosen_methods(arguments.methods)
    output = own_output()
    with tempfile.TemporaryDirectory(prefix="oneframe-evaluation-") as name:
        prepared, inputs = evaluation_run(
            case_files(arguments, Path(name)), arguments.out, methods,
            seed=arguments.seed, inception=arguments.inception, pictures=arguments.pictures,
        )  # fmt: skip
        for line in run_evaluation(prepared, inputs, stream=sys.stderr):
            output.write(line + "\n")
    return 0


def case_files(arguments: argparse.Namespace, folder: Path) -> list[CaseFiles]:
    """Write the cases of all data sets that were named."""
    most = QUICK_PHOTOGRAPHS if arguments.quick else None
    pairs = []
    if not arguments.no_sample:
        camera = MICROSCOPE.resized(QUICK_WIDTH, QUICK_HEIGHT) if arguments.quick else MICROSCOPE
        for _ in write_sample_case(folder / "sample", sample_surface(), camera=camera):
            pass
        pairs.append((folder / "sample" / "case.toml", folder / "sample" / HELD_OUT))
    for name, loader in LOADERS.items():
        if (given := getattr(arguments, name)) is not None:
            pairs += loader(given, folder / name, most=most)
    return pairs


if __name__ == "__main__":
    run_script(main)
