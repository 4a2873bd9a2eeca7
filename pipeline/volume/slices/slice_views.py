"""Axial, coronal and sagittal slices through a volume, with what was made of it."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from ...images.slice_picture import Colour, Contour, Slice
from ..bone.isosurface import RemovedField
from ..volume import LabelMap, Sampler, Volume

WIDTH_PX = 1800
"""Width of the three slices together, if they are not too high."""
HEIGHT_PX = 900
BONE_COLOUR = (1.0, 0.85, 0.1)
DRILL_COLOUR = (0.95, 0.25, 0.15)
GREY_HU = (-1000.0, 1600.0)
"""Black and white."""

_PLANES = (("AXIAL", 0, 1, "RLAP"), ("CORONAL", 0, 2, "RLSI"), ("SAGITTAL", 1, 2, "APSI"))
"""Title, axes of LPS to the right and down (z runs up), and directions at the left, right, top and bottom."""


@dataclass(frozen=True)
class LabelColours:
    """A label map and the colours, sRGB 0..1, of the labels that are drawn."""

    labels: LabelMap
    colours: dict[int, Colour]


@dataclass(frozen=True)
class DrawnBone:
    """What is drawn over the grey values.

    The contour of ``level_hu`` is the bone's, where ``solid``, ``(Z, Y, X)`` bool, lets it count; of that, what is
    removed is tinted and has a contour, as labels have.
    """

    level_hu: float
    solid: np.ndarray | None = None
    removed: RemovedField | None = None
    structures: Sequence[LabelColours] = ()


def slice_views(volume: Volume, centre_mm: np.ndarray, drawn: DrawnBone) -> tuple[Slice, Slice, Slice]:
    """Three slices in planes of LPS, however the voxels lie, which meet in ``(3,)`` ``centre_mm``."""
    lower, upper = volume.grid.bounds_mm
    extent = upper - lower
    mm_per_px = max(
        sum(extent[right] for _, right, _, _ in _PLANES) / WIDTH_PX,
        max(extent[down] for _, _, down, _ in _PLANES) / HEIGHT_PX,
    )
    return tuple(  # type: ignore[return-value]
        _slice_view(volume, centre_mm, plane, mm_per_px, drawn) for plane in _PLANES
    )


def _slice_view(
    volume: Volume, centre_mm: np.ndarray, plane: tuple[str, int, int, str], mm_per_px: float, drawn: DrawnBone
) -> Slice:
    title, right, down, directions = plane
    lower, upper = volume.grid.bounds_mm
    width, height = (max(2, round((upper - lower)[axis] / mm_per_px)) for axis in (right, down))
    points = np.empty((height, width, 3))
    points[:] = centre_mm
    points[:, :, right] = lower[right] + (np.arange(width) + 0.5) * mm_per_px
    rows = (np.arange(height) + 0.5) * mm_per_px
    points[:, :, down] = (lower[down] + rows if down == 1 else upper[down] - rows)[:, None]
    points = points.reshape(-1, 3)

    def plane_of(values: np.ndarray) -> np.ndarray:
        return values.reshape(height, width)

    voxels = Sampler(volume.grid, points)
    hu = plane_of(voxels.values(volume.values, outside=GREY_HU[0]))
    bone = hu - np.float32(drawn.level_hu)
    counts = None if drawn.solid is None else plane_of(voxels.values(drawn.solid, outside=0)) > 0
    tinted, contours = None, [Contour(bone, BONE_COLOUR, counts)]
    if (removed := drawn.removed) is not None:
        # distances are known near the surface only; where they end, they would jump
        far = float(np.linalg.norm(volume.grid.spacing_mm))
        kept = plane_of(removed.sampled(volume.grid, points, outside=far, farthest_mm=far))
        was_bone = bone > 0 if counts is None else (bone > 0) & counts
        tinted = was_bone & (kept <= 0)
        contours.append(Contour(kept, DRILL_COLOUR, was_bone))
    for each in drawn.structures:
        voxels = Sampler(each.labels.grid, points)
        for value, colour in each.colours.items():
            share = plane_of(voxels.values(each.labels.values, outside=0, of=partial(np.equal, value)))
            if share.any():
                contours.append(Contour(share - np.float32(0.5), colour))
    grey = np.clip((hu - GREY_HU[0]) / (GREY_HU[1] - GREY_HU[0]), 0, 1)
    across = 3 - right - down
    title = f"{title} {'XYZ'[across]} {centre_mm[across]:.1f}"
    return Slice(title, grey, mm_per_px, directions, tuple(contours), tinted)
