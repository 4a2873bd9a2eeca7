"""The couch under the patient: the solid that is the same in every slice and crosses the volume from side to side."""

import numpy as np

from ..volume import Volume
from .components import components

AIR_HU = -500
"""Half-way from air to the couch, so its blurred front counts as couch."""

LEAST_WIDTH_MM = 150.0
"""A narrower volume shows a part of the patient, and no couch that could be told from it."""
LEAST_SHARE = 0.9
"""Of the slices in which a pixel of the couch is solid."""


def without_couch(volume: Volume, bone: np.ndarray) -> np.ndarray:
    """Take the couch, and what lies behind it, out of a mask where it touches the patient.

    Parameters
    ----------
    bone
        ``(Z, Y, X)`` bool.

    Returns
    -------
    ``bone`` itself if the volume shows no couch.
    """
    # the axes of the array that run to the patient's left, back and head, if they are oblique: most nearly
    toward = volume.grid.mesh_from_index[:3, :3] / volume.grid.spacing_mm
    axes = [2 - int(np.argmax(np.abs(toward[patient]))) for patient in range(3)]
    if len(set(axes)) < 3:
        return bone
    across, back, along = axes
    width_mm = volume.values.shape[across] * volume.grid.spacing_mm[2 - across]
    if width_mm < LEAST_WIDTH_MM:
        return bone
    solid = np.zeros([volume.values.shape[axis] for axis in (back, across)], np.int32)
    for layer in np.moveaxis(volume.values, (along, back, across), (0, 1, 2)):
        solid += layer > AIR_HU
    share = solid / volume.values.shape[along]
    if toward[1, 2 - back] < 0:
        share = share[::-1]
    behind = _behind_front(share >= LEAST_SHARE)
    if behind is None:
        return bone
    if toward[1, 2 - back] < 0:
        behind = behind[::-1]
    result = bone.copy()
    np.moveaxis(result, (along, back, across), (0, 1, 2))[:, behind] = False
    return result


def _behind_front(same: np.ndarray) -> np.ndarray | None:
    """``(back, across)`` bool, True from the couch's front on, from what is the same in all slices."""
    rows = len(same)
    parts = components(same[None])
    for part in range(len(parts.voxels)):
        region = parts.part[0] == part + 1
        if region[:, 0].any() and region[:, -1].any() and not region[: rows // 2].any():
            front = np.argmax(region, axis=0)
            front[~region.any(axis=0)] = rows
            return np.arange(rows)[:, None] >= front
    return None
