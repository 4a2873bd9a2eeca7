"""Sweeps of the corrected surface: frames, angle, texture, noise, K, what is wrong, the light, and blood.

Small frames of a made surface at their true poses, so that a cell takes seconds; lengths in pixels on the surface hold
at any size.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial

import cv2
import numpy as np

from oneframe.camera.pinhole import PinholeCamera
from oneframe.case.frame import PosedFrame
from oneframe.colour.lens_shading import LensShading
from oneframe.errors import InputError
from oneframe.images.pixel_values import codes_from_linear
from oneframe.light.lens_light import LensLight, shading, working_distance_mm
from oneframe.projection.overlay_scene import smooth_normals
from oneframe.projection.z_buffer import rasterise_depth
from oneframe.surface.mesh import TriangleMesh
from oneframe.surface_correction.correct_surface import FLOOR_PX, LEAST_ANGLE_DEG, LEAST_FRAMES, correct_surface
from oneframe.transforms import inverse_rigid, rigid, rotation_from_vector, transform_points

from ..grid_mesh import grid_mesh
from .cells import NO_LIMIT, Limit, Outcome, Sweep, Task

TOPIC = "correction"
CAMERA = PinholeCamera(160, 120, fx=740.0, fy=740.0, cx=79.5, cy=59.5)
DISTANCE_MM, AMBIENT, LAMP_MM = 300.0, 0.08, 20.0
PIXEL_MM = DISTANCE_MM / CAMERA.fx
WAVES, WAVE_PER_MM = 60, 1.1
PATCH_PX = 6, 16
"""Radii of the blood's patches."""
CHANGED_PX, WRONG_PART, LEAST_TOLD = 1.0, 0.05, 0.05
"""What was displaced by more counts; the part of what is confirmed that may be off by more than :data:`FLOOR_PX`; and
the part of the changed of which something must be confirmed, or the old surface stays."""


@dataclass(frozen=True)
class Setting:
    """One scene: what is swept, and what the rest has. ``lit``: whether the light is given."""

    frames: int = 12
    angle_deg: float = 34.0
    contrast: float = 1.0
    noise: float = 0.008
    k_percent: float = 0.0
    aligned: bool = True
    height_px: float = 3.0
    radius_px: float = 18.0
    sharpness: float = 2.0
    lamp_mm: float = LAMP_MM
    lit: bool = True
    blood: float = 0.0


SWEEPS: dict[str, tuple[float, ...]] = {
    "frames": (8, 10, 15),
    "angle_deg": (10, 16, 24, 34),
    "contrast": (0.5, 0.25, 0.1),
    "noise": (0.03, 0.06),
    "k_percent": (5, 10),
    "height_px": (1.5, 6, 12),
    "radius_px": (4, 8),
    "sharpness": (8, 32),
    "lamp_mm": (20, 60),
    "blood": (0.1, 0.3),
}
LIMITS = {"frames": Limit("LEAST_FRAMES", LEAST_FRAMES), "angle_deg": Limit("LEAST_ANGLE_DEG", LEAST_ANGLE_DEG)}
SERIES: dict[str, dict[str, Setting]] = {
    "k_percent": {"pose aligned by it": Setting(), "pose as it was": Setting(aligned=False)},
    "lamp_mm": {"light given": Setting(), "light not given": Setting(lit=False)},
}


def tasks(seed: int, *, quick: bool = False) -> Iterator[Task]:
    """All sweeps, one trial a cell; ``quick`` takes the first value of each."""
    for field, values in SWEEPS.items():
        for series, setting in SERIES.get(field, {"": Setting()}).items():
            measure = partial(_trial, setting, field, seed)
            yield from Sweep(
                field, series, values[: 1 if quick else None], measure, LIMITS.get(field, NO_LIMIT)
            ).tasks()


def _trial(setting: Setting, field: str, seed: int, value: float) -> list[Outcome]:
    kind = type(getattr(setting, field))
    return [corrected(replace(setting, **{field: kind(value)}), np.random.default_rng(seed))]


