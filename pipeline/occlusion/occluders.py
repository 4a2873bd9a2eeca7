"""Where instruments are held in a view: drawn at random by a stream of their own, and never through the surface."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from ..camera.pinhole import PinholeCamera
from ..surface.mesh import TriangleMesh
from ..transforms import inverse_rigid, rigid, rotation_from_vector, transform_points
from .instruments import KINDS, STEP_MM, Finish, Instrument

STREAM = 1
"""Third number of the seed of a view's instruments, beside the dataset's seed and the view's number."""

TRIES = 30
"""Places that are tried for an instrument before the view does without it."""

TOUCHING, FARTHEST_MM = 0.4, 10.0
"""Part of the instruments whose tip all but touches the surface; how far the tips of the others are from it at most."""
NEARLY_MM = 0.3
"""Distance of a tip that all but touches the surface."""
RETREATS_MM = 0.0, 1.0, 3.0, 6.0
"""By how much an instrument that would meet the surface is drawn back along its shaft, one after the other."""

BEYOND_MM = 60.0
"""How much longer a shaft is than what leaves the image: a right eye sees more of it."""
NEAREST = 0.3
"""Part of the tip's depth at which a shaft ends at the latest."""
ROLL_DEG = 25.0
"""Standard deviation of the turn about the shaft; without it, the tip is bent away from the camera."""


class Room(Protocol):
    """What surrounds instruments."""

    def seen_point(self, pixel: np.ndarray, cam_from_model: np.ndarray) -> np.ndarray | None:
        """The surface's point ``(3,)``, model frame, at a pixel ``(2,)`` of a pose, if a frame saw it."""

    def touches(self, mesh: TriangleMesh, others: Sequence[TriangleMesh]) -> bool:
        """Whether a mesh, model frame, meets the surface or one of others."""


@dataclass(frozen=True)
class Occluders:
    """What stands in front of the surface in a view.

    Attributes
    ----------
    mesh
        All of it, model frame, mm.
    rgb, shine
        ``(F, 3)`` and ``(F, 2)`` float32 of its faces: see :class:`.Finish`.
    """

    mesh: TriangleMesh
    rgb: np.ndarray
    shine: np.ndarray

    @classmethod
    def of(cls, parts: Sequence[tuple[TriangleMesh, Finish]]) -> "Occluders":
        """Join meshes, one or more."""
        first = np.cumsum([0, *(len(mesh.vertices) for mesh, _ in parts)])
        faces = [mesh.faces + at for (mesh, _), at in zip(parts, first, strict=False)]
        counts = [len(mesh.faces) for mesh, _ in parts]
        return cls(
            TriangleMesh(np.concatenate([mesh.vertices for mesh, _ in parts]), np.concatenate(faces).astype(np.int32)),
            np.repeat(np.array([finish.rgb for _, finish in parts], np.float32), counts, axis=0),
            np.repeat(np.array([(finish.gloss, finish.sharpness) for _, finish in parts], np.float32), counts, axis=0),
        )


def draw_occluders(
    mean: float,
    seed: Sequence[int],
    room: Room,
    camera: PinholeCamera,
    cam_from_model: np.ndarray,
) -> Occluders | None:
    """Draw the instruments of a view; ``None`` if there are none.

    Parameters
    ----------
    mean
        Their number follows Poisson's distribution with this mean; one that finds no place is left out.
    seed
        The dataset's seed and the view's number.
    room
        The surface.
    camera, cam_from_model
        The view's intrinsics and pose (4x4, mm).
    """
    placed = [parts for parts in _drawn(mean, seed, room, camera, cam_from_model) if parts is not None]
    return Occluders.of([part for parts in placed for part in parts]) if placed else None


def _drawn(
    mean: float, seed: Sequence[int], room: Room, camera: PinholeCamera, cam_from_model: np.ndarray
) -> list[list[tuple[TriangleMesh, Finish]] | None]:
    """The parts of every instrument that is drawn, or ``None`` for one that finds no place."""
    rng = np.random.default_rng([*seed, STREAM])
    drawn: list[list[tuple[TriangleMesh, Finish]] | None] = []
    for stream in rng.spawn(rng.poisson(mean)):
        instrument = KINDS[int(stream.integers(len(KINDS)))](stream)
        others = [mesh for parts in drawn for mesh, _ in parts or ()]
        tries = (_held(instrument, stream, room, others, camera, cam_from_model) for _ in range(TRIES))
        drawn.append(next((parts for parts in tries if parts is not None), None))
    return drawn


