"""Where the slices of a DICOM series lie, and what keeps them from being a volume.

Slices are placed by their Image Position and Image Orientation (Patient) alone (DICOM PS3.3 C.7.6.2): names, numbers
and stated thicknesses of slices are often wrong. Positions are projected on the normal of the slices; they must follow
each other in equal steps, along the normal.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...errors import InputError
from ..volume import VoxelGrid

FEWEST_SLICES = 3

LARGEST_DEVIATION = 0.05
"""How far a slice may lie from its place in equal steps, in steps."""

ROUNDED_MM, LARGEST_ROUNDING_MM = 0.1, 0.06
"""What archives round positions to; half of it, and a little for the fit."""

LARGEST_DRIFT = 0.1
"""How far the stack may shift across its normal, in pixels; more is the tilt of the gantry."""


@dataclass(frozen=True)
class SlicePlace:
    """Where a slice lies.

    Attributes
    ----------
    size
        Number of columns and rows.
    spacing_mm
        ``(2,)`` distance of columns, and of rows.
    axes
        ``(2, 3)`` unit directions, LPS, of growing columns and of growing rows.
    position_mm
        ``(3,)`` LPS centre of the first pixel.
    """

    size: tuple[int, int]
    spacing_mm: np.ndarray
    axes: np.ndarray
    position_mm: np.ndarray


def stack_of(places: Sequence[SlicePlace], where: str) -> tuple[VoxelGrid, np.ndarray]:
    """The grid of slices given in any order, and their order ``(N,)`` along the normal."""
    first = places[0]
    if len(places) < FEWEST_SLICES:
        raise InputError(f"{where}: expected a series of at least {FEWEST_SLICES} slices, found {len(places)}")
    _check_alike(places, where)
    normal = np.cross(*first.axes)
    positions = np.stack([place.position_mm for place in places])
    order = np.argsort(positions @ normal, kind="stable")
    positions = positions[order]
    tenths = positions / ROUNDED_MM
    rounding_mm = LARGEST_ROUNDING_MM if np.abs(tenths - np.rint(tenths)).max() < 1e-4 else 0.0
    step, start = _equal_steps(positions @ normal, rounding_mm, where)
    _check_tilt(positions, normal, max(LARGEST_DRIFT * float(first.spacing_mm.min()), 2 * rounding_mm), where)
    matrix = np.eye(4)
    matrix[:3, 0] = first.axes[0] * first.spacing_mm[0]
    matrix[:3, 1] = first.axes[1] * first.spacing_mm[1]
    matrix[:3, 2] = normal * step
    matrix[:3, 3] = positions[0] + (start - positions[0] @ normal) * normal
    return VoxelGrid((*first.size, len(places)), matrix), order


def _check_alike(places: Sequence[SlicePlace], where: str) -> None:
    first = places[0]
    sizes = sorted({place.size for place in places})
    if len(sizes) > 1:
        found = " and ".join(f"{columns} x {rows}" for columns, rows in sizes[:3])
        raise InputError(f"{where}: expected slices of one size, found {found} pixels; export one series of them")
    spacings = np.stack([place.spacing_mm for place in places])
    if np.ptp(spacings, axis=0).max() > 1e-3 * spacings.min():
        raise InputError(
            f"{where}: expected slices of one pixel spacing, found {spacings.min():.4g} to {spacings.max():.4g} mm; "
            "export one series of them"
        )
    if any(np.abs(place.axes - first.axes).max() > 1e-3 for place in places):
        raise InputError(
            f"{where}: expected parallel slices, found some that are turned; a localizer may be among them: export the "
            "axial series alone"
        )


def _equal_steps(along_mm: np.ndarray, rounding_mm: float, where: str) -> tuple[float, float]:
    """The step of sorted distances along the normal, which must be equally spaced, and where they start."""
    steps = np.diff(along_mm)
    together = int(np.count_nonzero(steps < 0.01 * max(float(np.median(steps)), 0.1)))
    if together:
        raise InputError(
            f"{where}: expected one slice at each place, found {together} place{'s'[: together > 1]} with several; "
            "several reconstructions or times, or a slice and its copy, are in one series: export one of them"
        )
    step, start = np.polyfit(np.arange(len(along_mm)), along_mm, 1)
    if np.abs(along_mm - start - step * np.arange(len(along_mm))).max() <= max(LARGEST_DEVIATION * step, rounding_mm):
        return float(step), float(start)
    gap = int(np.argmax(steps))
    raise InputError(
        f"{where}: expected slices in equal steps, found steps of {steps.min():.4g} to {steps[gap]:.4g} mm, the "
        f"largest after slice {gap + 1} of {len(along_mm)}, counted along the series: where slices are missing, copy "
        "or export it again; where it was taken so, resample it to equal steps, for example with dcm2niix or 3D Slicer"
    )


def _check_tilt(positions: np.ndarray, normal: np.ndarray, largest_mm: float, where: str) -> None:
    """Check that slices lie above each other, not shifted as by a tilted gantry."""
    offsets = positions - positions[0]
    across = offsets - (offsets @ normal)[:, None] * normal
    drift_mm = float(np.linalg.norm(across, axis=1).max())
    if drift_mm > largest_mm:
        angle_deg = np.rad2deg(np.arctan2(drift_mm, float((offsets @ normal)[-1])))
        raise InputError(
            f"{where}: expected slices straight above each other, found them shifted as by a gantry tilted by "
            f"{angle_deg:.2f}°, {drift_mm:.1f} mm in all; resample the series upright, for example with dcm2niix or "
            "with 3D Slicer (DICOM: acquisition geometry regularization)"
        )
