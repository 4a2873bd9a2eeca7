"""Doubts about a surface: its size, the place of what lies in it, and the precision of its numbers.

A mesh in metres that is read as millimetres is a thousand times too small. Blender's numbers, and those of most mesh
files, have 24 bits: a coordinate of size c is known to c times :data:`UNIT_ROUNDOFF`. Projected with f / z pixels per
mm, that is a shift of the edges in the views. The measurements of ``scripts/benchmarks/sweeps/camera.py`` agree.
"""

from dataclasses import dataclass

import numpy as np

from ..camera.pinhole import PinholeCamera
from ..files.numbers import MM_PER_UNIT, format_two_digits
from ..surface.mesh import TriangleMesh
from ..transforms import camera_centre, transform_points

SMALLEST_MM, LARGEST_MM = 1.0, 2000.0
"""Plausible extents of a surface: from an ossicle to a whole body."""

NEAREST_MM, FARTHEST_MM = 2.0, 30_000.0
"""Working distances outside this range indicate wrong units; an error by a factor of 1000 is always outside."""


@dataclass(frozen=True)
class SizeDoubt:
    """An implausible size.

    ``better_units`` is the unit with which it is plausible; ``None`` if there is none.
    """

    message: str
    better_units: str | None


def size_doubt(extents_mm: np.ndarray, units: str, camera: PinholeCamera | None, name: str) -> SizeDoubt | None:
    """Judge the size of a surface by itself, and by the distance from which it fills the frame.

    ``None`` if it is plausible.

    Parameters
    ----------
    extents_mm
        ``(3,)`` sides of its bounding box, mm, as converted from ``units``.
    units
        ``"mm"`` or ``"m"``: the unit in which the file's numbers were read.
    camera
        Intrinsics of the frame, px; ``None`` if they are not known yet.
    name
        Begins the message, such as the file's name.
    """
    if _is_plausible(extents_mm, camera):
        return None
    others = {unit: extents_mm * (factor / MM_PER_UNIT[units]) for unit, factor in MM_PER_UNIT.items() if unit != units}
    better = next((unit for unit, extents in others.items() if _is_plausible(extents, camera)), None)
    message = f"{name}: the surface is {size_text(extents_mm)} large if its numbers are {_WORDS[units]}"
    if camera is not None:
        message += f", and fills the frame from {_length_text(_filling_distance_mm(extents_mm, camera))}"
    if better is None:
        how = "multiply it by the true distance of two of its points over that in the file"
        return SizeDoubt(f"{message}, which is unusual; if its scale is not known, {how}", None)
    return SizeDoubt(f"{message}; in {_WORDS[better]} it would be {size_text(others[better])}: check the units", better)


def extents_of(mesh: TriangleMesh) -> np.ndarray:
    """``(3,)`` sides of the bounding box of a mesh, mm."""
    low, high = mesh.bounds
    return high - low


def size_text(extents_mm: np.ndarray) -> str:
    """Three sides in words: ``"83 x 60 x 41 mm"``."""
    return " x ".join(f"{side:.3g}" for side in extents_mm) + " mm"


_WORDS = {"mm": "millimetres", "m": "metres"}


def _is_plausible(extents_mm: np.ndarray, camera: PinholeCamera | None) -> bool:
    if not SMALLEST_MM <= extents_mm.max() <= LARGEST_MM:
        return False
    return camera is None or NEAREST_MM <= _filling_distance_mm(extents_mm, camera) <= FARTHEST_MM


def _filling_distance_mm(extents_mm: np.ndarray, camera: PinholeCamera) -> float:
    """The distance from which the surface is as large as the frame, mm."""
    return float(extents_mm.max()) * min(camera.fx, camera.fy) / max(camera.size_wh)


def _length_text(length_mm: float) -> str:
    return f"{length_mm:.3g} mm" if length_mm < 1000 else f"{length_mm / 1000:.3g} m"


ROOM = 0.25
"""How far from the surface's bounding box the centre of a structure may lie, relative to the box's diagonal."""

LARGEST, SMALLEST = 3.0, 1e-3
"""Plausible sizes of a structure relative to the surface."""


