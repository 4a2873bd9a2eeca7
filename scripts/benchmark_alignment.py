"""Measure the pose solver: accuracy against OpenCV's solvers, coverage of the 95 % region, outliers, time.

    python scripts/benchmark_alignment.py [--trials 2000] [--noise-px 2] [--case CASE.toml] [--out FILE.json]

Trials: a microscope (f = 12 800 px, 300 mm), points in 30x20x12 mm, rotations uniform over SO(3); with --case also
points on the surface that the case's frame shows, at its pose. Errors: the angle of the rotation error, and the mean
displacement of the whole surface in the image. Refused trials count in "all" with their best candidate. The solver
always assumes a click noise of 2 px. Times are for one processor core. --out also writes charts next to the file;
--redraw draws them again from the file.
"""

import os
import sys
from pathlib import Path

# one thread: the times must not depend on the number of cores
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
# the repository's root: scripts are run from a checkout
sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from collections.abc import Sequence

import cv2

from pipeline.blender.case.load_case import load_case
from pipeline.blender.colour.reference_view import reference_view_of
from pipeline.blender.command_line import ArgumentParser, run_script
from pipeline.blender.process import own_output
from pipeline.case.case_file import read_case
from pipeline.evaluation.charts.landmark_chart import case_chart, landmark_accuracy_charts
from pipeline.evaluation.charts.page import chart_outputs, require_matplotlib
from pipeline.evaluation.trials.landmark_accuracy import (
    VisibleSurface,
    figures_to_json,
    measure_landmarks,
    read_figures,
)
from pipeline.files.content import write_bytes_atomically
from pipeline.files.kinds import Kind, json_object
from pipeline.files.outputs import Output, check_outputs, made_folder, writing

FIGURES = Kind("the figures of this script", json_object("trials", "box", "time"))


def main(argv: Sequence[str]) -> int:
    parser = ArgumentParser(prog="benchmark_alignment.py", description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--trials", metavar="N", type=int, default=2000)
    parser.add_argument(
        "--noise-px", metavar="X", type=float, nargs="+", default=[1.0, 2.0, 4.0], help="true click noise"
    )
    parser.add_argument("--case", metavar="CASE.toml", type=Path)
    parser.add_argument("--out", metavar="FILE", type=Path, help="write all figures as JSON, and charts next to it")
    parser.add_argument("--redraw", action="store_true", help="measure nothing; draw the charts again from --out")
    arguments = parser.parse(argv)
    if arguments.redraw and arguments.out is None:
        parser.error("expected --out FILE with --redraw, found none")
    if arguments.out:
        require_matplotlib()
        # drawn again, the figures are an input
        inputs = {"figures": arguments.out} if arguments.redraw else {}
        if arguments.case:
            inputs |= read_case(arguments.case).input_files()
        charts = [*chart_outputs(arguments.out), *chart_outputs(case_chart(arguments.out))]
        check_outputs([*([] if arguments.redraw else [Output(arguments.out, FIGURES)]), *charts], inputs)
    cv2.setNumThreads(1)
    output = own_output()

    def report(line: str) -> None:
        output.write(line + "\n")
        output.flush()

    if not arguments.redraw:
        surface = visible_surface(arguments.case) if arguments.case else None
        figures = measure_landmarks(arguments.trials, arguments.noise_px, surface, report)
        if arguments.out:
            with writing(made_folder(arguments.out)):
                write_bytes_atomically(arguments.out, figures_to_json(figures))
    if arguments.out:
        for path in landmark_accuracy_charts(read_figures(arguments.out), arguments.out):
            report(str(path))
    return 0


def visible_surface(case: Path) -> VisibleSurface:
    """The vertices of a case's surface that its frame shows."""
    source = reference_view_of(load_case(read_case(case)))
    seen = source.view.observed(source.mesh.vertices, source.mesh.vertex_normals)
    description = f"{case.name}: {seen.sum()} of {len(seen)} vertices seen"
    return VisibleSurface(description, source.view.camera, source.view.cam_from_model, source.mesh.vertices[seen])


if __name__ == "__main__":
    run_script(main)
