"""Sweeps of the colouring: pose error, grazing angles, tolerance, mesh and frame resolution, thin walls.

The surfaces have a colour that is a function of the point, so the colour of every pixel of a view is known; the frame
shows it as a z-buffer sees it. What is measured is what a dataset would contain: views by Cycles.
"""

import itertools
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np

from oneframe.blender.render.cycles import CyclesScene
from oneframe.blender.render.engines import reference_view_of
from oneframe.camera.pinhole import PinholeCamera
from oneframe.case.case_file import Case
from oneframe.case.frame import PosedFrame
from oneframe.case.loaded_case import FARTHEST_MM, LoadedCase, LoadedSurface, check_pose
from oneframe.colour.colour_doubts import MAX_MAGNIFICATION, MAX_STATED_ERROR_PX, magnification_doubt, pose_doubt
from oneframe.colour.reference_view import ReferenceView, colours_of
from oneframe.colour.shading import ColouredSurface
from oneframe.colour.source_view import MAX_INCIDENCE_DEG, TOLERANCE_PX
from oneframe.errors import InputError
from oneframe.projection.z_buffer import rasterise_depth
from oneframe.surface.mesh import TriangleMesh
from oneframe.transforms import inverse_rigid, rigid, rotation_from_vector, transform_points

from ..grid_mesh import grid_mesh
from .cells import NO_LIMIT, Answer, Cell, Limit, Outcome, Task

TOPIC = "colouring"
CAMERA = PinholeCamera(480, 360, 2400.0, 2400.0, 239.5, 179.5)
"""Of frames and views; 8 px per mm at 300 mm."""
DISTANCE_MM = 300.0
FRONTAL = rigid(np.diag([1.0, -1.0, -1.0]), np.array([0.0, 0.0, DISTANCE_MM]))
WRONG_CODES = 8.0
"""Mean colour error, of 255, beyond which colours count as wrong; also 5 % of the pixels painted wrongly or not."""
WRONG_PART = 0.05
POSE_ERRORS_PX = (0.0, 0.25, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0)
INCIDENCES_DEG = (0.0, 30.0, 45.0, 60.0, 70.0, 80.0, 84.0, 86.0, 88.0, 89.0)
SCALES = (1e-3, 0.01, 0.1, 1.0, 10.0, 50.0, 99.0, 101.0)
FOCALS_PX = (60.0, 600.0, 2400.0, 12_800.0, 1e5, 1e6)
SPACINGS_PX = (0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0)
FRAME_SIZES = (2.0, 1.0, 0.5, 0.25, 0.125, 0.0625, 0.03125)
WALLS_PX = (0.05, 0.1, 0.2, 0.5, 1.0, 1.4, 1.6, 2.0, 4.0)
MODES = ("projective", "texture", "vertex")


def albedo(points_mm: np.ndarray) -> np.ndarray:
    """``(N, 3)`` points, mm -> ``(N, 3)`` code values 0..1: waves of 2 to 9 mm."""
    x, y, z = points_mm.T
    waves = [np.sin(2 * np.pi * x / 2.3 + 1.3 * z) * np.cos(2 * np.pi * y / 2.9), np.sin(0.7 * x - 0.9 * y + z)]
    return 0.5 + np.stack([0.3 * waves[0] + 0.12 * waves[1], 0.25 * waves[0] - 0.15 * waves[1], 0.3 * waves[1]], axis=1)


def hills(spacing_mm: float, *, height_mm: float = 1.5, half_mm: tuple[float, float] = (31.0, 24.0)) -> TriangleMesh:
    """A surface of low hills that fills the frame, all of it seen from the front."""
    columns, rows = (max(2, round(2 * half / spacing_mm) + 1) for half in half_mm)
    x, y = np.meshgrid(np.linspace(-half_mm[0], half_mm[0], columns), np.linspace(-half_mm[1], half_mm[1], rows))
    return grid_mesh(np.stack([x, y, height_mm * np.sin(x / 4.1) * np.cos(y / 3.7)], axis=-1))


def photograph(mesh: TriangleMesh, camera: PinholeCamera, pose: np.ndarray, scale: float = 1.0) -> np.ndarray:
    """``(H, W, 3)`` float32: the frame of a surface whose colour is :func:`albedo` of its points divided by a scale."""
    raster = rasterise_depth(mesh, camera, pose)
    shown = raster.face >= 0
    points_cam = camera.rays_cam(camera.pixel_grid())[shown] / raster.inverse_depth[shown][:, None]
    image = np.zeros((*camera.shape_hw, 3), np.float32)
    image[shown] = albedo(transform_points(inverse_rigid(pose), points_cam) / scale)
    return image


