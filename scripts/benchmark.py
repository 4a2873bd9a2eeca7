"""Measure speed against PyVista, and scaling, memory and start-up, in one run on this machine.

    python scripts/benchmark.py [--quick] [--only NAME ...] [--out FOLDER]

All figures are of the same surface (200 000 triangles), poses, K and 640x480 size. Times are medians; ratios are made
of runs that alternate, since machines are noisy. PyVista is measured as a user meets it: off screen, RGB, in memory.
"""

import os
import sys
from pathlib import Path

# as render_dataset.py does, and before numpy is imported
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
# the repository's root: scripts are run from a checkout
sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import argparse
import json
import shutil
import subprocess
import tempfile
import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from pipeline.blender.colour.reference_view import colour_of
from pipeline.blender.command_line import own_output, run_script
from pipeline.blender.dataset.job import Job, OpenJob, available_cores, open_job, render_views
from pipeline.blender.render.engines import keep_freed_memory, render_view
from pipeline.blender.render.surface_scene import SurfaceScene
from pipeline.camera.pinhole import PinholeCamera
from pipeline.colour.vertex_colours import colour_vertices
from pipeline.dataset.folder import Shard
from pipeline.dataset.layout import ViewPaths
from pipeline.dataset.options import DatasetOptions
from pipeline.images.pixel_values import to_uint8
from pipeline.images.png import encode_png
from pipeline.surface.mesh import TriangleMesh
from pipeline.surface.mesh_writer import write_ply
from pipeline.transforms import inverse_rigid, rigid

CAMERA = PinholeCamera(640, 480, 3200.0, 3190.0, 322.5, 236.0)
FRAME = CAMERA.resized(1280, 960)
POSE = rigid(np.diag([1.0, -1.0, -1.0]), np.array([0.0, 0.0, 300.0]))
SCRIPT = Path(__file__).with_name("render_dataset.py")
REFERENCE_SAMPLES = 256


def surface(triangles: int) -> TriangleMesh:
    """A drilled-bone-like bowl with ridges, filling the view, of about this many triangles."""
    side = max(2, round(np.sqrt(triangles / 2)))
    x, y = np.meshgrid(np.linspace(-34, 34, side + 1), np.linspace(-27, 27, side + 1))
    r = np.hypot(x, y)
    # a bowl whose wall leans over its floor, so that there is occlusion
    lean = 1 + 0.12 * np.exp(-(((r - 13) / 3) ** 2))
    z = -14 / (1 + np.exp((r - 13) * 2.2)) + 0.6 * np.sin(x * 1.3) * np.cos(y * 1.1) + 0.15 * np.sin(4 * x + 3 * y)
    index = np.arange((side + 1) ** 2).reshape(side + 1, side + 1)
    a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]
    faces = np.concatenate([np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)])
    return TriangleMesh(np.stack([x * lean, y * lean, z], -1).reshape(-1, 3), faces.astype(np.int32))


