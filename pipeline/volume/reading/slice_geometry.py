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
"""How far a slice may lie from its place in equal steps, in steps; headers round to 0.1 mm or less."""

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
    _check_steps(positions @ normal, where)
    _check_tilt(positions, normal, float(first.spacing_mm.min()), where)
    step = (positions[-1] - positions[0]) @ normal / (len(places) - 1)
    matrix = np.eye(4)
    matrix[:3, 0] = first.axes[0] * first.spacing_mm[0]
    matrix[:3, 1] = first.axes[1] * first.spacing_mm[1]
    matrix[:3, 2] = normal * step
    matrix[:3, 3] = positions[0]
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


def _check_steps(along_mm: np.ndarray, where: str) -> None:
    """Check that sorted distances along the normal are equally spaced."""
    steps = np.diff(along_mm)
    together = int(np.count_nonzero(steps < 0.01 * max(float(np.median(steps)), 0.1)))
    if together:
        raise InputError(
            f"{where}: expected one slice at each place, found {together} place{'s'[: together > 1]} with several; "
            "several reconstructions or times are in one series: export one of them"
        )
    # gaps do not count
    typical = float(np.median(steps[steps < 1.5 * steps.min()]))
    if np.abs(along_mm - np.linspace(along_mm[0], along_mm[-1], len(along_mm))).max() <= LARGEST_DEVIATION * typical:
        return
    counts = steps / typical
    gaps = np.flatnonzero(np.rint(counts) >= 2)
    if len(gaps) and np.abs(counts - np.rint(counts)).max() <= 2 * LARGEST_DEVIATION:
        missing = int((np.rint(counts[gaps]) - 1).sum())
        after = ", ".join(str(gap + 1) for gap in gaps[:5]) + (", ..." if len(gaps) > 5 else "")
        raise InputError(
            f"{where}: expected slices every {typical:.4g} mm, {missing} {'is' if missing == 1 else 'are'} missing "
            f"(after slice {after} of {len(along_mm)}, counted along the series); copy or export the series again"
        )
    raise InputError(
        f"{where}: expected slices in equal steps, found steps of {steps.min():.4g} to {steps.max():.4g} mm; "
        "resample the series to equal steps, for example with dcm2niix or 3D Slicer"
    )


def _check_tilt(positions: np.ndarray, normal: np.ndarray, pixel_mm: float, where: str) -> None:
    """Check that slices lie above each other, not shifted as by a tilted gantry."""
    offsets = positions - positions[0]
    across = offsets - (offsets @ normal)[:, None] * normal
    drift_mm = float(np.linalg.norm(across, axis=1).max())
    if drift_mm > LARGEST_DRIFT * pixel_mm:
        angle_deg = np.rad2deg(np.arctan2(drift_mm, float((offsets @ normal)[-1])))
        raise InputError(
            f"{where}: expected slices straight above each other, found them shifted as by a gantry tilted by "
            f"{angle_deg:.2f}°, {drift_mm:.1f} mm in all; resample the series upright, for example with dcm2niix or "
            "with 3D Slicer (DICOM: acquisition geometry regularization)"
        )
