"""Views, poses, light and frame scores on a real endoscopy, beside the paper's method and a homography.

--data is a folder with the example of github.com/lppllppl920/EndoscopyDepthEstimation-Pytorch: 35 undistorted frames of
a sinus, K, poses and 570 points, in a unit that is taken for 15 mm; and surface.ply, a dense surface of it in mm, or
else one is spanned over the points. The frames have no licence to publish them: keep to yourself what --out gets.
"""

import argparse
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
from scipy.interpolate import RBFInterpolator
from scipy.spatial.transform import Rotation

from oneframe.blender.render.engines import RENDERERS
from oneframe.camera.pinhole import PinholeCamera
from oneframe.case.case_file import Case, read_case
from oneframe.case.loaded_case import LoadedCase, load_case
from oneframe.errors import InputError
from oneframe.evaluation.evaluate import ShownSurface, named_cases, scored_views
from oneframe.evaluation.methods import chosen_methods
from oneframe.evaluation.view_scores import scores_of
from oneframe.files.outputs import made_folder
from oneframe.files.tables import parsed_json
from oneframe.files.writing import write_bytes_atomically
from oneframe.images.highlights import highlights
from oneframe.images.png import encode_png
from oneframe.projection.z_buffer import rasterise_depth
from oneframe.registration.pose_list import encoded_list, read_photographs
from oneframe.surface.mesh import TriangleMesh
from oneframe.surface.mesh_writer import write_ply
from oneframe.transforms import inverse_rigid, rigid, transform_points

from .figures import expected, write_figures
from .grid_mesh import grid_mesh
from .learning.training_scenes import PROGRAM
from .published import read_codes, written_case

QUICK = {"step": 4}
SIZE_WH, UNIT_MM = (960, 540), 15.0
SOURCES = ("4601", "4584")
METHODS = ("projective-raster", "projective-lens-raster", "paper-cycles", "paper-pyvista")
SCORES = ("ssim_observed", "error_observed", "error_observed_corrected", "edge_f")
GRID_PX, SMOOTH = 4, 1e-2
"""Of a surface over the points: its grid, and what the spline may leave of their inverse depths."""
EDGE_QUANTILE, EDGE_PX = 0.9, 2
"""So strong are a photograph's edges that views should have, within so many pixels."""
HIGHLIGHT = 45
"""Codes by which the least channel exceeds the median around it in a highlight."""

Frames = dict[str, tuple[Path, np.ndarray]]
"""Image and ``cam_from_mesh`` in mm, by name."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this topic."""
    parser.add_argument("--data", metavar="FOLDER", type=Path, required=True, help="the example, somewhere in it")
    parser.add_argument("--step", metavar="N", type=int, default=1, help="every so many of the frames (default all)")


def measure(arguments: argparse.Namespace, report: Callable[[str], None]) -> None:
    """Write the cases, and let the program do what its users do."""
    out = arguments.out
    camera, frames, mesh = read_sinus(arguments.data, out)
    figures: dict[str, dict[str, list[float]]] = {}
    for source in SOURCES:
        case, registered = out / source / "case.toml", out / source / "registered"
        others = [each for name, each in frames.items() if name != source][:: arguments.step]
        written_case(Case(case, 1.0, frames[source][0], camera, None, mesh, frames[source][1]), others)
        named = out / source / "frames"
        named.mkdir(exist_ok=True)
        for path, _ in others:
            (named / path.name).write_bytes(path.read_bytes())
        report(f"from {source}: {_run('register', case, named, '--out', registered)}")
        entries = parsed_json((registered / "poses.json").read_bytes(), "poses.json")
        half = made_folder(out / source / "half" / "poses.json")
        write_bytes_atomically(half, encoded_list(entries[1::2]))
        report(_run("light", case, half, "--out", case.with_name("lit.toml"), "--overwrite"))
        figures[source] = {}
        for method, scores in views_beside(case.with_name("lit.toml"), case.with_suffix(".json")).items():
            values = np.array(scores)
            figures[source][method] = [*values.mean(axis=0), values[::2, 2].mean()]
            line = "{:.3f} / {:.1f} / {:.1f} / {:.3f}; of frames the light does not know after one gain {:.1f}"
            report(f"  {method}: " + line.format(*figures[source][method]))
    for name in list(frames)[::9]:
        image = cv2.imread(str(frames[name][0]), cv2.IMREAD_UNCHANGED)
        shown, least = cv2.erode(image[..., 3], np.ones((15, 15))) > 0, image[..., :3].min(axis=2)
        bright = shown & (least.astype(int) - cv2.medianBlur(least, 31) > HIGHLIGHT)
        told = highlights(image[..., 2::-1] / np.float32(255), shown)
        report(
            f"highlights of {name}: {told[bright].mean():.0%} told, and {told[shown & ~bright].mean():.1%} of the rest"
        )
    film = cv2.VideoWriter(str(out / "film.avi"), cv2.CAP_FFMPEG, cv2.VideoWriter.fourcc(*"FFV1"), 25, SIZE_WH)
    for path, _ in frames.values():
        film.write(np.ascontiguousarray(read_codes(path)[..., ::-1]))
    film.release()
    report(_run("frames", out / "film.avi", "--out", out / "frames_of_film"))
    write_figures(out / "real.json", figures)


