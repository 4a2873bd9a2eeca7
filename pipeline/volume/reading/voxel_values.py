"""What the voxels of a file hold: Hounsfield units, labels, or neither."""

import numpy as np

from ...errors import InputError

MOST_LABELS = 255
"""Different values in a label map; the largest segmentations of the body have 120."""

_FEW = 64
"""Up to so many different values, and none negative, it is a label map rather than a CT."""

_ROUNDING = 0.05
"""How far labels may lie from whole numbers: stored by a scale in 8 bits, 25 labels are off by as much."""

_LEAST_SPAN_HU = 100.0
"""Between the smallest and the largest value of a CT; less means that it was normalised."""


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
    def _variety(self) -> int:
        return int(np.count_nonzero(self._present))

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
        if self._lowest >= 0 and self._fractional is None and self._variety <= _FEW:
            raise InputError(
                f"{expected} {self._variety} different {self._range}: it looks like a label map; give it as labels, "
                "and the CT as the volume"
            )
        if self._highest - self._lowest < _LEAST_SPAN_HU:
            raise InputError(f"{expected} {self._range}: it looks normalised; take the original")
        if self._lowest >= 0:
            raise InputError(
                f"{expected} {self._range} and no negative ones: not a CT, or the scanner's raw numbers; "
                "take a CT, or subtract the offset (often 1024)"
            )

    def check_labels(self, where: str) -> None:
        """Check that the voxels are labels: whole numbers from 0, of few different values."""
        expected = f"{where}: expected a label map (whole numbers from 0), found"
        self._check_finite(expected)
        if self._lowest < -_ROUNDING:
            raise InputError(f"{expected} {self._range}: it looks like a CT; give it as the volume")
        if self._fractional is not None:
            raise InputError(
                f"{expected} fractions such as {self._fractional:.4g}: probabilities, a resampled mask, or labels "
                "stored too coarsely; save the label of each voxel as a whole number"
            )
        if self._highest >= 2**16 - 0.5:
            raise InputError(f"{expected} {self._range}; the largest label is 65535: number them anew")
        if self._variety > MOST_LABELS:
            raise InputError(f"{expected} {self._variety} different {self._range}: it looks like an image, not labels")
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
