"""Pose from landmarks: accuracy against OpenCV's solvers, coverage of the 95 % region, outliers, time.

Trials: a microscope (f = 12 800 px, 300 mm), points in 30x20x12 mm, rotations uniform over SO(3); with --case also
points on the surface that the case's frame shows, at its pose. Errors: the angle of the rotation error, and the mean
displacement of the whole surface in the image. Refused trials count in "all" with their best candidate. The solver
always assumes a click noise of 2 px. Times are for one processor core.
"""

import argparse
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path

import cv2

from oneframe.blender.render.engines import reference_view_of
from oneframe.case.case_file import read_case
from oneframe.case.loaded_case import load_case

from .alignment.landmark_accuracy import LandmarkFigures, VisibleSurface, measure_landmarks
from .alignment.landmark_trials import MICROSCOPE, box_trial
from .alignment.posterior_trials import clicks_needed, coverages
from .charts.landmark_chart import landmark_accuracy_charts
from .figures import expected, read_figures, write_figures

CLICKED_TRIALS = 40
QUICK = {"trials": 20, "noise_px": [2.0]}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this topic."""
    parser.add_argument("--trials", metavar="N", type=int, default=2000)
    parser.add_argument(
        "--noise-px", metavar="X", type=float, nargs="+", default=[1.0, 2.0, 4.0], help="true click noise"
    )
    parser.add_argument("--case", metavar="CASE.toml", type=Path)


def measure(arguments: argparse.Namespace, report: Callable[[str], None]) -> None:
    """Measure everything."""
    cv2.setNumThreads(1)
    surface = visible_surface(arguments.case) if arguments.case else None
    report("landmarks and image in one solve: coverage of the 95 % region")
    for row in coverages(box_trial, MICROSCOPE, arguments.trials, arguments.noise_px):
        report(f"  {row}")
    if surface is not None:
        clicks_needed(surface, min(arguments.trials, CLICKED_TRIALS), report)
    write_figures(arguments.out, asdict(measure_landmarks(arguments.trials, arguments.noise_px, surface, report)))


def draw(out: Path) -> list[Path]:
    """Draw the accuracy."""
    content = read_figures(out)
    with expected(out):
        figures = LandmarkFigures.of(content)
    return landmark_accuracy_charts(figures, out)


def visible_surface(case: Path) -> VisibleSurface:
    """The vertices of a case's surface that its frame shows."""
    source = reference_view_of(load_case(read_case(case)))
    seen = source.view.observed(source.mesh.vertices, source.mesh.vertex_normals)
    description = f"{case.name}: {seen.sum()} of {len(seen)} vertices seen"
    return VisibleSurface(description, source.view.camera, source.view.cam_from_model, source.mesh.vertices[seen])