def reference(mesh: TriangleMesh, image: np.ndarray, camera: PinholeCamera, pose: np.ndarray) -> ReferenceView:
    """The reference view of a case in memory.

    Raises
    ------
    InputError
        As for a case from files.
    """
    nowhere = Path("case.toml")
    case = Case(nowhere, 1.0, nowhere, camera, None, nowhere, pose)
    check_pose(case, mesh, pose)
    frame = PosedFrame(image, np.ones(camera.shape_hw, bool), camera, pose)
    return reference_view_of(LoadedCase(case, LoadedSurface(mesh, np.eye(4)), (frame,)))


def view_outcome(
    source: ReferenceView,
    camera: PinholeCamera,
    pose: np.ndarray,
    *,
    mode: str = "projective",
    scale: float = 1.0,
    doubt: str = "",
) -> Outcome:
    """Render a view of a surface that the frame saw whole: mean colour error of what is painted, in codes of 255.

    The value is the fraction of the surface that is left grey. ``doubt`` is what a run says besides.
    """
    (colour,), messages = colours_of(source, mode)
    with CyclesScene(ColouredSurface(source.mesh, (colour,)), camera) as scene:
        rendered = scene.render(pose)
    painted = rendered.observed
    grey = 1 - float(painted[rendered.mask].mean())
    if grey > 0.95:
        return Outcome("falls back", message="grey: not observed", value=grey)
    points_cam = camera.rays_cam(camera.pixel_grid())[painted] * rendered.depth_mm[painted][:, None]
    true = albedo(transform_points(inverse_rigid(pose), points_cam) / scale)
    error = 255 * float(np.abs(rendered.rgb[painted] - true).mean())
    # the size of an atlas is no doubt about it
    said = " ".join((*source.messages, *(messages if mode == "vertex" else ()), *filter(None, (doubt,))))
    return Outcome("warns" if said else "works", error, error > WRONG_CODES, said, grey)


def _cell(sweep: str, series: str, x: float, outcome: Outcome, limit: Limit = NO_LIMIT) -> list[Cell]:
    return [Cell.of(sweep, series, x, [outcome], limit=limit)]


def measure_pose_error(shift_px: float, stated: str) -> list[Cell]:
    """Colour error of a pose that is off by a shift in the image, with and without a record of the error in the case.

    Without it nothing can be known of the error.
    """
    mesh = hills(0.5)
    image = photograph(mesh, CAMERA, FRONTAL)
    moved = rigid(translation=np.array([shift_px * DISTANCE_MM / CAMERA.fx, 0.0, 0.0])) @ FRONTAL
    doubt = pose_doubt({"error_px": shift_px} if stated == "stated" else {})
    outcome = view_outcome(reference(mesh, image, CAMERA, moved), CAMERA, moved, doubt=doubt)
    return _cell("pose error", stated, shift_px, outcome, Limit("MAX_STATED_ERROR_PX", MAX_STATED_ERROR_PX))


def measure_incidence(angle_deg: float) -> list[Cell]:
    """Colour error of a plane that the frame sees at an angle, viewed from the front."""
    mesh = hills(0.5, height_mm=0.0, half_mm=(14.0, 14.0))
    tilted = FRONTAL @ rigid(rotation_from_vector(np.array([0.0, np.radians(angle_deg), 0.0])))
    source = reference(mesh, photograph(mesh, CAMERA, tilted), CAMERA, tilted)
    outcome = view_outcome(source, CAMERA, FRONTAL)
    return _cell("incidence", "projective", angle_deg, outcome, Limit("MAX_INCIDENCE_DEG", MAX_INCIDENCE_DEG))


def measure_scale(scale: float) -> list[Cell]:
    """Acne: part of a surface left grey although the frame saw it, by the size of everything in mm."""
    mesh = hills(0.5).scaled(scale)
    pose = rigid(FRONTAL[:3, :3], scale * FRONTAL[:3, 3])
    outcome = _acne(mesh, CAMERA, pose, scale)
    return _cell("scale", "projective", scale * DISTANCE_MM, outcome, Limit("FARTHEST_MM", FARTHEST_MM))


def measure_focal(focal_px: float) -> list[Cell]:
    """The same by focal length, at the distance from which the surface fills the frame."""
    distance = DISTANCE_MM * focal_px / CAMERA.fx
    camera = PinholeCamera(480, 360, focal_px, focal_px, 239.5, 179.5)
    scale = min(1.0, FARTHEST_MM / distance)
    pose = rigid(FRONTAL[:3, :3], np.array([0.0, 0.0, distance * scale]))
    return _cell("focal length", "projective", focal_px, _acne(hills(0.5).scaled(scale), camera, pose, scale))


