"""What the header of every volume must fulfil before memory is taken: axes, size, and that it fits."""

from collections.abc import Sequence

import numpy as np

from ...errors import InputError
from ...files.machine import available_bytes
from ...transforms import transform_points
from ..volume import box_corners

SMALLEST_SPACING_MM, LARGEST_SPACING_MM = 0.005, 20.0
"""Plausible distances of voxels; others mean another unit than mm."""

_SAME_PLACE_VOXELS, _SAME_TURN = 0.1, 1e-3
"""How far apart two transforms of a header may be; near half turns, a quaternion in single precision is off by up to
8e-4 radians."""


def check_axes(mesh_from_index: np.ndarray, where: str) -> None:
    """Check the axes of voxels: finite, a plausible spacing, at right angles."""
    axes = mesh_from_index[:3, :3]
    spacing = np.linalg.norm(axes, axis=0)
    if not (np.isfinite(mesh_from_index).all() and (spacing > 0).all()):
        raise InputError(
            f"{where}: expected a spacing and an orientation, found zero, NaN or infinity; export it again"
        )
    if spacing.min() < SMALLEST_SPACING_MM or spacing.max() > LARGEST_SPACING_MM:
        raise InputError(
            f"{where}: expected voxels of {SMALLEST_SPACING_MM:g} to {LARGEST_SPACING_MM:g} mm, found "
            f"{' x '.join(f'{step:.4g}' for step in spacing)} mm; the header states another unit than it means: "
            "correct its spacing"
        )
    unit = axes / spacing
    cosine = np.abs(unit.T @ unit - np.eye(3)).max()
    if cosine > 1e-3:
        raise InputError(
            f"{where}: expected axes at right angles, found them sheared by {np.rad2deg(np.arcsin(min(cosine, 1))):.2f}"
            "°; resample it to an upright grid, for example in 3D Slicer (Resample Scalar Volume)"
        )


def apart_mm(one: np.ndarray, other: np.ndarray, size: tuple[int, int, int]) -> float:
    """How far apart two ``(4, 4)`` transforms place a corner voxel; 0 if no farther than headers round."""
    ends = box_corners(np.zeros(3), np.array(size) - 1.0)
    places = transform_points(one, ends)
    distance = np.linalg.norm(transform_points(other, ends) - places, axis=1)
    rounding = _SAME_PLACE_VOXELS * np.linalg.norm(one[:3, :3], axis=0).min()
    same = distance <= rounding + _SAME_TURN * np.linalg.norm(places - places[0], axis=1)
    return 0.0 if same.all() else float(distance.max())


def three_dimensions(dims: Sequence[int], where: str) -> tuple[int, int, int]:
    """The size of a volume; a fourth dimension may only have one entry."""
    found = " x ".join(map(str, dims[:8]))
    if any(count != 1 for count in dims[3:]):
        raise InputError(
            f"{where}: expected a volume of 3 dimensions, found {len(dims)} ({found}); save one volume of it, such as "
            "one point in time"
        )
    if len(dims) < 3 or min(dims[:3]) < 2:
        raise InputError(
            f"{where}: expected a volume of at least 2 voxels along each of 3 axes, found {found or 'none'}; a single "
            "slice has no surface"
        )
    return dims[0], dims[1], dims[2]


def check_memory(needed: int, size: Sequence[int], where: str) -> None:
    """Check that reading a volume fits into memory."""
    free = available_bytes()
    if needed > free:
        raise InputError(
            f"{where}: expected a volume that fits into memory, found one of {' x '.join(map(str, size))} voxels, "
            f"which takes {needed / 2**30:.1f} GB to read, and {free / 2**30:.1f} GB are free; crop or resample it, "
            "for example in 3D Slicer (Crop Volume)"
        )
