"""Measure speed against accuracy: every configuration renders the same views, which are timed and judged as files.

Times are those of the whole command ``render_dataset.py``, from the records on disk, in alternating rounds. Accuracy is
measured on the files of the last round, against a converged reference and against photographs.
"""

import os
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from pathlib import Path
from tempfile import mkdtemp

import bpy
import numpy as np

from oneframe.blender.render.cycles import CyclesScene
from oneframe.blender.render.engines import opened_engine
from oneframe.colour.lens_shading import lens_shading_of
from oneframe.colour.reference_view import colours_of, reference_view, traced_surface, vertex_colours_of
from oneframe.colour.shading import ColouredSurface
from oneframe.dataset.layout import ViewPaths
from oneframe.errors import RunError
from oneframe.evaluation.baseline import pyvista_renderer
from oneframe.evaluation.view_scores import Similarity, similarity
from oneframe.files.machine import available_cores
from oneframe.images.image_reader import read_image
from oneframe.images.pixel_values import to_uint8

from .converged_view import converged_view
from .render_scenes import RenderScene
from .speed_accuracy import ENGINE_NAMES, FLOOR, OURS, PEER, Configuration, SpeedPoint

RENDER_SCRIPT = Path(__file__).resolve().parents[2] / "render_dataset.py"
LIT_PEER = "PyVista, 8x MSAA, default light"
UNLIT_PEER = "PyVista, 8x MSAA, no light"
PLAIN_PEER = "PyVista, no MSAA, no light"
JUDGED_VIEWS = 3
"""Planned views that are compared with the reference."""
UNTIMED_VIEWS = 4
"""Views at the end of a run during which not all processes work."""
FEWEST_OBSERVED = 1000
"""Pixels of the observed surface in a photograph that is compared."""
BARE = "Cycles alone: 1 ray, no colour, nothing read or written"
Timed = tuple[float, list[np.ndarray]]
"""Seconds a view, and the views to judge."""


@dataclass(frozen=True)
class Reference:
    """What the views of a scene should be.

    Attributes
    ----------
    views
        ``(H, W, 3)`` code values 0..1: the reference of the judged views, then the photographs.
    observed, surface
        ``(H, W)`` bool for each: surface that the frame saw, and all of it.
    indices
        Numbers of these views in the scene.
    judged
        How many of them are no photographs.
    """

    views: tuple[np.ndarray, ...]
    observed: tuple[np.ndarray, ...]
    surface: tuple[np.ndarray, ...]
    indices: tuple[int, ...]
    judged: int


def converged_reference(scene: RenderScene, along: int, advance: Callable[[], None]) -> Reference:
    """Render the judged views with many rays per pixel, exact projective colours and the whole surface.

    ``along`` is the number of rays along a pixel's side; ``advance`` is called after each view.
    """
    (colour,), _ = colours_of(scene.source, "projective")
    judged = range(min(JUDGED_VIEWS, scene.planned))
    candidates = [*judged, *range(scene.planned, len(scene.poses))]
    with CyclesScene(ColouredSurface(scene.source.mesh, (colour,)), scene.camera) as exact:
        masks = {index: exact.render(scene.cam_from_model(index)) for index in candidates}
    enough = {index for index in candidates if masks[index].observed.sum() >= FEWEST_OBSERVED}
    indices = [index for index in candidates if index in enough or index < scene.planned]
    if scene.photographs and not any(index >= scene.planned for index in indices):
        raise RunError(f"{scene.name}: expected photographs of what the frame saw, no photograph shows enough of it")
    views = []
    for index in indices:
        if index < scene.planned:
            pose = scene.cam_from_model(index)
            rgb = converged_view(scene.source.mesh, colour, scene.camera, pose, along=along)
            views.append(to_uint8(rgb).astype(np.float32) / 255)
            advance()
        else:
            views.append(scene.photographs[index - scene.planned])
    return Reference(
        tuple(views),
        tuple(masks[index].observed for index in indices),
        tuple(masks[index].mask for index in indices),
        tuple(indices),
        sum(index < scene.planned for index in indices),
    )


