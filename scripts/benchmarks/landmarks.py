"""Pose from landmarks: accuracy against OpenCV's solvers, coverage of the 95 % region, and refusals.

Trials: a microscope (f = 12 800 px, 300 mm), points in 30x20x12 mm, rotations uniform over SO(3). Errors: the angle of
the rotation error, and the mean displacement of the whole surface in the image. Refused trials count in "OneFrame" with
their best candidate. The solver always assumes a click noise of 2 px. Writes a table, FILE.csv, and its chart.
"""

import argparse
from collections.abc import Callable, Iterator
from pathlib import Path

import bpy
import cv2
import numpy as np

from oneframe.evaluation.conditions import current_conditions

from .alignment.landmark_trials import ACCEPTED, ALL, LandmarkRow, PoseErrors, box_trial, run_trials
from .charts.pose_charts import landmark_chart
from .figures import read_rows, write_rows

QUICK = {"trials": 20, "noise_px": [2.0]}
ASSUMED_SIGMA_PX = 2.0
"""Click noise that the solver assumes, whatever the true one is."""
COUNTS = (4, 6, 8, 10)
"""Numbers of correspondences."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this topic."""
    parser.add_argument("--trials", metavar="N", type=int, default=2000, help="(default 2000)")
    parser.add_argument(
        "--noise-px", metavar="X", type=float, nargs="+", default=[1.0, 2.0, 4.0], help="true click noise"
    )


def measure(arguments: argparse.Namespace, report: Callable[[str], None]) -> None:
    """Measure everything."""
    cv2.setNumThreads(1)
    report(f"accuracy, {arguments.trials} trials each: rotation / displacement, median (95 %)")
    rows = []
    for sigma_px in arguments.noise_px:
        for count in COUNTS:
            for row in accuracies(count, sigma_px, arguments.trials):
                report(
                    f"  {row.pairs} pairs, {row.sigma_px:g} px, {row.solver}: {row.rotation_deg:.2f} "
                    f"({row.rotation_deg_95:.2f})° / {row.surface_px:.2f} ({row.surface_px_95:.2f}) px; refused "
                    f"{row.refused}; coverage {row.coverage:.1%}"
                )
                rows.append(row)
    write_rows(arguments.out, rows, current_conditions({"trials": arguments.trials}, blender=bpy.app.version_string))


def draw(out: Path) -> list[Path]:
    """Draw the accuracy."""
    return [landmark_chart(read_rows(out, LandmarkRow)[0], out)]


def accuracies(count: int, sigma_px: float, trials: int) -> Iterator[LandmarkRow]:
    """A row for each solver; each number of pairs and click noise has its own random generator."""
    rng = np.random.default_rng([count, int(10 * sigma_px)])
    ours, peers = run_trials(lambda: box_trial(rng, count, sigma_px), trials, click_sigma_px=ASSUMED_SIGMA_PX)
    for solver, errors in {ALL: ours, ACCEPTED: ours, **peers}.items():
        figures = _figures(errors, solver == ACCEPTED)
        yield LandmarkRow("random points", count, sigma_px, solver, trials, *figures)


def _figures(errors: PoseErrors, accepted: bool) -> tuple[float, float, float, float, int, float]:
    angles, shifts = (errors.quantiles(each, accepted=accepted) for each in (errors.rotation_deg, errors.mesh_px))
    return *angles, *shifts, sum(refusal is not None for refusal in errors.refusals), errors.coverage