def _acne(mesh: TriangleMesh, camera: PinholeCamera, pose: np.ndarray, scale: float) -> Outcome:
    try:
        source = reference(mesh, photograph(mesh, camera, pose, scale), camera, pose)
    except InputError as error:
        return Outcome("refuses", message=str(error))
    seen = view_outcome(source, camera, pose, scale=scale)
    return Outcome(seen.answer, seen.value, seen.value > WRONG_PART or seen.wrong, seen.message, seen.error)


def measure_density(spacing_px: float, mode: str) -> list[Cell]:
    """Colour error by the spacing of the vertices, for every colour mode."""
    mesh = hills(spacing_px * DISTANCE_MM / CAMERA.fx)
    source = reference(mesh, photograph(mesh, CAMERA, FRONTAL), CAMERA, FRONTAL)
    return _cell("mesh density", mode, spacing_px, view_outcome(source, CAMERA, FRONTAL, mode=mode))


def measure_frame_size(size: float, mode: str) -> list[Cell]:
    """Colour error by the enlargement of the frame, from the size of the frame relative to the view's."""
    mesh = hills(0.5)
    camera = CAMERA.resized(round(size * CAMERA.width), round(size * CAMERA.height))
    source = reference(mesh, photograph(mesh, camera, FRONTAL), camera, FRONTAL)
    doubt = magnification_doubt(CAMERA.fx, camera.fx)
    outcome = view_outcome(source, CAMERA, FRONTAL, mode=mode, doubt=doubt)
    return _cell("magnification", mode, 1 / size, outcome, Limit("MAX_MAGNIFICATION", MAX_MAGNIFICATION))


def measure_wall(thickness_px: float, side: str) -> list[Cell]:
    """Leaking: part of a hidden plate that is painted, behind another one at this distance in pixel footprints.

    ``side`` is "layers": both plates face the frame; "wall": they are front and back of a closed wall, which is seen
    from behind. A point of the hidden plate is painted from the plate above it, at most this distance off in the image.
    """
    above = hills(0.5, height_mm=0.0, half_mm=(12.0, 12.0))
    gap = thickness_px * DISTANCE_MM / CAMERA.fx
    below = hills(0.5, height_mm=0.0, half_mm=(11.0, 11.0)).moved(np.array([0.0, 0.0, -gap]))
    behind = below if side == "layers" else below.flipped()
    both = TriangleMesh(
        np.concatenate([above.vertices, behind.vertices]),
        np.concatenate([above.faces, behind.faces + len(above.vertices)]).astype(np.int32),
    )
    source = reference(both, photograph(both, CAMERA, FRONTAL), CAMERA, FRONTAL)
    # from the frame's side for a layer below, from the other side for the back of a wall
    turned = rigid(rotation_from_vector(np.array([0.0, np.pi if side == "wall" else 0.0, 0.0])))
    with CyclesScene(ColouredSurface(behind, (source.view,)), CAMERA) as scene:
        rendered = scene.render(FRONTAL @ turned)
    leak = float(rendered.observed[rendered.mask].mean())
    answer: Answer = "falls back" if leak < WRONG_PART else "works"
    # what leaks is displaced by less than the tolerance: wrong only beyond it
    wrong = leak > WRONG_PART and (side == "wall" or thickness_px > TOLERANCE_PX)
    outcome = Outcome(answer, leak, wrong, "grey: not observed" if answer == "falls back" else "")
    return _cell("thin walls", side, thickness_px, outcome, Limit("TOLERANCE_PX", TOLERANCE_PX))


def tasks(*, quick: bool) -> Iterator[Task]:
    """All measurements of the topic; nothing in it is random. ``quick`` takes every third value."""
    step = 3 if quick else 1
    for measure, values in (
        (measure_incidence, INCIDENCES_DEG),
        (measure_scale, SCALES),
        (measure_focal, FOCALS_PX),
    ):
        for value in values[::step]:
            yield partial(measure, value)
    for value, stated in itertools.product(POSE_ERRORS_PX[::step], ("stated", "not stated")):
        yield partial(measure_pose_error, value, stated)
    for value, mode in itertools.product(SPACINGS_PX[2::2] if quick else SPACINGS_PX, MODES):
        yield partial(measure_density, value, mode)
    for value, mode in itertools.product(FRAME_SIZES[::step], MODES[:2]):
        yield partial(measure_frame_size, value, mode)
    for value, side in itertools.product(WALLS_PX[::step], ("layers", "wall")):
        yield partial(measure_wall, value, side)
