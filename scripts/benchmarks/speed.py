"""Speed against PyVista, anti-aliasing, scaling, memory and start-up.

All figures use the same surface (200 000 triangles), poses, K and 640x480 px. Times are medians; ratios compare
alternating runs, since machines are noisy. PyVista runs as users run it: off screen, RGB, in memory.
"""

import argparse
from collections.abc import Callable
from pathlib import Path

from oneframe.blender.render.engines import keep_freed_memory
from oneframe.files.machine import available_cores
from oneframe.files.temporary import temporary_folder

from .charts.render_speed_chart import render_speed_charts
from .figures import expected, read_figures, write_figures
from .rendering.benchmark_case import VIEW_CAMERA
from .rendering.render_scaling import measure_anti_aliasing, measure_memory, measure_triangles
from .rendering.render_speed import measure_speed, measure_start, measure_workers
from .rendering.render_times import RenderTimes

NAMES = ("speed", "antialiasing", "scaling", "workers", "start", "memory")
ROUNDS = "speed rounds"
"""In the file of figures: the times of all rounds."""
QUICK = {"rounds": 2, "views": 300}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this topic."""
    parser.add_argument("--only", nargs="+", choices=NAMES, default=NAMES, metavar="NAME", help=" ".join(NAMES))
    parser.add_argument("--rounds", type=int, default=5, help="of the speed (default %(default)s)")
    parser.add_argument("--views", type=int, default=2000, help="for the memory (default %(default)s)")


def measure(arguments: argparse.Namespace, report: Callable[[str], None]) -> None:
    """Run the named measurements in this order."""
    keep_freed_memory()
    report(f"{available_cores()} cores, {VIEW_CAMERA.width}x{VIEW_CAMERA.height} px, 200 000 triangles")
    figures: dict[str, object] = {}
    with temporary_folder() as folder:
        measures = {
            "antialiasing": lambda: measure_anti_aliasing(folder, report),
            "scaling": lambda: measure_triangles(folder, report),
            "workers": lambda: measure_workers(folder, report),
            "start": lambda: measure_start(folder, report, rounds=min(arguments.rounds, 3)),
            "memory": lambda: measure_memory(folder, report, views=arguments.views),
        }
        for name in arguments.only:
            report(f"{name}:")
            if name != "speed":
                figures[name] = measures[name]()
                continue
            times = measure_speed(folder, report, rounds=arguments.rounds)
            report("\n".join(times.table()))
            figures |= {name: times.medians_ms(), ROUNDS: times.rounds_ms()}
    write_figures(arguments.out, figures)


def draw(out: Path) -> list[Path]:
    """Draw the speed relative to PyVista's, if it was measured."""
    figures = read_figures(out)
    if ROUNDS not in figures:
        return []
    with expected(out):
        return render_speed_charts(RenderTimes.of_ms(figures[ROUNDS]), out)
