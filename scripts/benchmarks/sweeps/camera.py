"""Sweeps of the camera and of the surface's place past the point where rendered pixels leave K, for every engine.

Everything goes the way of a user's case: files, :func:`.read_case`, :func:`.load_case`, a render. The surface is one
triangle. Its edges are known in pixels to double precision, so every pixel centre on the wrong side of an edge shows an
error at least as large as its distance from that edge; along an edge of hundreds of pixels the largest of these
distances is the error to about a thousandth of a pixel.
"""

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from oneframe.blender.bridge.camera import MAX_PIXEL_ASPECT, SMALLEST_VIEW_PX
from oneframe.blender.render.engines import engine_named, opened_engine
from oneframe.camera.pinhole import FARTHEST_PRINCIPAL_POINT, PinholeCamera
from oneframe.case.case_file import Case, read_case
from oneframe.case.case_writer import write_case
from oneframe.case.loaded_case import MAX_EXTENT_RATIO, load_case
from oneframe.case.surface_doubts import EXACT_PX, FARTHEST_MM, LONGEST_EXACT_FOCAL_PX, UNIT_ROUNDOFF
from oneframe.colour.shading import ColouredSurface
from oneframe.errors import InputError
from oneframe.files.writing import write_bytes_atomically
from oneframe.images.png import encode_png
from oneframe.surface.mesh import TriangleMesh
from oneframe.surface.mesh_writer import write_ply
from oneframe.transforms import rigid, rotation_from_vector

from .cells import Limit, Outcome, Sweep, Task

TOPIC = "camera"
CORNERS = np.array([[0.11, 0.07], [0.93, 0.21], [0.37, 0.95]])
"""Corners of the triangle, relative to the image's size."""
TURNS = (0.0, 0.7, 1.9)
"""Rotations of the triangle in the image, radians: three triangles are three trials. A picture whose edges are more
than :data:`.EXACT_PX` off counts as wrong."""


@dataclass(frozen=True)
class Place:
    """A camera, and where the surface lies.

    Attributes
    ----------
    camera
        Intrinsics.
    distance_mm
        From the camera to the triangle.
    offset_mm
        Distance of the triangle from the origin of the mesh file's frame.
    reach
        Distance of the farthest vertex from the middle of the surface, relative to ``distance_mm``; 0 leaves the
        triangle alone.
    """

    camera: PinholeCamera
    distance_mm: float = 300.0
    offset_mm: float = 0.0
    reach: float = 0.0


def _camera(width: int = 640, height: int = 480, *, fx: float = 3200.0, fy: float | None = None) -> PinholeCamera:
    fy = fx if fy is None else fy
    return PinholeCamera(width, height, fx, fy, 0.51 * width, 0.47 * height)


def _shifted(sizes: float) -> Place:
    """The principal point this many image sizes off the middle."""
    camera = _camera()
    return Place(PinholeCamera(640, 480, camera.fx, camera.fy, 320 + sizes * 640, 240 + sizes * 480))


def _long(focal_px: float) -> Place:
    return Place(_camera(fx=focal_px), distance_mm=float(np.clip(15 * focal_px / 640, 10.0, FARTHEST_MM)))


SWEEPS: tuple[tuple[str, tuple[float, ...], Callable[[float], Place], Limit], ...] = (
    (
        "principal point",
        (0, 0.5, 1, 2, 4, 4.9, 5.1, 8),
        _shifted,
        Limit("FARTHEST_PRINCIPAL_POINT", FARTHEST_PRINCIPAL_POINT),
    ),
    (
        "focal length",
        (0.1, 1, 10, 100, 1e3, 1e4, 1e5, 2e5, 1e6, 1e7, 2e9),
        _long,
        Limit("LONGEST_EXACT_FOCAL_PX", LONGEST_EXACT_FOCAL_PX),
    ),
    (
        "fx / fy",
        (0.004, 0.0051, 0.02, 0.1, 1, 10, 50, 199, 250),
        lambda ratio: Place(_camera(fx=3200 * math.sqrt(ratio), fy=3200 / math.sqrt(ratio))),
        Limit("MAX_PIXEL_ASPECT", MAX_PIXEL_ASPECT),
    ),
    (
        "image height",
        (480, 48, 16, 8, 5, 4, 3, 2, 1),
        lambda height: Place(_camera(2000, int(height))),
        Limit("SMALLEST_VIEW_PX", SMALLEST_VIEW_PX),
    ),
    (
        "origin",
        (0, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 2e9),
        lambda offset: Place(_camera(fx=12_800), offset_mm=offset),
        Limit("EXACT_PX", EXACT_PX / UNIT_ROUNDOFF * 300 / 12_800),
    ),
    (
        "clip range",
        (0, 1, 3, 10, 19, 21, 60, 100),
        lambda reach: Place(_camera(), reach=reach),
        Limit("MAX_EXTENT_RATIO", MAX_EXTENT_RATIO * 640 / 3200 / 2),
    ),
)
"""Name, values, the place that each means, and the software's limit."""
ENGINES = ("cycles", "raster", "eevee")
EEVEE_SWEEPS = ("principal point", "clip range")
"""Eevee takes a second a view in software, so it is measured where it may differ from Workbench."""


