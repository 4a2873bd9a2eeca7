"""Sweeps of the renderers: samples against aliasing, rasterisers against Cycles, and the number of triangles."""

import itertools
import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from skimage.metrics import structural_similarity

from oneframe.blender.dataset.job import Job, open_job
from oneframe.blender.dataset.view_renderer import ViewRenderer
from oneframe.blender.render.cycles import CyclesScene
from oneframe.blender.render.engines import keep_freed_memory
from oneframe.case.case_file import read_case
from oneframe.colour.colour_doubts import MAX_REDUCTION, reduction_doubt
from oneframe.colour.reference_view import colours_of
from oneframe.colour.shading import ColouredSurface
from oneframe.dataset.options import DatasetOptions
from oneframe.dataset.run.run_folder import Shard
from oneframe.errors import InputError, RunError
from oneframe.images.pixel_values import to_uint8
from oneframe.projection.rendered_view import RenderedView
from oneframe.surface.mesh import MOST_FACES, checked_mesh
from oneframe.transforms import rigid, rotation_from_vector

from ..rendering.benchmark_case import CAM_FROM_MESH, write_benchmark_case
from ..rendering.memory import memory_mb
from .camera import reason_against
from .cells import Cell, Limit, Outcome, Task

TOPIC = "renderers"
SCALE = 0.25
"""Size of the views relative to the frame's: 320x240 px."""
SAMPLES = (1, 2, 4, 8, 16, 64)
REFERENCE_SAMPLES = 256
DISTANCES = (1.0, 2.0, 4.0, 8.0)
"""Relative to the frame's; the frame has 4 times as many pixels along a side, so its detail is finer."""
COARSE_TRIANGLES = 20_000
TILTS_DEG = (0.0, 20.0, 40.0, 60.0, 80.0)
TRIANGLES = (1_000, 10_000, 100_000, 1_000_000, 5_000_000, 11_000_000)
RASTERISED_TRIANGLES = 1_000_000
"""The largest surface for the rasterisers, which are measured for comparison."""
TIMED_VIEWS = 3
WRONG_CODES = 4.0
"""Mean colour error, of 255, beyond which a picture counts as wrong."""
DATASET = "rays at edges"
"""The series of what a dataset contains."""
SCALING = ("first view", "time", "memory")
"""Sweeps of the number of triangles."""
REPORT = "scaling "
"""Begins the line of a process that measures."""
ROOT = Path(__file__).resolve().parents[3]
RASTERISERS = ("raster", "eevee")


def _colour(engine: str) -> str:
    """The colour mode in which an engine is measured: the projection, or what it has instead."""
    return "projective" if engine in ("cycles", "raster") else "vertex"


def _renderer(folder: Path, triangles: int, **options: object) -> ViewRenderer:
    """What renders a dataset of the benchmark's case, with these options."""
    chosen: dict[str, Any] = {"scale": SCALE, **options}
    job = Job(read_case(_case(folder, triangles)), folder / "unused", DatasetOptions(**chosen), Shard())
    return open_job(job).renderer(threads=0)


def _case(folder: Path, triangles: int) -> Path:
    """The benchmark's case with this many triangles, written once."""
    case = folder / f"t{triangles}" / "case.toml"
    return case if case.exists() else write_benchmark_case(case.parent, triangles)


def _pose(renderer: ViewRenderer, *, distance: float = 1.0, tilt_deg: float = 0.0) -> np.ndarray:
    """The frame's pose, tilted about the middle of the surface, at a multiple of its distance."""
    tilt = rigid(rotation_from_vector(np.array([np.radians(tilt_deg), 0.0, 0.0])))
    away = rigid(translation=np.array([0.0, 0.0, (distance - 1) * CAM_FROM_MESH[2, 3]]))
    return away @ CAM_FROM_MESH @ tilt


def measure_samples(folder: Path, distance: float, *, quick: bool) -> list[Cell]:
    """Mean colour error against 256 samples in every pixel; ``y`` is the reduction of the frame, ``value`` the SSIM.

    The series are samples in every pixel, and a dataset's own rays at edges. The limit is on ``y``.
    """
    limit = Limit("MAX_REDUCTION", MAX_REDUCTION)
    cells, samples = [], SAMPLES[::3] if quick else SAMPLES
    with _renderer(folder, COARSE_TRIANGLES) as renderer:
        pose, source, camera = _pose(renderer, distance=distance), renderer.reference, renderer.camera
    (colour,), _ = colours_of(source, "projective")

    def every_pixel(count: int) -> RenderedView:
        with CyclesScene(ColouredSurface(source.mesh, (colour,)), camera, samples=count) as scene:
            return scene.render(pose)

    def at_edges(count: int) -> RenderedView:
        with _renderer(folder, COARSE_TRIANGLES, samples=count) as renderer:
            return renderer.render(pose)

    true = to_uint8(every_pixel(REFERENCE_SAMPLES).rgb)
    for (series, render), count in itertools.product((("every pixel", every_pixel), (DATASET, at_edges)), samples):
        found = to_uint8(render(count).rgb)
        error = float(np.abs(found.astype(float) - true)[true.any(axis=2)].mean())
        ssim = float(structural_similarity(true, found, channel_axis=2, data_range=255))
        said = reduction_doubt(camera.fx, source.view.camera.fx, distance, count)
        # what only the reference has is no answer of a dataset
        wrong = error > WRONG_CODES and series == DATASET
        outcome = Outcome("warns" if said else "works", error, wrong, said, ssim)
        cells.append(Cell.of("samples", series, count, [outcome], y=distance / SCALE, limit=limit))
    return cells


