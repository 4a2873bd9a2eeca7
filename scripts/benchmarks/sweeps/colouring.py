"""Sweeps of the colouring: pose error, grazing angles, tolerance, mesh and frame resolution, thin walls.

The surfaces have a colour that is a function of the point, so the colour of every pixel of a view is known; the frame
shows it as a z-buffer sees it. What is measured is what a dataset would contain: views by Cycles.
"""

from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np

from oneframe.blender.render.cycles import CyclesScene
from oneframe.blender.render.engines import reference_view_of
from oneframe.camera.pinhole import PinholeCamera
from oneframe.case.case_file import Case
from oneframe.case.frame import PosedFrame
from oneframe.case.loaded_case import LoadedCase, LoadedSurface, check_pose
from oneframe.case.pose_record import UNKNOWN, PoseRecord
from oneframe.case.surface_doubts import FARTHEST_MM
from oneframe.colour.colour_doubts import MAX_MAGNIFICATION, MAX_STATED_ERROR_PX, magnification_doubt, pose_doubt
from oneframe.colour.reference_view import ReferenceView, colours_of
from oneframe.colour.seen_frame import MAX_INCIDENCE_DEG, TOLERANCE_PX
from oneframe.colour.shading import ColouredSurface
from oneframe.errors import InputError
from oneframe.projection.z_buffer import rasterise_depth
from oneframe.surface.mesh import TriangleMesh
from oneframe.transforms import inverse_rigid, rigid, rotation_from_vector, transform_points

from ..grid_mesh import grid_mesh
from .cells import Answer, Limit, Outcome, Sweep, Task

TOPIC = "colouring"
CAMERA = PinholeCamera(480, 360, 2400.0, 2400.0, 239.5, 179.5)
"""The camera of frames and views; 8 px per mm at 300 mm."""
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
MODES = ("projective", "vertex")


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
    """The reference view of a case in memory."""
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


def pose_error(stated: bool, shift_px: float) -> list[Outcome]:
    """Colour error of a pose that is off by a shift in the image, with and without a record of the error in the case.

    Without it nothing can be known of the error.
    """
    mesh = hills(0.5)
    image = photograph(mesh, CAMERA, FRONTAL)
    moved = rigid(translation=np.array([shift_px * DISTANCE_MM / CAMERA.fx, 0.0, 0.0])) @ FRONTAL
    doubt = pose_doubt(PoseRecord(error_px=shift_px) if stated else UNKNOWN)
    return [view_outcome(reference(mesh, image, CAMERA, moved), CAMERA, moved, doubt=doubt)]


def incidence(angle_deg: float) -> list[Outcome]:
    """Colour error of a plane that the frame sees at an angle, viewed from the front."""
    mesh = hills(0.5, height_mm=0.0, half_mm=(14.0, 14.0))
    tilted = FRONTAL @ rigid(rotation_from_vector(np.array([0.0, np.radians(angle_deg), 0.0])))
    source = reference(mesh, photograph(mesh, CAMERA, tilted), CAMERA, tilted)
    return [view_outcome(source, CAMERA, FRONTAL)]


def acne(camera: PinholeCamera, scale: float, distance_mm: float) -> list[Outcome]:
    """The part of a surface that is left grey although the frame saw it; everything is scaled in mm."""
    mesh, pose = hills(0.5).scaled(scale), rigid(FRONTAL[:3, :3], np.array([0.0, 0.0, scale * distance_mm]))
    try:
        source = reference(mesh, photograph(mesh, camera, pose, scale), camera, pose)
    except InputError as error:
        return [Outcome("refuses", message=str(error))]
    seen = view_outcome(source, camera, pose, scale=scale)
    return [Outcome(seen.answer, seen.value, seen.value > WRONG_PART or seen.wrong, seen.message, seen.error)]


def acne_at_focal(focal_px: float) -> list[Outcome]:
    """By focal length, at the distance from which the surface fills the frame."""
    distance = DISTANCE_MM * focal_px / CAMERA.fx
    camera = PinholeCamera(480, 360, focal_px, focal_px, 239.5, 179.5)
    return acne(camera, min(1.0, FARTHEST_MM / distance), distance)


def density(mode: str, spacing_px: float) -> list[Outcome]:
    """Colour error by the spacing of the vertices."""
    mesh = hills(spacing_px * DISTANCE_MM / CAMERA.fx)
    source = reference(mesh, photograph(mesh, CAMERA, FRONTAL), CAMERA, FRONTAL)
    return [view_outcome(source, CAMERA, FRONTAL, mode=mode)]


def magnification(mode: str, enlarged: float) -> list[Outcome]:
    """Colour error by the enlargement of the frame in the view."""
    mesh = hills(0.5)
    camera = CAMERA.resized(round(CAMERA.width / enlarged), round(CAMERA.height / enlarged))
    source = reference(mesh, photograph(mesh, camera, FRONTAL), camera, FRONTAL)
    return [view_outcome(source, CAMERA, FRONTAL, mode=mode, doubt=magnification_doubt(CAMERA.fx, camera.fx))]


def wall(side: str, thickness_px: float) -> list[Outcome]:
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
    return [Outcome(answer, leak, wrong, "grey: not observed" if answer == "falls back" else "")]


def tasks(*, quick: bool) -> Iterator[Task]:
    """All measurements of the topic; nothing in it is random. ``quick`` takes every third value."""
    step = 3 if quick else 1
    scaled = [scale * DISTANCE_MM for scale in SCALES[::step]]
    sweeps = [
        Sweep("incidence", MODES[0], INCIDENCES_DEG[::step], incidence, Limit("MAX_INCIDENCE_DEG", MAX_INCIDENCE_DEG)),
        Sweep(
            "scale", MODES[0], scaled, lambda far: acne(CAMERA, far / DISTANCE_MM, DISTANCE_MM),
            Limit("FARTHEST_MM", FARTHEST_MM),
        ),
        Sweep("focal length", MODES[0], FOCALS_PX[::step], acne_at_focal),
    ]  # fmt: skip
    stated, tolerance = Limit("MAX_STATED_ERROR_PX", MAX_STATED_ERROR_PX), Limit("TOLERANCE_PX", TOLERANCE_PX)
    for known in (True, False):
        name = "stated" if known else "not stated"
        sweeps.append(Sweep("pose error", name, POSE_ERRORS_PX[::step], partial(pose_error, known), stated))
    for mode in MODES:
        sweeps.append(Sweep("mesh density", mode, SPACINGS_PX[2::2] if quick else SPACINGS_PX, partial(density, mode)))
    enlarged, largest = [1 / size for size in FRAME_SIZES[::step]], Limit("MAX_MAGNIFICATION", MAX_MAGNIFICATION)
    sweeps += [Sweep("magnification", mode, enlarged, partial(magnification, mode), largest) for mode in MODES[:2]]
    sweeps += [
        Sweep("thin walls", side, WALLS_PX[::step], partial(wall, side), tolerance) for side in ("layers", "wall")
    ]
    return (task for sweep in sweeps for task in sweep.tasks())