def corrected(setting: Setting, rng: np.random.Generator) -> Outcome:
    """The error left, in pixels on the surface, and the part of what was changed that is confirmed."""
    x, y = np.meshgrid(np.linspace(-36, 36, 90), np.linspace(-28, 28, 70))
    true = grid_mesh(np.stack([x, y, 3 * np.sin(x / 6) * np.cos(y / 7) + 2 * np.sin((x + y) / 9)], axis=-1))
    apart = np.hypot(*(true.vertices[:, :2] - rng.uniform(-6, 6, 2)).T) / (setting.radius_px * PIXEL_MM)
    off_px = setting.height_px * np.exp(-(apart**setting.sharpness))
    wrong = replace(true, vertices=true.vertices + (PIXEL_MM * off_px)[:, None] * [0, 0, 1])
    frames, lamp = photographs(true, setting, rng)
    try:
        found = correct_surface(wrong, frames, LensShading(lamp, 0.1) if setting.lit else None)
    except InputError as error:
        return Outcome("refuses", message=str(error))
    left_px = np.abs(((found.mesh.vertices - true.vertices) * true.vertex_normals).sum(axis=1)) / PIXEL_MM
    changed = np.isfinite(found.std_mm) & (off_px > CHANGED_PX)
    sure = changed & found.confirmed
    share = float(sure.sum() / max(int(changed.sum()), 1))
    if share < LEAST_TOLD:
        return Outcome("falls back", value=share, message="; ".join(found.lines))
    is_wrong = bool(np.mean(left_px[found.confirmed] > FLOOR_PX) > WRONG_PART)
    return Outcome("works", float(np.median(left_px[sure])), is_wrong, "; ".join(found.lines), share)


def photographs(mesh: TriangleMesh, setting: Setting, rng: np.random.Generator) -> tuple[list[PosedFrame], LensLight]:
    """Frames from the front and from around it, in the light of a lamp beside the lens; and that lamp."""
    lamp = LensLight((-0.6 * setting.lamp_mm, 0.8 * setting.lamp_mm, 0.0), AMBIENT)
    waves, phases = rng.normal(size=(WAVES, 3)) * WAVE_PER_MM, rng.uniform(0, 2 * np.pi, WAVES)
    around, tilt = 2 * np.pi * np.arange(setting.frames) / setting.frames, np.radians(setting.angle_deg / 2)
    turns = np.vstack([np.zeros(3), tilt * np.stack([np.cos(around), np.sin(around), 0 * around], axis=1)])
    longer, frames = 1 + setting.k_percent / 100, []
    camera = replace(CAMERA, fx=CAMERA.fx * longer, fy=CAMERA.fy * longer)
    for turn in turns:
        pose = rigid(np.diag([1.0, -1.0, -1.0]) @ rotation_from_vector(turn), np.array([0.0, 0.0, DISTANCE_MM]))
        raster = rasterise_depth(mesh, CAMERA, pose)
        shown = raster.face >= 0
        rays = CAMERA.rays_cam(CAMERA.pixel_grid()[shown])
        points = transform_points(inverse_rigid(pose), rays / raster.inverse_depth[shown][:, None])
        normals = smooth_normals(mesh, mesh.smooth_normals, raster.face[shown], points)
        paint = 0.3 * np.exp(setting.contrast * np.cos(points @ waves.T + phases).sum(axis=1) / 12)
        linear = paint * shading(lamp, points, normals, pose, working_distance_mm(pose, np.zeros(3)))
        image: np.ndarray = np.zeros((*CAMERA.shape_hw, 3), np.float32)
        image[shown] = codes_from_linear(np.clip(linear, 0, 1))[:, None]
        image += setting.noise * rng.normal(size=image.shape[:2])[..., None]
        while (image[..., 1] < 0).mean() < setting.blood:
            centre = tuple(rng.integers(0, CAMERA.size_wh).tolist())
            cv2.circle(image, centre, int(rng.integers(*PATCH_PX)), (0.3, -1.0, -1.0), -1)
        image = (np.clip(np.rint(255 * image), 0, 255) / 255).astype(np.float32)
        known = pose if not setting.aligned else rigid(pose[:3, :3], pose[:3, 3] * longer)
        frames.append(PosedFrame(image, np.ones(CAMERA.shape_hw, bool), camera, known))
    return frames, lamp