def triangle_in(place: Place, turn: float) -> tuple[TriangleMesh, np.ndarray, np.ndarray]:
    """The surface in the frame of its file, ``cam_from_mesh`` (4x4, mm), and the corners' pixels ``(3, 2)``."""
    camera, z = place.camera, place.distance_mm
    angle = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    pixels = ((CORNERS - 0.5) @ angle.T * 0.9 + 0.5) * camera.size_wh
    # slanted, but never more than the surface is wide
    depth = z * (1 + np.array([0.0, 0.1, -0.1]) * min(1.0, max(camera.size_wh) / camera.fx, camera.fy / camera.fx))
    corners_cam = camera.rays_cam(pixels) * depth[:, None]
    rotation = rotation_from_vector(np.array([0.3, -0.2, 0.1]))
    middle = np.array([place.offset_mm, -0.6 * place.offset_mm, 0.3 * place.offset_mm]) / 1.2
    cam_from_mesh = rigid(rotation, corners_cam.mean(axis=0) - rotation @ middle)
    vertices = (corners_cam - cam_from_mesh[:3, 3]) @ rotation
    faces = [[0, 2, 1]]
    if place.reach:
        # two tiny triangles far to the sides, outside the image, one on each so that the middle stays
        far_cam = corners_cam.mean(axis=0) + np.array([[1.0, 0, 0], [-1.0, 0, 0]])[:, None] * place.reach * z
        far_cam = far_cam + np.array([[0, 0, 0], [0, 0.01 * z, 0], [0, 0, 0.01 * z]])
        vertices = np.concatenate([vertices, (far_cam.reshape(-1, 3) - cam_from_mesh[:3, 3]) @ rotation])
        faces += [[3, 4, 5], [6, 7, 8]]
    return TriangleMesh(vertices, np.array(faces, np.int32)), cam_from_mesh, pixels


def edge_distance(camera: PinholeCamera, pixels: np.ndarray) -> np.ndarray:
    """``(H, W)`` signed distance, px, of every pixel centre from the outline of a triangle; positive inside."""
    grid, signed = camera.pixel_grid(), []
    for start, end in ((0, 1), (1, 2), (2, 0)):
        along = pixels[end] - pixels[start]
        normal = np.array([-along[1], along[0]]) / np.linalg.norm(along)
        signed.append((grid - pixels[start]) @ normal)
    return np.min(signed, axis=0)


def write_place(folder: Path, place: Place, turn: float) -> tuple[Path, np.ndarray]:
    """A case with this camera and triangle, as files of a user: the case file, and the corners' pixels."""
    mesh, cam_from_mesh, pixels = triangle_in(place, turn)
    surface, frame, case = (folder / name for name in ("surface.ply", "frame.png", "case.toml"))
    write_ply(surface, mesh)
    write_bytes_atomically(frame, encode_png(np.full((*place.camera.shape_hw, 3), 120, np.uint8)))
    write_case(case, Case(case, 1.0, frame, place.camera, None, surface, cam_from_mesh))
    return case, pixels


def outcome(folder: Path, place: Place, turn: float, engine: str) -> Outcome:
    """Render a place: the error is that of the edges, px; the value is the error of the depth, mm."""
    try:
        case, pixels = write_place(folder, place, turn)
        loaded = load_case(read_case(case))
        with opened_engine(engine, ColouredSurface(loaded.surface.mesh), loaded.frame.camera) as render_view:
            rendered = render_view(loaded.frame.cam_from_model)
    except InputError as error:
        return Outcome("refuses", message=str(error).replace(str(folder), "."))
    distance = edge_distance(place.camera, pixels)
    if rendered.mask.shape != distance.shape:
        return Outcome("works", np.inf, True, message=f"a view of {rendered.mask.shape[1]}x{rendered.mask.shape[0]} px")
    missed = rendered.mask != (distance > 0)
    error_px = float(np.abs(distance[missed]).max()) if missed.any() else 0.0
    said = " ".join(loaded.messages)
    return Outcome(
        "warns" if said else "works",
        error_px,
        error_px > EXACT_PX,
        said,
        _depth_error_mm(place, turn, rendered.depth_mm, distance),
    )


def _depth_error_mm(place: Place, turn: float, depth_mm: np.ndarray, distance: np.ndarray) -> float:
    """Median error of the depth, a pixel or more inside the triangle."""
    mesh, cam_from_mesh, _ = triangle_in(place, turn)
    a, b, c = mesh.vertices[:3] @ cam_from_mesh[:3, :3].T + cam_from_mesh[:3, 3]
    normal = np.cross(b - a, c - a)
    inside = (distance > 1) & (depth_mm > 0)
    if not inside.any():
        return math.nan
    rays = place.camera.rays_cam(place.camera.pixel_grid()[inside])
    return float(np.median(np.abs(depth_mm[inside] - (normal @ a) / (rays @ normal))))


def tasks(folder: Path, *, quick: bool) -> Iterator[Task]:
    """All measurements of the topic; nothing in it is random. ``quick`` takes Cycles alone, and fewer values.

    ``folder`` is for temporary files. Engines that cannot render here are left out.
    """
    engines = [engine for engine in (ENGINES[:1] if quick else ENGINES) if not reason_against(engine)]
    for (name, values, place, limit), engine in itertools.product(SWEEPS, engines):
        if engine != "eevee" or name in EEVEE_SWEEPS:
            measure = partial(outcomes, folder, place, engine, TURNS[:1] if quick else TURNS)
            yield from Sweep(name, engine, values[:: 2 if quick else 1], measure, limit).tasks()


def outcomes(
    folder: Path, place: Callable[[float], Place], engine: str, turns: Sequence[float], value: float
) -> list[Outcome]:
    """All triangles at one value, by one engine."""
    return [outcome(folder, place(value), turn, engine) for turn in turns]


def reason_against(engine: str) -> str:
    """Why an engine cannot render here; empty if it can."""
    try:
        engine_named(engine).check()
    except InputError as error:
        return str(error)
    return ""