def measure_scene(
    scene: RenderScene,
    reference: Reference | None,
    configurations: Sequence[Configuration],
    peers: Mapping[str, Callable[[np.ndarray], np.ndarray]],
    folder: Path,
    rounds: int,
    advance: Callable[[], None],
) -> list[SpeedPoint]:
    """Measure configurations, peers and Cycles alone in alternating rounds, and judge the views of the last one.

    Nothing is judged without a reference; peers are those of :func:`scene_peers`, ``folder`` is for temporary files.
    ``advance`` is called after each measurement.
    """
    faces, cores = len(scene.loaded.surface.mesh.faces), available_cores()
    np.save(folder / "poses.npy", scene.written_poses())
    finer = {each.mesh_px for each in configurations} - {0.0}
    cases = {0.0: (scene.case, faces)} | {px: scene.simplified_case(folder, px) for px in finer}
    rows: dict[str, tuple[object, ...]] = {}
    ways: dict[str, Callable[[Sequence[int]], Timed]] = {}
    for name, render in peers.items():
        rows[name] = PEER, name, "PyVista", 1 if name == PLAIN_PEER else 8, "vertex", "", faces, 1
        ways[name] = partial(_timed, scene, render)
    with CyclesScene(ColouredSurface(scene.source.mesh), scene.camera) as bare:
        rows[BARE] = FLOOR, BARE, "Cycles", 1, "none", "", faces, 1
        ways[BARE] = lambda _: _timed(scene, partial(_render_bare, bare), ())
        for each in configurations:
            (case, triangles), more = (
                cases[each.mesh_px],
                " ".join(f"{key}={value}" for key, value in each.more.items()),
            )
            engine, processes = ENGINE_NAMES[each.engine], each.processes or cores
            rows[each.name] = OURS, each.name, engine, each.samples, each.colour, more, triangles, processes
            ways[each.name] = partial(_dataset, scene, case, folder, each.flags(cores))
        seconds: dict[str, list[float]] = {name: [] for name in ways}
        scores: dict[str, dict[str, float]] = {name: {} for name in ways}
        for number in range(rounds):
            indices = reference.indices if reference is not None and number == rounds - 1 else ()
            for name, run in ways.items():
                took, views = run(indices)
                seconds[name].append(took)
                if reference is not None and views:
                    scores[name] = _judged(reference, views)
                advance()
    quantiles = {name: (1e3 * np.quantile(each, [0.5, 0, 1])).tolist() for name, each in seconds.items()}
    return [SpeedPoint(scene.name, *row, *quantiles[name], **scores[name]) for name, row in rows.items()]  # type: ignore[arg-type]


def measure_lights(scene: RenderScene, rounds: int, advance: Callable[[], None]) -> list[SpeedPoint]:
    """Processor time of a view in each light, without files, and how far it is off the scene's photographs.

    Lights are measured in turn. The one at the lens is as the case says, or in the lens' middle.
    """
    case = scene.loaded.case
    middle = replace(case, light=replace(case.lens_light, lamp_cam_mm=(0.0, 0.0, 0.0)))
    ways = {"no light": (case, None), "lens' middle": (middle, False), "lens": (case, False), "shadows": (case, True)}
    photographs = range(scene.planned, len(scene.poses))
    with ExitStack() as opened:
        renders, surfaces = {}, []
        for name, (lit, shadows) in ways.items():
            loaded = replace(scene.loaded, case=lit)
            light = None if shadows is None else lens_shading_of(loaded, shadows=shadows)
            reference = reference_view(loaded, traced_surface, light)
            surfaces.append((name, ColouredSurface(reference.mesh, reference.views, light=light)))
        for engine, (name, surface) in product(("raster", "cycles"), surfaces):
            renders[engine, name] = opened.enter_context(opened_engine(engine, surface, scene.camera, threads=1))
        seen = [renders["raster", "no light"](scene.cam_from_model(index)) for index in photographs]
        seconds: dict[tuple[str, str], list[float]] = {key: [] for key in renders}
        views: dict[tuple[str, str], list[np.ndarray]] = {key: [] for key in renders}
        for (key, render), index in product(renders.items(), photographs):
            views[key].append(render(scene.cam_from_model(index)).rgb)
        for _, (key, render), index in product(range(rounds), renders.items(), photographs):
            began = time.process_time()
            render(scene.cam_from_model(index))
            seconds[key].append(time.process_time() - began)
            advance()
    masks = tuple(view.observed for view in seen), tuple(view.mask for view in seen)
    truth = Reference(scene.photographs, *masks, tuple(photographs), 0)
    return [
        SpeedPoint(
            scene.name, OURS, f"{ENGINE_NAMES[engine]}, {name}", ENGINE_NAMES[engine], 1, "projective", name,
            len(scene.loaded.surface.mesh.faces), 1,
            *(1e3 * np.quantile(seconds[engine, name], [0.5, 0, 1])).tolist(),
            **_judged(truth, views[engine, name]),
        )
        for engine, name in renders
    ]  # fmt: skip


