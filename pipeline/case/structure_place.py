"""Whether a structure lies where its surface is: one of another frame or unit is far off, or of another size."""

import numpy as np

from .surface_size import size_text

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
    if _is_plausible(bounds, surface_bounds):
        return None
    extents, surface_extents = bounds[1] - bounds[0], surface_bounds[1] - surface_bounds[0]
    message = (
        f"{name}: its middle lies {_outside_mm(bounds, surface_bounds):.4g} mm outside the box around {surface}, and "
        f"it is {size_text(extents)} large, {surface} {size_text(surface_extents)}"
    )
    for words, factors in _CHANGES.items():
        changed = np.sort(bounds * factors, axis=0)
        if _is_plausible(changed, surface_bounds):
            return f"{message}; {words} it would be in place: give it in the frame and unit of the surface"
    return f"{message}: is it in the frame and unit of the surface?"


_CHANGES = {
    "with x and y negated (from RAS to LPS)": np.array([-1.0, -1.0, 1.0]),
    "in metres": np.full(3, 1000.0),
    "in millimetres": np.full(3, 1e-3),
}


def _is_plausible(bounds: np.ndarray, surface_bounds: np.ndarray) -> bool:
    diagonal = float(np.linalg.norm(surface_bounds[1] - surface_bounds[0]))
    ratio = float(np.linalg.norm(bounds[1] - bounds[0])) / diagonal
    return SMALLEST <= ratio <= LARGEST and _outside_mm(bounds, surface_bounds) <= ROOM * diagonal


def _outside_mm(bounds: np.ndarray, surface_bounds: np.ndarray) -> float:
    """Distance of the middle of a box from another box; 0 inside it."""
    middle = bounds.mean(axis=0)
    return float(np.linalg.norm(np.maximum(np.maximum(surface_bounds[0] - middle, middle - surface_bounds[1]), 0)))
