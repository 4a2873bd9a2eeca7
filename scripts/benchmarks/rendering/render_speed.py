"""Speed as users experience it: the whole command against PyVista, with more workers, and until the first view."""

import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from oneframe.blender.dataset.job import Job, OpenJob, open_job
from oneframe.camera.pinhole import PinholeCamera
from oneframe.case.case_file import read_case
from oneframe.colour.reference_view import vertex_colours_of
from oneframe.dataset.layout import ViewPaths
from oneframe.dataset.options import DatasetOptions
from oneframe.dataset.run.run_folder import Shard
from oneframe.evaluation.baseline import pyvista_renderer
from oneframe.files.machine import available_cores
from oneframe.images.pixel_values import to_uint8
from oneframe.surface.mesh import TriangleMesh

from .benchmark_case import VIEW_CAMERA, write_benchmark_case
from .render_times import LIT_PEER, PLAIN_PEER, UNLIT_PEER, RenderTimes

RENDER_SCRIPT = Path(__file__).resolve().parents[2] / "render_dataset.py"
SCALE = 0.5
"""Scale of the views relative to the benchmark's frame: 640x480 px."""
BLOCK = 12
"""Number of views that PyVista renders in one round."""
DEPTH_RANGE_MM = (150.0, 450.0)
VIEWS, FIRST, LAST = 40, 10, 36
"""Number of views of a timed run; only those from ``FIRST`` to ``LAST`` count, while all workers run."""
EXACT = ("cycles", "raster")
"""The engines whose views are exact."""
OURS: dict[str, dict[str, object]] = {
    "exact, projective": {"colour": "projective"},
    "exact, projective, engine raster": {"colour": "projective", "engine": "raster"},
    "anti-aliased (4 rays), projective, engine raster": {"samples": 4, "engine": "raster"},
    "exact, texture": {"colour": "texture"},
    "exact, vertex": {"colour": "vertex"},
    "anti-aliased (8 rays), projective": {"colour": "projective", "samples": 8},
}
"""Names in the figures -> options of ``render_dataset.py``."""


def benchmark_job(case: Path, out: Path, *, samples: int = 1, engine: str = "cycles") -> OpenJob:
    """The job of a benchmark case at 640x480 px."""
    return open_job(Job(read_case(case), out, DatasetOptions(scale=SCALE, samples=samples, engine=engine), Shard()))


def measure_speed(folder: Path, report: Callable[[str], None], *, rounds: int) -> RenderTimes:
    """Compare the time of complete views on disk with PyVista's RGB in memory: alternating blocks of the same poses.

    Parameters
    ----------
    folder
        Folder for temporary files.
    rounds
        Number of rounds that count; an additional first one warms up caches and shaders.

    Raises
    ------
    RunError
        PyVista is not installed.
    """
    case = write_benchmark_case(folder / "speed")
    with benchmark_job(case, folder / "unused").renderer(threads=available_cores()) as renderer:
        poses = [renderer.plan(index).cam_from_model for index in range(BLOCK)]
        colours, _ = vertex_colours_of(renderer.source)
    peers = pyvista_peers(renderer.source.mesh, to_uint8(colours.rgb), VIEW_CAMERA, DEPTH_RANGE_MM)
    seconds: dict[str, list[float]] = {name: [] for name in (*peers, *OURS)}
    for number in range(rounds + 1):
        for name, render in peers.items():
            start = time.perf_counter()
            for pose in poses:
                render(pose)
            seconds[name].append((time.perf_counter() - start) / len(poses))
        for name, options in OURS.items():
            seconds[name].append(dataset_seconds(case, folder / f"out-{number}", options))
        report(
            f"  round {number} of {rounds}: "
            + ", ".join(f"{name} {each[-1] * 1e3:.0f} ms" for name, each in seconds.items())
        )
    return RenderTimes({name: tuple(each[1:]) for name, each in seconds.items()})


def pyvista_peers(
    mesh: TriangleMesh, codes: np.ndarray, camera: PinholeCamera, depth_range_mm: tuple[float, float]
) -> dict[str, Callable[[np.ndarray], np.ndarray]]:
    """PyVista's renderers of a surface with ``(V, 3)`` uint8 colours by name, from pose to image.

    Raises
    ------
    RunError
        PyVista is not installed.
    """
    return {
        name: pyvista_renderer(mesh, codes, camera, samples=samples, lit=lit, depth_range_mm=depth_range_mm)
        for name, samples, lit in ((LIT_PEER, 8, True), (UNLIT_PEER, 8, False), (PLAIN_PEER, 1, False))
    }


def dataset_seconds(case: Path, out: Path, options: dict[str, object]) -> float:
    """Seconds per view of a run with these options, from the times of the records on disk; removes the output."""
    shutil.rmtree(out, ignore_errors=True)
    flags = [f"--{name.replace('_', '-')}={value}" for name, value in options.items()]
    _run(case, out, f"--count={VIEWS}", *flags)
    written = sorted(_record_times(out, VIEWS))
    shutil.rmtree(out)
    return (written[LAST] - written[FIRST]) / (LAST - FIRST)


def measure_workers(folder: Path, report: Callable[[str], None]) -> dict[str, float]:
    """Milliseconds per view by number of processes."""
    case, figures = write_benchmark_case(folder / "workers"), {}
    for workers in dict.fromkeys((1, 2, available_cores())):
        seconds = dataset_seconds(case, folder / "workers-out", {"workers": workers})
        figures[f"{workers} workers"] = 1e3 * seconds
        report(f"  {workers} workers: {1e3 * seconds:.0f} ms per view")
    return figures


def measure_start(folder: Path, report: Callable[[str], None], *, rounds: int) -> dict[str, float]:
    """Seconds from the command to the first view on disk by engine, median of some runs."""
    case, figures, views = write_benchmark_case(folder / "start"), {}, 2
    for engine in EXACT:
        seconds = []
        for _ in range(rounds):
            out = folder / "start-out"
            before = time.time()
            _run(case, out, f"--count={views}", f"--engine={engine}")
            seconds.append(min(_record_times(out, views)) - before)
            shutil.rmtree(out)
        figures[f"seconds to the first view, {engine}"] = float(np.median(seconds))
        report(f"  {engine}: first view after {np.median(seconds):.1f} s")
    return figures


def _run(case: Path, out: Path, *flags: str) -> None:
    command = [sys.executable, str(RENDER_SCRIPT), str(case), "--out", str(out), f"--scale={SCALE}", *flags]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)


def _record_times(out: Path, views: int) -> list[float]:
    return [ViewPaths(out, index).file("frame").stat().st_mtime for index in range(views)]