def render_command(case: Path, out: Path, *flags: str) -> list[str]:
    """The command that renders a dataset."""
    return [sys.executable, str(RENDER_SCRIPT), str(case), "--out", str(out), *flags]


def _dataset(scene: RenderScene, case: Path, folder: Path, flags: Sequence[str], indices: Sequence[int]) -> Timed:
    """Seconds a view of the whole command, and some of its views."""
    out, own = Path(mkdtemp(dir=folder)), (f"--poses={folder / 'poses.npy'}", f"--scale={1 / scene.factor!r}")
    command = render_command(case, out, *own, *flags)
    ended = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, text=True, check=False)
    if ended.returncode:
        raise RunError(f"render_dataset.py: expected a dataset, it failed: {ended.stderr.strip()[-300:]}")
    paths = [ViewPaths(out, index) for index in range(len(scene.poses))]
    written = sorted(path.file("frame").stat().st_mtime for path in paths)
    # the second half, when all processes are at work
    written = written[len(written) // 2 : -UNTIMED_VIEWS]
    views = [read_image(paths[index].file("rgb"))[0] for index in indices]
    # not removed: for minutes after that, some disks create files more slowly
    for path in filter(Path.is_file, out.rglob("*")):
        os.truncate(path, 0)
    return (written[-1] - written[0]) / (len(written) - 1), views


def _timed(scene: RenderScene, render: Callable[[np.ndarray], np.ndarray | None], indices: Sequence[int]) -> Timed:
    """Seconds a view of a function from ``cam_from_model`` to an ``(H, W, 3)`` uint8 image, and some of its views."""
    poses = [scene.cam_from_model(index) for index in range(scene.planned)]
    # the first view after another program's has cold caches
    render(poses[0])
    start = time.perf_counter()
    for pose in poses:
        render(pose)
    took = (time.perf_counter() - start) / len(poses)
    images = [render(scene.cam_from_model(index)) for index in indices]
    return took, [image.astype(np.float32) / 255 for image in images if image is not None]


def _render_bare(bare: CyclesScene, cam_from_model: np.ndarray) -> None:
    bare.look_from(cam_from_model)
    bpy.ops.render.render(scene=bare.scene.name)


def _judged(reference: Reference, views: Sequence[np.ndarray]) -> dict[str, float]:
    judged = reference.judged
    observed = list(map(similarity, reference.views, views, reference.observed))
    surface = list(map(similarity, reference.views[judged:], views[judged:], reference.surface[judged:]))
    scores = {"error": _mean(observed[:judged], "mean_error"), "ssim": _mean(observed[:judged], "ssim")}
    if surface:
        scores |= {
            "photograph_error": _mean(observed[judged:], "mean_error"),
            "photograph_ssim": _mean(observed[judged:], "ssim"),
            "photograph_ssim_surface": _mean(surface, "ssim"),
        }
    return scores


def scene_peers(scene: RenderScene) -> Mapping[str, Callable[[np.ndarray], np.ndarray]]:
    """PyVista's renderers of the scene, by name; they show the vertex colours."""
    colours, _ = vertex_colours_of(scene.source)
    mesh, radius = scene.source.mesh, scene.source.mesh.radius
    depths = [scene.cam_from_model(index)[2, 3] for index in range(len(scene.poses))]
    near_far = (max(0.99 * (min(depths) - radius), 1e-3 * radius), 1.01 * (max(depths) + radius))
    return {
        name: pyvista_renderer(
            mesh, to_uint8(colours.rgb), scene.camera, samples=samples, lit=lit, depth_range_mm=near_far
        )
        for name, samples, lit in ((LIT_PEER, 8, True), (UNLIT_PEER, 8, False), (PLAIN_PEER, 1, False))
    }


def _mean(found: Sequence[Similarity], score: str) -> float:
    return float(np.mean([getattr(one, score) for one in found])) if found else float("nan")
