"""The refinement's basin of convergence, and how often it accepts a wrong pose: of a case, or of one of the options.

The initial pose is the true one, rotated about the middle of the visible surface and translated by a percentage of its
distance, both in random directions, on a grid of sizes; sizes of 0 start at the truth. Success on a case: within 1°
and 2 px (mean over the visible surface); on LM-O, whose true poses are 2-6 px off themselves, and on bloster: within
5 px ("2D projection", Brachmann et al. 2016). The errors that the refinement estimates are compared with the true
ones. Wrong images are the frame mirrored, upside down and rotated by 90 degrees: all must be refused. Writes a
table, FILE.csv, with a row for each trial, and its chart.
"""

import argparse
import sys
from collections.abc import Callable
from pathlib import Path

import bpy

from oneframe.errors import InputError
from oneframe.evaluation.conditions import current_conditions
from oneframe.progress import Progress

from .alignment.refinement_basin import RefinementTrial, disturbances, run_trials, summary
from .alignment.refinement_scenes import RefinementScene, bloster_scenes, case_scene, lmo_scenes
from .charts.pose_charts import refinement_chart
from .figures import read_rows, write_rows

QUICK = {"degrees": [2.0], "percent": [2.0], "trials": 1, "wrong": 1}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this topic."""
    source = parser.add_mutually_exclusive_group()
    source.add_argument("case", metavar="CASE.toml", type=Path, nargs="?")
    source.add_argument("--lmo", metavar="FOLDER", type=Path, help="LINEMOD-Occluded")
    source.add_argument("--bloster", metavar="FOLDER", type=Path, help="photographs of a cushion")
    parser.add_argument("--coloured", action="store_true", help="bloster: with colours from another photograph")
    parser.add_argument("--degrees", type=float, nargs="+", default=[1, 2, 5, 10, 15], help="sizes of the rotation")
    parser.add_argument("--percent", type=float, nargs="+", default=[1, 2, 5, 8], help="sizes of the translation")
    parser.add_argument("--trials", type=int, default=10, help="trials per cell of the grid")
    parser.add_argument("--wrong", type=int, default=5, help="trials with each wrong image")
    parser.add_argument("--seed", type=int, default=0)


def measure(arguments: argparse.Namespace, report: Callable[[str], None]) -> None:
    """Run all trials; write the table of the finished ones after each."""
    scenes = _scenes(arguments)
    planned = disturbances(arguments.degrees, arguments.percent, arguments.trials, arguments.wrong)
    conditions = current_conditions({"seed": arguments.seed}, blender=bpy.app.version_string)
    finished = []
    with Progress(len(planned), "trials", stream=sys.stderr) as progress:
        for trial in run_trials(scenes, planned, arguments.seed):
            finished.append(trial)
            write_rows(arguments.out, finished, conditions)
            progress.advance()
    report("\n".join(summary(finished)))


def draw(out: Path) -> list[Path]:
    """Draw the table."""
    return [refinement_chart(read_rows(out, RefinementTrial)[0], out)]


def _scenes(arguments: argparse.Namespace) -> list[RefinementScene]:
    if arguments.case:
        return [case_scene(arguments.case)]
    if arguments.lmo:
        return lmo_scenes(arguments.lmo)
    if arguments.bloster:
        return bloster_scenes(arguments.bloster, coloured=arguments.coloured)
    raise InputError("command line: expected a case file, --lmo or --bloster, found none")
