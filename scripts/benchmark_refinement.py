"""Measure the refinement's basin of convergence, and how often it accepts a wrong pose.

    python scripts/benchmark_refinement.py CASE.toml --out FOLDER
    python scripts/benchmark_refinement.py --lmo FOLDER_OF_LMO --out FOLDER
    python scripts/benchmark_refinement.py --bloster FOLDER_OF_BLOSTER [--coloured] --out FOLDER
    python scripts/benchmark_refinement.py --shadows 12 --degrees 0 --percent 0 --trials 12 --out FOLDER
    python scripts/benchmark_refinement.py --redraw --out FOLDER

The initial pose is the true one, rotated about the middle of the visible surface and translated by a percentage of its
distance, both in random directions, on a grid of sizes; sizes of 0 start at the truth. Success on a case: within 1°
and 2 px (mean over the visible surface); on LM-O, whose true poses are 2-6 px off themselves, on bloster and with
--shadows: within 5 px ("2D projection", Brachmann et al. 2016). --shadows renders a relief under a low sun, each frame
from another side: what it shows is mostly cast shadow. The errors that the refinement estimates are compared with the
true ones. Wrong images are the frame mirrored, upside down and rotated by 90 degrees: all must be refused. Writes
refinement.csv and its chart, refinement.svg and refinement.png; --redraw draws the chart again from refinement.csv.
"""

import os
import sys
from pathlib import Path

# before numpy is imported: the matrices are small, so BLAS threads cost more than they save
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
# the repository's root: scripts are run from a checkout
sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import argparse
from collections.abc import Sequence

import numpy as np

from pipeline.blender.command_line import ArgumentParser, run_script
from pipeline.blender.evaluation.side_lit_photographs import side_lit_scenes
from pipeline.case.case_file import read_case
from pipeline.evaluation.charts.page import chart_outputs, require_matplotlib
from pipeline.evaluation.charts.refinement_chart import refinement_charts
from pipeline.evaluation.scenes.refinement_scenes import RefinementScene, bloster_scenes, case_scene, lmo_scenes
from pipeline.evaluation.trials.refinement_basin import (
    disturbances,
    read_trials,
    run_trials,
    summary,
    trials_to_csv,
)
from pipeline.files.content import write_bytes_atomically
from pipeline.files.kinds import Kind, csv_table
from pipeline.files.outputs import check_outputs, companion, made_folder, writing
from pipeline.progress import Progress

TRIALS = Kind("the trials of this script", csv_table(trials_to_csv(()).decode().strip()))


def main(argv: Sequence[str]) -> int:
    parser = ArgumentParser(prog="benchmark_refinement.py", description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("case", metavar="CASE.toml", type=Path, nargs="?")
    parser.add_argument("--lmo", metavar="FOLDER", type=Path, help="LINEMOD-Occluded, instead of a case")
    parser.add_argument("--bloster", metavar="FOLDER", type=Path, help="photographs of a cushion, instead of a case")
    parser.add_argument("--coloured", action="store_true", help="bloster: with colours from another photograph")
    parser.add_argument("--shadows", metavar="N", type=int, help="N frames of a relief in a low sun, instead of a case")
    parser.add_argument("--out", metavar="FOLDER", type=Path, required=True)
    parser.add_argument("--degrees", type=float, nargs="+", default=[1, 2, 5, 10, 15], help="sizes of the rotation")
    parser.add_argument("--percent", type=float, nargs="+", default=[1, 2, 5, 8], help="sizes of the translation")
    parser.add_argument("--trials", type=int, default=10, help="trials per cell of the grid")
    parser.add_argument("--wrong", type=int, default=5, help="trials with each wrong image")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--redraw", action="store_true", help="measure nothing; draw the chart again from --out")
    arguments = parser.parse(argv)
    if arguments.shadows is not None and arguments.shadows < 1:
        parser.error(f"--shadows: expected at least 1 frame, found {arguments.shadows}")
    given = (arguments.case, arguments.lmo, arguments.bloster, arguments.shadows)
    if sum(source is not None for source in given) + arguments.redraw != 1:
        parser.error("expected exactly one of a case file, --lmo, --bloster, --shadows and --redraw")
    table = arguments.out / "refinement.csv"
    require_matplotlib()
    inputs = {"table": table} if arguments.redraw else {}
    if arguments.case:
        inputs |= read_case(arguments.case).input_files()
    own_table = [] if arguments.redraw else [companion(table, TRIALS, TRIALS.is_of)]
    check_outputs([*own_table, *chart_outputs(table)], inputs)
    if not arguments.redraw:
        measure(arguments, table)
    trials = read_trials(table)
    refinement_charts(trials, table)
    print("\n".join(summary(trials)))
    return 0


def measure(arguments: argparse.Namespace, table: Path) -> None:
    """Run all trials; write the table of the finished ones after each."""
    scenes: list[RefinementScene] = []
    if arguments.case:
        scenes = [case_scene(arguments.case)]
    elif arguments.lmo:
        scenes = lmo_scenes(arguments.lmo)
    elif arguments.shadows:
        with Progress(arguments.shadows, "frames", stream=sys.stderr) as progress:
            for scene in side_lit_scenes(np.random.default_rng(arguments.seed), arguments.shadows):
                scenes.append(scene)
                progress.advance()
    else:
        scenes = bloster_scenes(arguments.bloster, coloured=arguments.coloured)
    planned = disturbances(arguments.degrees, arguments.percent, arguments.trials, arguments.wrong)
    made_folder(table)
    finished = []
    with Progress(len(planned), "trials", stream=sys.stderr) as progress:
        for trial in run_trials(scenes, planned, arguments.seed):
            finished.append(trial)
            with writing(table):
                write_bytes_atomically(table, trials_to_csv(finished))
            progress.advance()


if __name__ == "__main__":
    run_script(main)