def read_sinus(data: Path, out: Path) -> tuple[PinholeCamera, Frames, Path]:
    """Half as large and masked: camera, frames in ``out``, and the surface's file."""
    folder = next((path.parent for path in sorted(data.rglob("motion.yaml"))), None)
    if folder is None:
        raise InputError(f"{data}: expected the example with motion.yaml in it, found none; clone the repository there")
    out.mkdir(parents=True, exist_ok=True)
    mask = cv2.resize(cv2.imread(str(folder / "undistorted_mask.bmp"), 0), SIZE_WH, interpolation=cv2.INTER_AREA) == 255
    frames: Frames = {}
    with expected(folder, "K, poses and points of the example", "clone the repository again"):
        k = [float(each) for each in (folder / "camera_intrinsics_per_view").read_text().split()[:4]]
        camera = PinholeCamera(*SIZE_WH, k[0] / 2, k[1] / 2, (k[2] + 0.5) / 2 - 0.5, (k[3] + 0.5) / 2 - 0.5)
        numbers = re.findall(r"\b[xyzw]: (\S+)", (folder / "motion.yaml").read_text())
        poses = np.array(numbers, float).reshape(-1, 7)
        points = (folder / "structure.ply").read_text().split("end_header\n")[1].splitlines()[:570]
        points_mm = UNIT_MM * np.array([line.split()[:3] for line in points], float)
        for name, pose in zip((folder / "visible_view_indexes").read_text().split(), poses, strict=True):
            codes = read_codes(folder / f"{int(name):08d}.jpg")
            small = cv2.resize(codes, SIZE_WH, interpolation=cv2.INTER_AREA)
            write_bytes_atomically(out / f"{name}.png", encode_png(np.dstack([small, np.uint8(255) * mask])))
            world_from_cam = rigid(Rotation.from_quat(pose[3:]).as_matrix(), UNIT_MM * pose[:3])
            frames[name] = out / f"{name}.png", inverse_rigid(world_from_cam)
    dense = data / "surface.ply"
    if not dense.is_file():
        dense = out / "surface.ply"
        write_ply(dense, spanned(points_mm, camera, frames[SOURCES[0]][1], mask))
    return camera, frames, dense