def measure_rasteriser(folder: Path, engine: str, tilt_deg: float) -> list[Cell]:
    """A rasteriser against Cycles with the same colours: silhouettes, and what the frame saw, by tilt."""
    views = {}
    for name in ("cycles", engine):
        with _renderer(folder, COARSE_TRIANGLES, engine=name, colour=_colour(engine)) as renderer:
            views[name] = renderer.render(_pose(renderer, tilt_deg=tilt_deg))
    exact, found = views["cycles"], views[engine]
    missed = int((exact.mask != found.mask).sum())
    observed = int((exact.observed != found.observed)[exact.mask & found.mask].sum())
    return [Cell.of("silhouette against Cycles", engine, tilt_deg, [Outcome("works", missed, value=observed)])]


def measure_triangles(folder: Path, engine: str, triangles: int) -> list[Cell]:
    """Seconds to the first view, seconds a view (``value``) and memory, MB, by number of triangles.

    Measured in a process of its own, as a dataset's run is one.

    Raises
    ------
    RunError
        The process failed.
    """
    limit = Limit("MOST_FACES", MOST_FACES)
    if triangles > MOST_FACES:
        outcome = _refused(triangles)
        return [Cell.of(sweep, engine, triangles, [outcome], limit=limit) for sweep in SCALING]
    _case(folder, triangles)
    program = (
        # not all of this path: bpy has put folders of its own before itself
        f"import sys; sys.path[:0] = {[str(ROOT), str(ROOT / 'scripts')]!r}; from pathlib import Path; "
        f"from {__name__} import report_scaling; report_scaling(Path({str(folder)!r}), {engine!r}, {triangles})"
    )
    ended = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    found = [line for line in ended.stdout.splitlines() if line.startswith(REPORT)]
    if not found:
        raise RunError(f"{engine} with {triangles} triangles: the process failed: {ended.stderr.strip()[-300:]}")
    values = json.loads(found[-1].removeprefix(REPORT))
    return [
        Cell.of(sweep, engine, triangles, [Outcome("works", value=values[sweep])], limit=limit) for sweep in SCALING
    ]


def report_scaling(folder: Path, engine: str, triangles: int) -> None:
    """Render some views of the case for :func:`measure_triangles`, print what it took, and end the process."""
    keep_freed_memory()
    start = time.perf_counter()
    with _renderer(folder, triangles, engine=engine, colour=_colour(engine)) as renderer:
        renderer.render(_pose(renderer))
        first, seconds = time.perf_counter() - start, []
        for index in range(TIMED_VIEWS):
            pose = _pose(renderer, tilt_deg=10.0 * (index + 1))
            start = time.perf_counter()
            renderer.render(pose)
            seconds.append(time.perf_counter() - start)
    values = dict(zip(SCALING, (first, float(np.median(seconds)), memory_mb("VmHWM")), strict=True))
    sys.stdout.write(f"\n{REPORT}{json.dumps(values)}\n")
    sys.stdout.flush()
    # after OpenGL renders the bpy module may wait forever for its own threads when it is unloaded
    os._exit(0)


def _refused(triangles: int) -> Outcome:
    """What the reader of meshes says to this many triangles."""
    faces = np.broadcast_to(np.array([[0, 1, 2]], np.int32), (triangles, 3))
    try:
        checked_mesh(np.eye(3), faces, "surface.ply")
    except InputError as error:
        return Outcome("refuses", message=str(error))
    return Outcome("works")


def tasks(folder: Path, *, quick: bool) -> Iterator[Task]:
    """All measurements of the topic; nothing in it is random. ``quick`` takes few values, and no Eevee.

    ``folder`` is for temporary files. Engines that cannot render here are left out.
    """
    rasterisers = [engine for engine in (RASTERISERS[:1] if quick else RASTERISERS) if not reason_against(engine)]
    for distance in DISTANCES[-1:] if quick else DISTANCES:
        yield partial(measure_samples, folder, distance, quick=quick)
    for engine, tilt_deg in itertools.product(rasterisers, TILTS_DEG[:: 4 if quick else 1]):
        yield partial(measure_rasteriser, folder, engine, tilt_deg)
    for triangles in (1_000, 100_000, 11_000_000) if quick else TRIANGLES:
        for engine in ("cycles", *rasterisers):
            if engine == "cycles" or triangles <= RASTERISED_TRIANGLES:
                yield partial(measure_triangles, folder, engine, triangles)