def frame_image() -> np.ndarray:
    """A picture with detail down to a few pixels, as a photograph of wet bone has it."""
    rng = np.random.default_rng(4)
    image = np.zeros((FRAME.height, FRAME.width, 3))
    for period in (160, 40, 12, 5):
        coarse = rng.normal(size=(FRAME.height // period + 3, FRAME.width // period + 3, 3))
        v = (np.arange(FRAME.height) / period)[:, None]
        u = (np.arange(FRAME.width) / period)[None]
        i, j, s, t = v.astype(int), u.astype(int), (v % 1)[..., None], (u % 1)[..., None]
        smooth = (coarse[i, j] * (1 - t) + coarse[i, j + 1] * t) * (1 - s)
        smooth += (coarse[i + 1, j] * (1 - t) + coarse[i + 1, j + 1] * t) * s
        image += smooth * period**0.5
    image = 0.55 + 0.16 * image / image.std()
    return to_uint8(image)


def write_case(folder: Path, triangles: int) -> Path:
    """A case file with its frame and surface."""
    folder.mkdir(parents=True, exist_ok=True)
    write_ply(folder / "surface.ply", surface(triangles))
    (folder / "frame.png").write_bytes(encode_png(frame_image()))
    (folder / "case.toml").write_text(
        f"""units = "mm"
[frame]
image = "frame.png"
[camera]
size = [{FRAME.width}, {FRAME.height}]
K = {FRAME.k.tolist()}
[surface]
mesh = "surface.ply"
[pose]
cam_from_mesh = {POSE.tolist()}
"""
    )
    return folder / "case.toml"


def open_case(case: Path, out: Path, **options: Any) -> OpenJob:
    """The job of a case at 640x480."""
    return open_job(Job(case, out, DatasetOptions(scale=0.5, **options), Shard()))


def median_ms(times: Sequence[float] | np.ndarray) -> float:
    return float(np.median(times) * 1e3)


# --- the peer --------------------------------------------------------------------------------------------------------


def pyvista_views(mesh: TriangleMesh, colours: np.ndarray, poses: np.ndarray, *, samples: int, lit: bool) -> Callable:
    """A function that renders one pose with PyVista and returns the image."""
    import pyvista

    plotter = pyvista.Plotter(off_screen=True, window_size=CAMERA.size_wh, **({} if lit else {"lighting": "none"}))
    data = pyvista.PolyData.from_regular_faces(mesh.vertices.astype(np.float32), mesh.faces)
    data["rgb"] = colours
    plotter.add_mesh(data, scalars="rgb", rgb=True, lighting=lit)
    plotter.set_background("black")
    if samples > 1:
        plotter.enable_anti_aliasing("msaa", multi_samples=samples)
    else:
        plotter.disable_anti_aliasing()
    plotter.camera.view_angle = np.degrees(2 * np.arctan(CAMERA.height / 2 / CAMERA.fy))
    centre_x = -2 * (CAMERA.cx - (CAMERA.width - 1) / 2) / CAMERA.width
    plotter.camera.SetWindowCenter(centre_x, 2 * (CAMERA.cy - (CAMERA.height - 1) / 2) / CAMERA.height)
    plotter.camera.clipping_range = (150, 450)

    def render(number: int) -> np.ndarray:
        model_from_cam = inverse_rigid(poses[number % len(poses)])
        plotter.camera.position = model_from_cam[:3, 3]
        plotter.camera.focal_point = model_from_cam[:3, 3] + 300 * model_from_cam[:3, 2]
        plotter.camera.up = -model_from_cam[:3, 1]
        plotter.camera.clipping_range = (150, 450)
        plotter.render()
        return plotter.screenshot(None, return_img=True)

    return render


# --- what is measured ------------------------------------------------------------------------------------------------


def measure_speed(folder: Path, report: Callable[[str], None], *, rounds: int) -> dict:
    """Time a complete frame on disk against PyVista's RGB in memory: alternating blocks of the same poses."""
    case = write_case(folder / "speed", 200_000)
    block = 12
    opened = open_case(case, folder / "unused")
    with opened.renderer(threads=available_cores()) as renderer:
        poses = np.stack([renderer.plan(index).cam_from_model for index in range(block)])
        colours = colour_vertices(renderer.source.mesh, renderer.source.view)
    codes = to_uint8(colours.rgb)
    mesh = renderer.source.mesh
    peers = {
        "PyVista, 8x MSAA, default light": pyvista_views(mesh, codes, poses, samples=8, lit=True),
        "PyVista, 8x MSAA, no light": pyvista_views(mesh, codes, poses, samples=8, lit=False),
        "PyVista, no MSAA, no light": pyvista_views(mesh, codes, poses, samples=1, lit=False),
    }
    ours: dict[str, dict] = {
        "exact, projective": {"colour": "projective"},
        "exact, texture": {"colour": "texture"},
        "exact, vertex": {"colour": "vertex"},
        "anti-aliased (8 rays), projective": {"colour": "projective", "samples": 8},
    }
    times: dict[str, list[float]] = {name: [] for name in (*peers, *ours)}
    for turn in range(rounds + 1):
        for name, render in peers.items():
            start = time.perf_counter()
            for number in range(block):
                render(number)
            times[name].append((time.perf_counter() - start) / block)
        for name, options in ours.items():
            times[name].append(_time_of_dataset(case, folder / f"out-{turn}", options))
        report(
            f"  round {turn} of {rounds}: "
            + ", ".join(f"{name} {each[-1] * 1e3:.0f} ms" for name, each in times.items())
        )
    # the first round warms up caches and shaders
    return {name: median_ms(each[1:]) for name, each in times.items()}


def _time_of_dataset(case: Path, out: Path, options: dict) -> float:
    """Seconds a view of ``render_dataset.py`` with its default workers, between the views' records on disk."""
    count = 40
    shutil.rmtree(out, ignore_errors=True)
    arguments = [f"--{name.replace('_', '-')}={value}" for name, value in options.items()]
    command = [sys.executable, str(SCRIPT), str(case), "--out", str(out), "--scale=0.5", f"--count={count}", *arguments]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    written = sorted(ViewPaths(out, index).file("frame").stat().st_mtime for index in range(count))
    shutil.rmtree(out)
    # the first and the last views: workers start one after the other and end one after the other
    first, last = 10, count - 4
    return (written[last] - written[first]) / (last - first)


def measure_antialiasing(folder: Path, report: Callable[[str], None]) -> dict:
    """SSIM of exact and anti-aliased views against 256 samples a pixel."""
    from skimage.metrics import structural_similarity

    case, figures = write_case(folder / "aa", 200_000), {}
    for samples in (1, 4, 8, 16):
        opened, values = open_case(case, folder / "unused", samples=samples), []
        with opened.renderer(threads=available_cores()) as renderer:
            views = [renderer.make(index) for index in range(3)]
        colour, _ = colour_of(renderer.source, "projective")
        with SurfaceScene(renderer.source.mesh, CAMERA, colour, samples=REFERENCE_SAMPLES) as reference:
            for view in views:
                truth = to_uint8(render_view(reference, view.planned.cam_from_model).rgb)
                values.append(structural_similarity(truth, to_uint8(view.rendered.rgb), channel_axis=2, data_range=255))
        figures[f"SSIM with {samples} rays at edges" if samples > 1 else "SSIM of exact views"] = min(values)
        report(f"  {samples} samples: SSIM {min(values):.5f} (worst of {len(values)})")
    return figures


def measure_scaling(folder: Path, report: Callable[[str], None]) -> dict:
    """Milliseconds a view by triangle count, in one process."""
    figures = {}
    for triangles in (20_000, 200_000, 1_000_000):
        opened = open_case(write_case(folder / f"t{triangles}", triangles), folder / "scaling")
        with opened.renderer(threads=available_cores()) as renderer:
            ends: list[float] = []

            def finished(_index: int, ends: list[float] = ends) -> None:
                ends.append(time.perf_counter())

            render_views(renderer, folder / "scaling", range(24), finished)
        figures[f"{triangles} triangles"] = median_ms(np.diff(ends[4:]))
        shutil.rmtree(folder / "scaling")
        report(f"  {triangles} triangles: {figures[f'{triangles} triangles']:.0f} ms a view")
    return figures


def measure_memory(folder: Path, report: Callable[[str], None], *, views: int) -> dict:
    """Growth of the process's resident memory over many views, MB."""
    opened = open_case(write_case(folder / "memory", 200_000), folder / "memory-out")
    sizes: dict[int, float] = {}

    def finished(index: int) -> None:
        if index % 100 == 99:
            sizes[index + 1] = _resident_mb()
            shutil.rmtree(folder / "memory-out" / "train_pbr" / "000000" / "rgb", ignore_errors=True)

    with opened.renderer(threads=available_cores()) as renderer:
        render_views(renderer, folder / "memory-out", range(views), finished)
    shutil.rmtree(folder / "memory-out")
    growth = sizes[max(sizes)] - sizes[min(sizes)]
    report(f"  {min(sizes)} to {max(sizes)} views: {growth:+.1f} MB (of {sizes[max(sizes)]:.0f} MB)")
    return {f"growth from view {min(sizes)} to {max(sizes)}": growth}


def _resident_mb() -> float:
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith("VmRSS"):
            return int(line.split()[1]) / 1024
    raise RuntimeError("the kernel tells no VmRSS")


def measure_start(folder: Path, report: Callable[[str], None]) -> dict:
    """Seconds from the command to the first view on disk."""
    case, times = write_case(folder / "start", 200_000), []
    for _ in range(3):
        out = folder / "start-out"
        before = time.time()
        command = [sys.executable, str(SCRIPT), str(case), "--out", str(out), "--scale=0.5", "--count=8"]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
        times.append(min(ViewPaths(out, index).file("frame").stat().st_mtime for index in range(8)) - before)
        shutil.rmtree(out)
    report(f"  first view after {np.median(times):.1f} s")
    return {"seconds to the first view": float(np.median(times))}


def measure_workers(folder: Path, report: Callable[[str], None]) -> dict:
    """Milliseconds a view by number of processes."""
    case, figures = write_case(folder / "workers", 200_000), {}
    for workers in dict.fromkeys((1, 2, available_cores())):
        figures[f"{workers} workers"] = 1e3 * _time_of_dataset(case, folder / "workers-out", {"workers": workers})
        report(f"  {workers} workers: {figures[f'{workers} workers']:.0f} ms a view")
    return figures


def main(argv: Sequence[str]) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    names = ("speed", "antialiasing", "scaling", "workers", "start", "memory")
    parser.add_argument("--only", nargs="+", choices=names, default=names, metavar="NAME", help=" ".join(names))
    parser.add_argument("--quick", action="store_true", help="fewer rounds, 300 instead of 2000 views for memory")
    parser.add_argument("--out", type=Path, help="also write the figures to this JSON file")
    arguments = parser.parse_args(argv)
    output = own_output()

    def report(text: str) -> None:
        output.write(text + "\n")
        output.flush()

    keep_freed_memory()
    figures: dict[str, dict] = {}
    with tempfile.TemporaryDirectory(prefix="oneframe-benchmark-") as name:
        folder = Path(name)
        report(f"{available_cores()} cores, {CAMERA.width}x{CAMERA.height} px, 200 000 triangles")
        measures = {
            "speed": lambda: measure_speed(folder, report, rounds=2 if arguments.quick else 5),
            "antialiasing": lambda: measure_antialiasing(folder, report),
            "scaling": lambda: measure_scaling(folder, report),
            "workers": lambda: measure_workers(folder, report),
            "start": lambda: measure_start(folder, report),
            "memory": lambda: measure_memory(folder, report, views=300 if arguments.quick else 2000),
        }
        for key in arguments.only:
            report(f"{key}:")
            figures[key] = measures[key]()
    if "speed" in figures:
        report("\n| a frame | ms | / PyVista 8x MSAA, default light | / no light |\n|---|---|---|---|")
        speed = figures["speed"]
        lit, unlit = speed["PyVista, 8x MSAA, default light"], speed["PyVista, 8x MSAA, no light"]
        for label, value in speed.items():
            report(f"| {label} | {value:.0f} | {value / lit:.2f} | {value / unlit:.2f} |")
    if arguments.out:
        arguments.out.write_text(json.dumps(figures, indent=2) + "\n")
    return 0


if __name__ == "__main__":
    run_script(main)
