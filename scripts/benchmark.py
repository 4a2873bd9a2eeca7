"""Measure speed against PyVista, and scaling, memory and start-up, in one run on this machine.

    python scripts/benchmark.py [--quick] [--only NAME ...] [--out FILE.json]

All figures use the same surface (200 000 triangles), poses, K and 640x480 px. Times are medians; ratios compare
alternating runs, since machines are noisy. PyVista runs as users run it: off screen, RGB, in memory. --out also writes
a chart of the speed next to the file; --redraw draws it again from the file.
"""

import os
import sys
from pathlib import Path

# as render_dataset.py does, and before numpy is imported
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
# the repository's root: scripts are run from a checkout
sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import json
import tempfile
from collections.abc import Callable, Mapping, Sequence

from pipeline.blender.command_line import ArgumentParser, run_script
from pipeline.blender.dataset.job import available_cores
from pipeline.blender.evaluation.render_scaling import measure_anti_aliasing, measure_memory, measure_triangles
from pipeline.blender.evaluation.render_speed import measure_speed, measure_start, measure_workers
from pipeline.blender.process import own_output
from pipeline.blender.render.engines import keep_freed_memory
from pipeline.evaluation.charts.page import chart_outputs, require_matplotlib
from pipeline.evaluation.charts.render_speed_chart import render_speed_charts
from pipeline.evaluation.scenes.benchmark_case import VIEW_CAMERA
from pipeline.evaluation.trials.render_times import read_render_times
from pipeline.files.content import write_bytes_atomically
from pipeline.files.kinds import Kind, json_object
from pipeline.files.outputs import Output, check_outputs, made_folder, writing

NAMES = ("speed", "antialiasing", "scaling", "workers", "start", "memory")
FIGURES = Kind(
    "the figures of this script", lambda data: any(json_object(name)(data) for name in (*NAMES, "speed rounds"))
)
RENDER_SCRIPT = Path(__file__).with_name("render_dataset.py")

Figures = dict[str, Mapping[str, float] | Mapping[str, list[float]]]
"""What was measured, by the names on the command line; the times of all rounds as ``"speed rounds"``."""


def main(argv: Sequence[str]) -> int:
    parser = ArgumentParser(prog="benchmark.py", description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--only", nargs="+", choices=NAMES, default=NAMES, metavar="NAME", help=" ".join(NAMES))
    parser.add_argument("--quick", action="store_true", help="fewer rounds, 300 instead of 2000 views for memory")
    parser.add_argument("--out", type=Path, help="also write the figures to this JSON file, and a chart next to it")
    parser.add_argument(
        "--redraw", action="store_true", help="measure nothing; draw the chart again from the file --out"
    )
    arguments = parser.parse(argv)
    if arguments.redraw and arguments.out is None:
        parser.error("expected --out FILE with --redraw, found none")
    if arguments.out:
        require_matplotlib()
        # drawn again, the figures are an input
        named = {"figures": arguments.out} if arguments.redraw else {}
        check_outputs([*([] if named else [Output(arguments.out, FIGURES)]), *chart_outputs(arguments.out)], named)
    output = own_output()

    def report(text: str) -> None:
        output.write(text + "\n")
        output.flush()

    if not arguments.redraw:
        figures = measure(arguments.only, report, quick=arguments.quick)
        if arguments.out:
            with writing(made_folder(arguments.out)):
                write_bytes_atomically(arguments.out, (json.dumps(figures, indent=2) + "\n").encode())
    if arguments.out and (arguments.redraw or "speed" in figures):
        for path in render_speed_charts(read_render_times(arguments.out), arguments.out):
            report(str(path))
    return 0


def measure(names: Sequence[str], report: Callable[[str], None], *, quick: bool) -> Figures:
    """Run the named measurements in this order; the results by name."""
    keep_freed_memory()
    report(f"{available_cores()} cores, {VIEW_CAMERA.width}x{VIEW_CAMERA.height} px, 200 000 triangles")
    figures: Figures = {}
    speed = None
    with tempfile.TemporaryDirectory(prefix="oneframe-benchmark-") as name:
        folder = Path(name)
        measures: dict[str, Callable[[], dict[str, float]]] = {
            "antialiasing": lambda: measure_anti_aliasing(folder, report),
            "scaling": lambda: measure_triangles(folder, report),
            "workers": lambda: measure_workers(folder, RENDER_SCRIPT, report),
            "start": lambda: measure_start(folder, RENDER_SCRIPT, report),
            "memory": lambda: measure_memory(folder, report, views=300 if quick else 2000),
        }
        for key in names:
            report(f"{key}:")
            if key == "speed":
                speed = measure_speed(folder, RENDER_SCRIPT, report, rounds=2 if quick else 5)
                figures[key] = speed.medians_ms()
            else:
                figures[key] = measures[key]()
    if speed is not None:
        report("\n" + "\n".join(speed.table()))
        figures["speed rounds"] = speed.rounds_ms()
    return figures


if __name__ == "__main__":
    run_script(main)