def spanned(points: np.ndarray, camera: PinholeCamera, pose: np.ndarray, mask: np.ndarray) -> TriangleMesh:
    """A thin plate over points ``(N, 3)`` as a camera sees them, where the mask shows anything."""
    points_cam = transform_points(pose, points)
    pixels = camera.project(points_cam) / camera.fx
    kept = np.ones(len(points), bool)
    for _ in range(2):
        plate = RBFInterpolator(pixels[kept], 1 / points_cam[kept, 2], smoothing=SMOOTH)
        off = np.abs(1 / plate(pixels) - points_cam[:, 2])
        kept = off < 4.5 * np.median(off)
    v, u = np.nonzero(mask)
    rows, columns = (np.arange(each.min(), each.max(), GRID_PX) for each in (v, u))
    grid = np.stack(np.meshgrid(columns, rows), axis=-1).astype(float)
    inverse = plate(grid.reshape(-1, 2) / camera.fx).reshape(grid.shape[:2])
    depth = 1 / np.clip(inverse, 1 / points_cam[:, 2].max(), 1.5 / points_cam[:, 2].min())
    flat = grid_mesh(camera.rays_cam(grid) * depth[..., None]).flipped()
    return TriangleMesh(transform_points(inverse_rigid(pose), flat.vertices), flat.faces)


def views_beside(case: Path, listed: Path) -> dict[str, list[list[float]]]:
    """The :data:`SCORES` of each frame's views, by method."""
    loaded = load_case(read_case(case))
    photographs, _ = read_photographs(listed, loaded.case)
    (named,) = named_cases([(loaded, photographs)])
    found: dict[str, list[list[float]]] = {}
    for view in scored_views(named, chosen_methods(METHODS, RENDERERS), None):
        scored = view.scores | {"edge_f": edge_f(view.rendered, view.shown)}
        found.setdefault(view.method.name, []).append([scored[name] for name in SCORES])
        if view.method.key == METHODS[0]:
            warped = by_homography(loaded, photographs[view.shown.number].cam_from_mesh, view.shown)
            scored = scores_of(view.shown.real, warped, view.shown.surface, view.shown.observed)
            scored |= {"edge_f": edge_f(warped, view.shown)}
            found.setdefault("homography of the frame", []).append([scored[name] for name in SCORES])
    return found


def by_homography(loaded: LoadedCase, cam_from_mesh: np.ndarray, shown: ShownSurface) -> np.ndarray:
    """The case's frame under the homography that fits what both show of the surface best."""
    frame, camera = loaded.frame, loaded.frame.camera
    pose = cam_from_mesh @ loaded.surface.mesh_from_model
    depth = rasterise_depth(loaded.surface.mesh, camera, pose).depth_mm
    there = np.argwhere(shown.observed)[:: max(np.count_nonzero(shown.observed) // 3000, 1), ::-1]
    points_cam = camera.rays_cam(there.astype(float)) * depth[there[:, 1], there[:, 0], None]
    here = camera.project(transform_points(frame.cam_from_model @ inverse_rigid(pose), points_cam))
    fit, _ = cv2.findHomography(here.astype(np.float32), there.astype(np.float32), cv2.RANSAC, 3)
    return cv2.warpPerspective(frame.image, fit, camera.size_wh)


def edge_f(view: np.ndarray, shown: ShownSurface) -> float:
    """F of the view's edges: the mean of how many are the photograph's, and how many of those it has, harmonic."""
    inside = cv2.erode(shown.observed.astype(np.uint8), np.ones((7, 7), np.uint8)) > 0
    slopes = []
    for image in (view, shown.real):
        grey = cv2.GaussianBlur(
            cv2.cvtColor(np.where(shown.observed[..., None], image, 0), cv2.COLOR_RGB2GRAY), (0, 0), 1
        )
        slopes.append(np.hypot(cv2.Sobel(grey, cv2.CV_32F, 1, 0), cv2.Sobel(grey, cv2.CV_32F, 0, 1)))
    edges = [inside & (slope > np.quantile(slopes[1][inside], EDGE_QUANTILE)) for slope in slopes]
    reach = np.ones((2 * EDGE_PX + 1,) * 2, np.uint8)
    shares = [
        cv2.dilate(other.astype(np.uint8), reach)[one].mean() if one.any() else 0.0
        for one, other in (edges, edges[::-1])
    ]
    return 2 * shares[0] * shares[1] / max(sum(shares), 1e-9)


def _run(*arguments: object) -> str:
    """What the program says; refused is an answer, too."""
    ended = subprocess.run(
        [sys.executable, str(PROGRAM), *map(str, arguments)], capture_output=True, text=True, check=False
    )
    return (ended.stdout + ended.stderr).strip()
