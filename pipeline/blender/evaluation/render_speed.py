"""Speed as users experience it: the whole command against PyVista, with more workers, and until the first view."""

import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from ...case.case_file import read_case
from ...dataset.folder import Shard
from ...dataset.layout import ViewPaths
from ...dataset.options import DatasetOptions
from ...evaluation.baseline.pyvista_baseline import pyvista_renderer
from ...evaluation.scenes.benchmark_case import VIEW_CAMERA, write_benchmark_case
from ...evaluation.trials.render_times import LIT_PEER, PLAIN_PEER, UNLIT_PEER, RenderTimes
from ...images.pixel_values import to_uint8
from ..colour.reference_view import vertex_colours_of
from ..dataset.job import Job, OpenJob, available_cores, open_job

SCALE = 0.5
"""Scale of the views relative to the benchmark's frame: 640x480 px."""
BLOCK = 12
"""Number of views that PyVista renders in one round."""
DEPTH_RANGE_MM = (150.0, 450.0)
VIEWS, FIRST, LAST = 40, 10, 36
"""Number of views of a timed run; only those from ``FIRST`` to ``LAST`` count, while all workers run."""
OURS: dict[str, dict[str, object]] = {
    "exact, projective": {"colour": "projective"},
    "exact, projective, engine raster": {"colour": "projective", "engine": "raster"},
    "exact, texture": {"colour": "texture"},
    "exact, vertex": {"colour": "vertex"},
    "anti-aliased (8 rays), projective": {"colour": "projective", "samples": 8},
}
"""Names in the figures -> options of ``render_dataset.py``."""


def benchmark_job(case: Path, out: Path, *, samples: int = 1) -> OpenJob:
    """The job of a benchmark case at 640x480 px."""
    return open_job(Job(read_case(case), out, DatasetOptions(scale=SCALE, samples=samples), Shard()))


def measure_speed(folder: Path, render_script: Path, report: Callable[[str], None], *, rounds: int) -> RenderTimes:
    """Compare the time of complete views on disk with PyVista's RGB in memory: alternating blocks of the same poses.

    Parameters
    ----------
    folder
        Folder for temporary files.
    render_script
        ``render_dataset.py``, run as a command.
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
    mesh, codes = renderer.source.mesh, to_uint8(colours.rgb)
    peers = {
        name: pyvista_renderer(mesh, codes, VIEW_CAMERA, samples=samples, lit=lit, depth_range_mm=DEPTH_RANGE_MM)
        for name, samples, lit in ((LIT_PEER, 8, True), (UNLIT_PEER, 8, False), (PLAIN_PEER, 1, False))
    }
    seconds: dict[str, list[float]] = {name: [] for name in (*peers, *OURS)}
    for number in range(rounds + 1):
        for name, render in peers.items():
            start = time.perf_counter()
            for pose in poses:
                render(pose)
            seconds[name].append((time.perf_counter() - start) / len(poses))
        for name, options in OURS.items():
            seconds[name].append(dataset_seconds(render_script, case, folder / f"out-{number}", options))
        report(
            f"  round {number} of {rounds}: "
            + ", ".join(f"{name} {each[-1] * 1e3:.0f} ms" for name, each in seconds.items())
        )
    return RenderTimes({name: tuple(each[1:]) for name, each in seconds.items()})


def dataset_seconds(render_script: Path, case: Path, out: Path, options: dict[str, object]) -> float:
    """Seconds per view of a run with these options, from the times of the records on disk; removes the output."""
    shutil.rmtree(out, ignore_errors=True)
    flags = [f"--{name.replace('_', '-')}={value}" for name, value in options.items()]
    _run(render_script, case, out, f"--count={VIEWS}", *flags)
    written = sorted(_record_times(out, VIEWS))
    shutil.rmtree(out)
    return (written[LAST] - written[FIRST]) / (LAST - FIRST)


def measure_workers(folder: Path, render_script: Path, report: Callable[[str], None]) -> dict[str, float]:
    """Milliseconds per view by number of processes."""
    case, figures = write_benchmark_case(folder / "workers"), {}
    for workers in dict.fromkeys((1, 2, available_cores())):
        seconds = dataset_seconds(render_script, case, folder / "workers-out", {"workers": workers})
        figures[f"{workers} workers"] = 1e3 * seconds
        report(f"  {workers} workers: {1e3 * seconds:.0f} ms per view")
    return figures


def measure_start(folder: Path, render_script: Path, report: Callable[[str], None]) -> dict[str, float]:
    """Seconds from the command to the first view on disk, median of three runs."""
    case, seconds, views = write_benchmark_case(folder / "start"), [], 8
    for _ in range(3):
        out = folder / "start-out"
        before = time.time()
        _run(render_script, case, out, f"--count={views}")
        seconds.append(min(_record_times(out, views)) - before)
        shutil.rmtree(out)
    report(f"  first view after {np.median(seconds):.1f} s")
    return {"seconds to the first view": float(np.median(seconds))}


def _run(render_script: Path, case: Path, out: Path, *flags: str) -> None:
    command = [sys.executable, str(render_script), str(case), "--out", str(out), f"--scale={SCALE}", *flags]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)


def _record_times(out: Path, views: int) -> list[float]:
    return [ViewPaths(out, index).file("frame").stat().st_mtime for index in range(views)]