def place_doubt(bounds: np.ndarray, surface_bounds: np.ndarray, name: str, surface: str) -> str | None:
    """Judge the place and size of a structure.

    Parameters
    ----------
    bounds, surface_bounds
        ``(2, 3)`` smallest and largest coordinates, mm, in the frame of the surface's file.
    name, surface
        Of the structure and of the surface's file, for the message.

    Returns
    -------
    ``None`` if both are plausible, else what is not, with the change of axes or unit that would put it right.
    """
    if _is_in_place(bounds, surface_bounds):
        return None
    extents, surface_extents = bounds[1] - bounds[0], surface_bounds[1] - surface_bounds[0]
    message = (
        f"{name}: its middle lies {_outside_mm(bounds, surface_bounds):.4g} mm outside the box around {surface}, and "
        f"it is {size_text(extents)} large, {surface} {size_text(surface_extents)}"
    )
    for words, factors in _CHANGES.items():
        changed = np.sort(bounds * factors, axis=0)
        if _is_in_place(changed, surface_bounds):
            return f"{message}; {words} it would be in place: give it in the frame and unit of the surface"
    return f"{message}: is it in the frame and unit of the surface?"


_CHANGES = {
    "with x and y negated (from RAS to LPS)": np.array([-1.0, -1.0, 1.0]),
    "in metres": np.full(3, 1000.0),
    "in millimetres": np.full(3, 1e-3),
}


def _is_in_place(bounds: np.ndarray, surface_bounds: np.ndarray) -> bool:
    diagonal = float(np.linalg.norm(surface_bounds[1] - surface_bounds[0]))
    ratio = float(np.linalg.norm(bounds[1] - bounds[0])) / diagonal
    return SMALLEST <= ratio <= LARGEST and _outside_mm(bounds, surface_bounds) <= ROOM * diagonal


def _outside_mm(bounds: np.ndarray, surface_bounds: np.ndarray) -> float:
    """Distance of the middle of a box from another box; 0 inside it."""
    middle = bounds.mean(axis=0)
    return float(np.linalg.norm(np.maximum(np.maximum(surface_bounds[0] - middle, middle - surface_bounds[1]), 0)))


EXACT_PX = 0.01
"""How far edges of views may be from where K says: what the documentation promises."""

UNIT_ROUNDOFF = 2.0**-24
"""Largest relative error of a number in single precision (IEEE 754)."""

LONGEST_EXACT_FOCAL_PX = EXACT_PX / UNIT_ROUNDOFF
"""Focal length beyond which edges may be further off, for a surface nearer to its middle than to the camera."""

STORED_EXACTLY = 1e-3
"""Share of a step of single precision: coordinates this near to one all come from it."""


def precision_doubts(
    name: str, camera: PinholeCamera, mesh: TriangleMesh, mesh_from_model: np.ndarray, cam_from_model: np.ndarray
) -> list[str]:
    """Messages about edges that may be more than :data:`EXACT_PX` off; empty if none are.

    Parameters
    ----------
    name
        Name of the surface's file.
    camera
        Intrinsics of the frame, px.
    mesh
        In the model frame, mm, with some of it in front of the camera.
    mesh_from_model, cam_from_model
        4x4, mm.
    """
    depth = transform_points(cam_from_model, mesh.vertices)[:, 2]
    px_per_mm = max(camera.fx, camera.fy) / float(np.median(depth[depth > 0]))
    messages = []
    shown_px = UNIT_ROUNDOFF * px_per_mm * max(float(np.linalg.norm(camera_centre(cam_from_model))), mesh.radius)
    if shown_px > EXACT_PX:
        messages.append(
            f"K: {px_per_mm:.3g} px per mm is more than Blender's single precision resolves: edges in views are off by "
            f"up to {format_two_digits(shown_px)} px, elsewhere {EXACT_PX:g} px; check the focal length"
        )
    given = mesh.vertices + mesh_from_model[:3, 3]
    farthest = float(np.abs(given).max())
    step = float(np.spacing(np.float32(farthest)))
    stored_px = UNIT_ROUNDOFF * px_per_mm * farthest
    if stored_px > EXACT_PX and np.abs(given - given.astype(np.float32)).max() <= STORED_EXACTLY * step:
        messages.append(
            f"{name}: the surface lies up to {farthest / 1000:.3g} m from the origin of its file, whose single "
            f"precision has steps of {format_two_digits(step)} mm there: edges in views are off by up to "
            f"{format_two_digits(stored_px)} px; export it nearer to the origin, or with more digits"
        )
    return messages
