"""Views of a surface from far apart: which of many poses to take, so that few of them see it from all sides."""

from collections.abc import Sequence

import numpy as np

from ..transforms import camera_centre


def spread_views(poses: Sequence[np.ndarray], count: int, taken: Sequence[np.ndarray] = ()) -> list[int]:
    """Choose poses one by one, each the farthest in angle from the nearest one before (Gonzalez 1985).

    Parameters
    ----------
    poses, taken
        ``(4, 4)`` cam_from_model, mm: those to choose from, and those that are there already.
    count
        How many at most.

    Returns
    -------
    Indices in ``poses``, in the order in which they were chosen.
    """
    views = _directions(poses)
    # cosine of the angle to the nearest chosen view
    nearest = np.max(views @ _directions(taken).T, axis=1, initial=-1.0)
    chosen: list[int] = []
    while len(chosen) < min(count, len(poses)):
        index = int(np.argmin(nearest))
        chosen.append(index)
        nearest = np.maximum(nearest, views @ views[index])
        nearest[chosen] = np.inf
    return chosen


def _directions(poses: Sequence[np.ndarray]) -> np.ndarray:
    """``(N, 3)`` unit vectors from the surface's middle, the origin of its frame, to the cameras."""
    centres = np.array([camera_centre(pose) for pose in poses]).reshape(-1, 3)
    return centres / np.linalg.norm(centres, axis=1, keepdims=True)
