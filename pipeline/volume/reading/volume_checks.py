"""What every volume must fulfil: before memory is taken axes, size, and that it fits; then its values."""

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

MOST_LABELS = 255
"""Different values in a label map; the largest segmentations of the body have 120."""

_ROUNDING = 0.05
"""How far labels may lie from whole numbers: stored by a scale in 8 bits, 25 labels are off by as much."""

_LEAST_COMB, _COMB = 12, 1.05
"""Slices that tell, and how much more neighbours may differ than slices with one between; in noise, as much."""

_LEAST_SPAN_HU = 100.0
"""Between the smallest and the largest value of a CT; less means that it was normalised."""


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


def check_slices(voxels: np.ndarray, where: str) -> None:
    """Check the slices ``(Z, Y, X)`` of a CT: neighbours are alike, and what lies outside of the scan is air."""
    some = voxels[:, ::2, ::2]
    near, far = (
        np.median([np.abs(np.subtract(*pair, dtype=np.int32)).mean() for pair in zip(some[step:], some, strict=False)])
        for step in (1, 2)
    )
    if len(voxels) >= _LEAST_COMB and near > _COMB * far:
        raise InputError(
            f"{where}: expected slices like their neighbours, found every second one alike: two volumes, such as two "
            "phases or reconstructions, are interleaved; export one of them"
        )
    highest = voxels.max()
    if (voxels[:, [0, 0, -1, -1], [0, -1, 0, -1]] == highest).all(axis=0).any():
        raise InputError(
            f"{where}: expected air outside of the scan, found the largest value, {highest}, in a corner of all "
            "slices: it is padding, and would become bone; set it to -1000"
        )


class ValueSurvey:
    """Range and variety of voxels, added part by part. Mutable: it grows with each part."""

    def __init__(self, not_finite: int = 0) -> None:
        """Begin with so many voxels that are no number."""
        self._lowest, self._highest = np.inf, -np.inf
        self._fractional: float | None = None
        self._not_finite = not_finite
        self._present = np.zeros(1 << 16, bool)

    def add(self, values: np.ndarray) -> None:
        """Look at an array of any real type and shape."""
        if values.dtype.kind == "f":
            finite = np.isfinite(values)
            if not finite.all():
                self._not_finite += int(values.size - np.count_nonzero(finite))
                values = values[finite]
            fractional = values[np.abs(values - np.rint(values)) > _ROUNDING]
            if self._fractional is None and len(fractional):
                self._fractional = float(fractional[0])
        if values.size:
            self._lowest = min(self._lowest, float(values.min()))
            self._highest = max(self._highest, float(values.max()))
            if self._lowest >= -(2**15) and self._highest < 2**16:
                # 65 536 values cover int16 and uint16: negative numbers count from the end
                self._present[np.rint(values).astype(np.int32).ravel() & 0xFFFF] = True

    @property
    def _range(self) -> str:
        return f"values from {self._lowest:.6g} to {self._highest:.6g}"

    def check_hounsfield(self, where: str) -> None:
        """Check that the voxels are those of a CT in Hounsfield units, where air is about -1000 and water 0."""
        expected = f"{where}: expected a CT in Hounsfield units (HU; air -1000, water 0), found"
        self._check_finite(expected)
        if self._lowest < -(2**15) or self._highest >= 2**15:
            raise InputError(
                f"{expected} {self._range}, beyond 16 bits: no HU, or padding; convert it to HU, with -1000 for padding"
            )
        if self._highest - self._lowest < _LEAST_SPAN_HU:
            raise InputError(f"{expected} {self._range}: labels, or normalised; take the original CT")
        if self._lowest >= 0:
            raise InputError(
                f"{expected} {self._range} and no negative ones: labels, not a CT, or the scanner's raw numbers; "
                "take a CT, or subtract the offset (often 1024)"
            )

    def check_labels(self, where: str) -> None:
        """Check that the voxels are labels: whole numbers from 0, of few different values."""
        expected = f"{where}: expected a label map (whole numbers from 0), found"
        self._check_finite(expected)
        if self._lowest < -_ROUNDING:
            raise InputError(f"{expected} {self._range}: give a CT as the volume, and 0 to what has no label")
        if self._fractional is not None:
            raise InputError(
                f"{expected} fractions such as {self._fractional:.4g}: probabilities, a resampled mask, or labels "
                "stored too coarsely; save the label of each voxel as a whole number"
            )
        if self._highest >= 2**16 - 0.5:
            raise InputError(f"{expected} {self._range}; the largest label is 65535: number them anew")
        variety = int(np.count_nonzero(self._present))
        if variety > MOST_LABELS:
            raise InputError(f"{expected} {variety} different {self._range}: it looks like an image, not labels")
        if self._highest < 0.5:
            raise InputError(f"{expected} 0 everywhere; it holds no structure: choose another file")

    @property
    def label_type(self) -> type[np.uint8] | type[np.uint16]:
        """The smallest type that holds all labels."""
        return np.uint8 if self._highest < 255.5 else np.uint16

    def _check_finite(self, expected: str) -> None:
        if self._not_finite:
            raise InputError(
                f"{expected} NaN or infinity in {self._not_finite:,} voxels; replace them (-1000 in a CT, 0 in labels)"
            )
