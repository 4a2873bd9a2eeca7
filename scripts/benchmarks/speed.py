"""Speed against PyVista, and start-up.

All figures use the same surface, K and 640x480 px. Times are medians of alternating rounds, since
machines are noisy. PyVista runs as users run it: off screen, RGB, in memory.
"""

import argparse
import shutil
import subprocess
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from oneframe.blender.render.engines import keep_freed_memory
from oneframe.dataset.layout import ViewPaths
from oneframe.files.machine import available_cores
from oneframe.files.temporary import temporary_folder

from .figures import write_figures
from .rendering.benchmark_case import TRIANGLES, VIEW_CAMERA, write_benchmark_case
from .rendering.render_accuracy import LIT_PEER, UNLIT_PEER, measure_scene, render_command, scene_peers
from .rendering.render_scenes import case_scene
from .rendering.speed_accuracy import FLOOR, Configuration

SCALE = 0.5
"""Scale of the views relative to the benchmark's frame."""
CONFIGURATIONS = (
    Configuration(),
    Configuration("raster"),
    Configuration("raster", samples=4),
    Configuration(colour="vertex"),
    Configuration(samples=8),
)
TIMED_VIEWS = 200
EXACT = ("cycles", "raster")
"""The engines whose views are exact."""
QUICK = {"rounds": 1, "triangles": 20_000}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this topic."""
    parser.add_argument(
        "--only", nargs="+", choices=MEASURES, default=MEASURES, metavar="NAME", help=" ".join(MEASURES)
    )
    parser.add_argument("--rounds", type=int, default=5, help="of the speed (default %(default)s)")
    parser.add_argument("--triangles", type=int, default=TRIANGLES, help="of the surface (default %(default)s)")


def measure(arguments: argparse.Namespace, report: Callable[[str], None]) -> None:
    """Run the named measurements in this order."""
    keep_freed_memory()
    report(f"{available_cores()} cores, {VIEW_CAMERA.width}x{VIEW_CAMERA.height} px, {arguments.triangles} triangles")
    figures: dict[str, dict[str, float]] = {}
    with temporary_folder() as folder:
        case = write_benchmark_case(folder / "case", arguments.triangles)
        for name in arguments.only:
            report(f"{name}:")
            figures[name] = MEASURES[name](case, folder, arguments)
            for what, value in figures[name].items():
                report(f"  {what}: {value:.6g}")
    write_figures(arguments.out, figures)


def speed(case: Path, folder: Path, arguments: argparse.Namespace) -> dict[str, float]:
    """Milliseconds of a view of each configuration and of PyVista, and their ratios."""
    scene = case_scene("bowl", case, None, views=TIMED_VIEWS, seed=0)
    points = measure_scene(scene, None, CONFIGURATIONS, scene_peers(scene), folder, arguments.rounds, lambda: None)
    ms = {point.name: point.ms for point in points if point.kind != FLOOR}
    ratios = {f"{name} / {peer}": ms[name] / ms[peer] for name in ms for peer in (LIT_PEER, UNLIT_PEER) if name != peer}
    return ms | ratios


def start(case: Path, folder: Path, arguments: argparse.Namespace) -> dict[str, float]:
    """Seconds from the command to the first view on disk by engine, median of some runs."""
    figures = {}
    for engine in EXACT:
        seconds = []
        for _ in range(min(arguments.rounds, 3)):
            out, before = folder / "start", time.time()
            command = render_command(case, out, f"--scale={SCALE}", "--count=2", f"--engine={engine}")
            subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
            seconds.append(min(ViewPaths(out, index).file("frame").stat().st_mtime for index in range(2)) - before)
            shutil.rmtree(out)
        figures[f"seconds to the first view, {engine}"] = float(np.median(seconds))
    return figures


MEASURES: dict[str, Callable[[Path, Path, argparse.Namespace], dict[str, float]]] = {
    "speed": speed,
    "start": start,
}
