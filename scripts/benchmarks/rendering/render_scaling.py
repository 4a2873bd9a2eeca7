"""How time, memory and quality scale with triangles, views and samples per pixel; measured in this process."""

import shutil
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from skimage.metrics import structural_similarity

from oneframe.blender.dataset.job import render_views
from oneframe.blender.dataset.view_renderer import ViewRenderer
from oneframe.files.machine import available_cores
from oneframe.images.pixel_values import to_uint8

from ..memory import memory_mb
from .benchmark_case import TRIANGLES, VIEW_CAMERA, write_benchmark_case
from .converged_view import converged_view
from .render_speed import EXACT, benchmark_job

TRIANGLE_COUNTS = (20_000, TRIANGLES, 1_000_000, 5_000_000)
TIMED_VIEWS, WARM_UP_VIEWS = 24, 4
EDGE_SAMPLES = (1, 4, 8, 16)
REFERENCE_ALONG = 11
"""Rays along a pixel's side: 121 in all, of images of 38 million pixels."""
COMPARED_VIEWS = 3
MEMORY_STEP = 100
"""Number of views between two measurements of the memory."""


def measure_triangles(folder: Path, report: Callable[[str], None]) -> dict[str, float]:
    """Milliseconds per view by triangle count and engine, in one process."""
    figures = {}
    for triangles in TRIANGLE_COUNTS:
        case = write_benchmark_case(folder / f"t{triangles}", triangles)
        for engine in EXACT:
            job = benchmark_job(case, folder / "scaling", engine=engine)
            with job.renderer(threads=available_cores()) as renderer:
                ends = _finishing_times(renderer, folder / "scaling")
            milliseconds = float(np.median(np.diff(ends[WARM_UP_VIEWS:])) * 1e3)
            figures[f"{triangles} triangles, {engine}"] = milliseconds
            shutil.rmtree(folder / "scaling")
            report(f"  {triangles} triangles, {engine}: {milliseconds:.0f} ms per view")
    return figures


def _finishing_times(renderer: ViewRenderer, out: Path) -> list[float]:
    """When each view is on disk, s."""
    times: list[float] = []
    render_views(renderer, out, range(TIMED_VIEWS), lambda _: times.append(time.perf_counter()))
    return times


def measure_anti_aliasing(folder: Path, report: Callable[[str], None]) -> dict[str, float]:
    """SSIM of exact and of anti-aliased views with converged ones, the lowest of the compared views."""
    case, figures = write_benchmark_case(folder / "anti-aliasing"), {}
    truths: list[np.ndarray] = []
    for samples in EDGE_SAMPLES:
        job = benchmark_job(case, folder / "unused", samples=samples)
        with job.renderer(threads=available_cores()) as renderer:
            views = [renderer.make(index) for index in range(COMPARED_VIEWS)]
        if not truths:
            source = renderer.reference
            poses = [view.planned.cam_from_model for view in views]
            truths = [
                to_uint8(converged_view(source.mesh, source.view, VIEW_CAMERA, pose, along=REFERENCE_ALONG))
                for pose in poses
            ]
        values = [
            structural_similarity(truth, to_uint8(view.rendered.rgb), channel_axis=2, data_range=255)
            for truth, view in zip(truths, views, strict=True)
        ]
        name = f"SSIM with {samples} rays at edges" if samples > 1 else "SSIM of exact views"
        figures[name] = float(min(values))
        report(f"  {samples} samples: SSIM {min(values):.5f} (lowest of {len(values)})")
    return figures


def measure_memory(folder: Path, report: Callable[[str], None], *, views: int) -> dict[str, float]:
    """Growth of this process's resident memory over many views, MB."""
    out = folder / "memory-out"
    job = benchmark_job(write_benchmark_case(folder / "memory"), out)
    sizes: dict[int, float] = {}

    def finished(index: int) -> None:
        if (index + 1) % MEMORY_STEP == 0:
            sizes[index + 1] = memory_mb("VmRSS")
            # the disk may be small
            shutil.rmtree(out / "train_synt" / "000000" / "rgb", ignore_errors=True)

    with job.renderer(threads=available_cores()) as renderer:
        render_views(renderer, out, range(views), finished)
    shutil.rmtree(out)
    first, last = min(sizes), max(sizes)
    growth = sizes[last] - sizes[first]
    report(f"  {first} to {last} views: {growth:+.1f} MB (of {sizes[last]:.0f} MB)")
    return {f"growth from view {first} to {last}": growth}