def _held(
    instrument: Instrument,
    rng: np.random.Generator,
    room: Room,
    others: Sequence[TriangleMesh],
    camera: PinholeCamera,
    cam_from_model: np.ndarray,
) -> list[tuple[TriangleMesh, Finish]] | None:
    """An instrument at a random place, model frame, or ``None`` if it cannot be there."""
    pixel, azimuth = _place(instrument, rng, camera)
    tilt, roll = np.radians(rng.uniform(*instrument.tilt_deg)), np.radians(rng.normal(0, ROLL_DEG))
    away_mm = NEARLY_MM if rng.random() < TOUCHING else rng.uniform(NEARLY_MM, FARTHEST_MM)
    point = room.seen_point(pixel, cam_from_model)
    if point is None:
        return None
    tip_cam = transform_points(cam_from_model, point[None])[0]
    shaft = np.array([np.sin(tilt) * np.cos(azimuth), np.sin(tilt) * np.sin(azimuth), -np.cos(tilt)])
    down = np.array([0.0, 0.0, 1.0]) - shaft[2] * shaft
    down /= np.linalg.norm(down)
    rotation = rotation_from_vector(roll * shaft) @ np.stack([down, np.cross(shaft, down), shaft], axis=1)
    for retreat_mm in RETREATS_MM:
        cam_from_tool = rigid(rotation, tip_cam + (away_mm + retreat_mm) * shaft)
        length_mm = _length_mm(instrument, camera, cam_from_tool)
        if length_mm is None:
            return None
        model_from_tool = inverse_rigid(cam_from_model) @ cam_from_tool
        parts = [
            (TriangleMesh(transform_points(model_from_tool, mesh.vertices), mesh.faces), finish)
            for mesh, finish in instrument.parts(length_mm)
        ]
        meshes = [mesh for mesh, _ in parts]
        if not all((transform_points(cam_from_model, mesh.box)[:, 2] > 0).all() for mesh in meshes):
            return None
        if not any(room.touches(mesh, others) for mesh in meshes):
            return parts
    return None


def _place(instrument: Instrument, rng: np.random.Generator, camera: PinholeCamera) -> tuple[np.ndarray, float]:
    """The pixel below the tip, and the direction of the shaft in the image."""
    size, middle = np.array(camera.size_wh), (np.array(camera.size_wh) - 1) / 2
    if not instrument.from_side:
        pixel: np.ndarray = size * rng.uniform(0.1, 0.9, 2) - 0.5
        return pixel, rng.uniform(0, 2 * np.pi)
    towards = rng.uniform(0, 2 * np.pi)
    side = np.array([np.cos(towards), np.sin(towards)])
    # from the middle to the border of the image
    reach = float(np.min(middle / np.maximum(np.abs(side), 1e-9)))
    return middle + rng.uniform(0.4, 0.95) * reach * side, towards + np.radians(rng.normal(0, 20.0))


def _length_mm(instrument: Instrument, camera: PinholeCamera, cam_from_tool: np.ndarray) -> float | None:
    """The length that takes the instrument out of the image; ``None`` if it would come too near to the lens before."""
    ends, radius = instrument.tubes[-1].ends
    z, points = ends[:, 2], transform_points(cam_from_tool, ends)
    near = points[:, 2] < NEAREST * cam_from_tool[2, 3]
    first_near = int(np.argmax(near)) if near.any() else len(z)
    pixels, radius_px = camera.project(points[:first_near]), radius * camera.fx / np.maximum(points[:first_near, 2], 1)
    beyond = np.maximum(-0.5 - pixels, pixels - np.array(camera.size_wh) + 0.5).max(axis=1)
    out = np.flatnonzero(beyond > 2 * radius_px)
    return float(z[min(out[0] + int(BEYOND_MM / STEP_MM), first_near - 1)]) if len(out) else None


def places_doubt(mean: float, seed: int, room: Room, camera: PinholeCamera, poses: Sequence[np.ndarray]) -> str:
    """What there is to say if most instruments find no place in the first views, at their poses; empty otherwise."""
    drawn = [parts for view, pose in enumerate(poses) for parts in _drawn(mean, (seed, view), room, camera, pose)]
    without = drawn.count(None)
    if without <= len(drawn) / 2:
        return ""
    return (
        f"{without} of {len(drawn)} instruments find no place in the first {len(poses)} views, and are left out: they "
        "have the sizes of ear surgery, so the camera is too near, or the surface too small"
    )
