"""The level of HU that separates bone from everything else."""

import numpy as np

from ...errors import InputError
from ..volume import Volume

DEFAULT_HU = 300.0
"""Above soft tissue and below cortical bone."""

LOWEST_HU, HIGHEST_HU = 200.0, 700.0
"""Range of :func:`otsu_threshold`."""

_AIR_HU = -200
"""Up to here voxels do not count: the largest step in a CT of a head is that from air to skin."""

_PART = 1 << 21
"""Voxels that are counted at a time, which bounds the memory that it takes."""


def otsu_threshold(volume: Volume) -> float:
    """The threshold by Otsu (1979) of all voxels above -200 HU, kept within 200 to 700 HU.

    Returns
    -------
    The HU that separates soft tissue from bone: the largest value below it and the smallest above it belong to
    different classes.
    """
    counts = histogram(volume.values)[_AIR_HU + 2**15 + 1 :].astype(np.float64)
    hu = np.arange(_AIR_HU + 1, 2**15, dtype=np.float64)
    if not counts.any():
        raise InputError(
            f"threshold: expected tissue and bone, found no voxel above {_AIR_HU} HU; choose another volume"
        )
    below = np.cumsum(counts)
    above = below[-1] - below
    sum_below = np.cumsum(counts * hu)
    with np.errstate(divide="ignore", invalid="ignore"):
        between = below * above * (sum_below / below - (sum_below[-1] - sum_below) / above) ** 2
    # equal along a gap in the histogram: its middle is farthest from both classes
    best = np.flatnonzero(between == np.nanmax(np.where(above > 0, between, -1.0)))
    threshold = (hu[best[0]] + hu[best[-1]]) / 2 + 0.5
    return float(np.clip(threshold, LOWEST_HU, HIGHEST_HU))


def histogram(values: np.ndarray) -> np.ndarray:
    """``(65536,)`` number of voxels of each HU from -32768, of a ``(Z, Y, X)`` int16 array, in little memory."""
    counts = np.zeros(1 << 16, np.int64)
    rows = max(_PART // max(values[0].size, 1), 1)
    for first in range(0, len(values), rows):
        part = values[first : first + rows].astype(np.int32).ravel() + 2**15
        counts += np.bincount(part, minlength=1 << 16)
    return counts


def check_threshold(volume: Volume, level_hu: float) -> None:
    """Check that a threshold has voxels on both sides."""
    lowest, highest = int(volume.values.min()), int(volume.values.max())
    if not lowest < level_hu < highest:
        raise InputError(
            f"threshold: expected a level between the volume's {lowest} and {highest} HU, found {level_hu:g}; bone is "
            f"usually above {DEFAULT_HU:g} HU"
        )
