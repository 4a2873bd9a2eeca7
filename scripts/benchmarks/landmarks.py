"""Pose from landmarks: accuracy against OpenCV's solvers, coverage of the 95 % region, and refusals.

Trials: a microscope (f = 12 800 px, 300 mm), points in 30x20x12 mm, rotations uniform over SO(3); with --case also
points on the surface that the case's frame shows, at its pose. Errors: the angle of the rotation error, and the mean
displacement of the whole surface in the image. Refused trials count in "OneFrame" with their best candidate. The solver
always assumes a click noise of 2 px. Writes a table, FILE.csv, and its chart.
"""

import argparse
from collections.abc import Callable
from pathlib import Path

import bpy
import cv2

from oneframe.blender.render.engines import reference_view_of
from oneframe.camera.pinhole import PinholeCamera
from oneframe.case.case_file import read_case
from oneframe.case.loaded_case import load_case
from oneframe.evaluation.conditions import current_conditions

from .alignment.landmark_accuracy import DrawTrial, LandmarkRow, VisibleSurface, accuracies, line
from .alignment.landmark_trials import MICROSCOPE, box_trial
from .charts.pose_charts import landmark_chart
from .figures import read_rows, write_rows

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
    trials, noise_px = arguments.trials, arguments.noise_px
    sets: list[tuple[str, DrawTrial, PinholeCamera]] = [("random points", box_trial, MICROSCOPE)]
    if arguments.case:
        surface = visible_surface(arguments.case)
        sets.append((f"surface of {arguments.case.name}", surface.draw, surface.camera))
    report(f"accuracy, {trials} trials each: rotation / displacement, median (95 %)")
    rows = []
    for name, draw_trial, camera in sets:
        for row in accuracies(name, draw_trial, camera, trials, noise_px):
            report(line(row))
            rows.append(row)
    write_rows(arguments.out, rows, current_conditions({"trials": trials}, blender=bpy.app.version_string))


def draw(out: Path) -> list[Path]:
    """Draw the accuracy."""
    return [landmark_chart(read_rows(out, LandmarkRow)[0], out)]


def visible_surface(case: Path) -> VisibleSurface:
    """The vertices of a case's surface that its frame shows."""
    source = reference_view_of(load_case(read_case(case)))
    seen = source.view.observed(source.mesh.vertices, source.mesh.vertex_normals)
    return VisibleSurface(source.view.camera, source.view.cam_from_model, source.mesh.vertices[seen])
