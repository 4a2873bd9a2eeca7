"""The burr under a pointer: where its ray meets the bone, drilled or not, and how near it comes to structures.

Many times a second, without a mesh of the bone, and by the vertices of structures, which lie a voxel apart.
What bone stays is decided by :mod:`oneframe.volume.drill.drill_guard`, exactly.
"""

from collections.abc import Callable, Iterator, Mapping

import numpy as np

from ...surface.mesh import TriangleMesh
from ...transforms import transform_points
from ..bone.isosurface import RemovedField
from ..volume import Sampler, Volume

STEP_VOXELS = 0.5
_FINE = 12
"""Samples between the last step in air and the first in bone."""

_MISSED_PX = 8.0
"""Between two places beside the bone, narrower bone is passed by."""

_EDGE_STEPS = 4.0
"""Where the bone lies deeper than this within a pixel, an edge hides what is between: no burr goes straight there."""

_SAMPLES = 24
"""On the way of a burr, in each of two passes."""


class BurrRoom:
    """The room that a burr has between structures.

    Parameters
    ----------
    structures
        Meshes by name, in the frame of the mesh, mm.
    margins_mm
        Thickness of bone that stays around them; those that are not named do not stop the burr.
    """

    def __init__(self, structures: Mapping[str, TriangleMesh], margins_mm: Mapping[str, float]) -> None:
        self.names = tuple(structures)
        points = [mesh.vertices for mesh in structures.values()]
        # single precision is quicker, and exact to 1e-5 mm near the middle
        self._middle = np.concatenate(points).mean(axis=0) if points else np.zeros(3)
        self._points = np.concatenate([np.zeros((0, 3)), *points]).astype(np.float64) - self._middle
        self._points = self._points.astype(np.float32)
        self._owner = np.repeat(np.arange(len(points)), [len(each) for each in points])
        margins = np.array([margins_mm.get(name, -np.inf) for name in self.names], np.float32)
        self._margin = margins[self._owner] if points else np.zeros(0, np.float32)
        self._widest = max([0.0, *map(float, margins)])

    def nearest(self, point: np.ndarray) -> tuple[str, float] | None:
        """Name of the structure nearest to a point ``(3,)``, and its distance, mm; ``None`` without structures."""
        if not self.names:
            return None
        squared = _squared(self._points, (point - self._middle).astype(np.float32))
        least = int(np.argmin(squared))
        return self.names[self._owner[least]], float(np.sqrt(squared[least]))

    def reached(self, start: np.ndarray, end: np.ndarray, radius_mm: float) -> np.ndarray | None:
        """The centre ``(3,)`` nearest to ``end``, on the way from ``start``, where a burr is in no margin, if any.

        A margin before it on the way does not count: the pointer may show the bone behind a structure.
        """
        middle, reach = (start + end) / 2, float(np.linalg.norm(end - start)) / 2 + radius_mm + self._widest
        close = _squared(self._points, (middle - self._middle).astype(np.float32)) < reach * reach
        points, margin = self._points[close] + self._middle, self._margin[close]
        shares = np.linspace(0.0, 1.0, _SAMPLES)
        # twice: the second time between two neighbours of the first
        for _ in range(2):
            squared = (_squared(points, start + at * (end - start)) for at in shares)
            room = [np.min(np.sqrt(each) - margin, initial=np.inf) for each in squared]
            free = np.flatnonzero(np.array(room) >= radius_mm)
            if not len(free):
                return None
            shares = np.linspace(shares[free[-1]], shares[min(free[-1] + 1, _SAMPLES - 1)], _SAMPLES)
        return start + shares[0] * (end - start)


def _squared(points: np.ndarray, centre: np.ndarray) -> np.ndarray:
    offset = points - centre
    return np.einsum("ij,ij->i", offset, offset)


def first_bone(
    volume: Volume,
    level_hu: float,
    solid: np.ndarray,
    removed: RemovedField | None,
    origin_mm: np.ndarray,
    direction: np.ndarray,
) -> np.ndarray | None:
    """The point ``(3,)`` where a ray enters bone, LPS mm; ``None`` if it misses.

    Parameters
    ----------
    level_hu, solid
        Bone lies above the level, in ``(Z, Y, X)`` bool.
    removed
        What was drilled away.
    origin_mm, direction
        ``(3,)`` of the ray in LPS; the direction has any length.
    """
    grid = volume.grid
    direction = np.asarray(direction, np.float64) / np.linalg.norm(direction)
    start = transform_points(grid.index_from_mesh, np.asarray(origin_mm, np.float64)[None])[0]
    step = grid.index_from_mesh[:3, :3] @ direction
    with np.errstate(divide="ignore", invalid="ignore"):
        ends = np.stack([(-0.5 - start) / step, (np.array(grid.size) - 0.5 - start) / step])
    outside = (step == 0) & ((start < -0.5) | (start > np.array(grid.size) - 0.5))
    ends = np.where(step == 0, np.array([[-np.inf], [np.inf]]), ends)
    near, far = max(float(ends.min(axis=0).max()), 0.0), float(ends.max(axis=0).min())
    if outside.any() or not near < far:
        return None
    stride = STEP_VOXELS * float(grid.spacing_mm.min())
    along = np.arange(near, far, stride)
    voxels = np.clip(np.rint(start + along[:, None] * step).astype(np.intp), 0, np.array(grid.size) - 1)
    inside = solid[voxels[:, 2], voxels[:, 1], voxels[:, 0]]
    if removed is not None:
        place = voxels - removed.first
        within = np.flatnonzero(inside & ((place >= 0) & (place < removed.distance_mm.shape[::-1])).all(axis=1))
        x, y, z = place[within].T
        inside[within] = removed.distance_mm[z, y, x] > 0
    hits = np.flatnonzero(inside)
    if len(hits) == 0:
        return None
    first = float(along[hits[0]])
    fine = np.linspace(max(first - 1.5 * stride, near), first, _FINE)
    points = np.asarray(origin_mm, np.float64) + fine[:, None] * direction
    bone = Sampler(grid, points).values(volume.values, outside=level_hu - 1) > level_hu
    if removed is not None:
        bone &= removed.sampled(grid, points, outside=1.0) > 0
    bone[-1] = True
    return points[int(np.argmax(bone))]


def way_over_bone(
    centre_at: Callable[[np.ndarray], np.ndarray | None], start_px: np.ndarray, end_px: np.ndarray, step_mm: float
) -> Iterator[np.ndarray | None]:
    """Where a burr goes while the pointer goes straight from one place ``(2,)`` to another, both included.

    ``centre_at`` gives the burr's centre ``(3,)``, mm, of a place of the pointer, px, or ``None`` where it does not
    drill; successive centres are ``step_mm`` apart.

    Yields
    ------
    Centres; ``None`` where the burr lifts off: beside the bone, and where the bone behind an edge begins.
    """

    def between(
        a: np.ndarray, b: np.ndarray, at_a: np.ndarray | None, at_b: np.ndarray | None
    ) -> Iterator[np.ndarray | None]:
        near = at_a is not None and at_b is not None and float(np.linalg.norm(at_b - at_a)) <= step_mm
        missed = at_a is None and at_b is None
        if near or np.linalg.norm(b - a) <= (_MISSED_PX if missed else 1.0):
            if at_a is None or at_b is None or float(np.linalg.norm(at_b - at_a)) > _EDGE_STEPS * step_mm:
                yield None
            yield at_b
            return
        middle = (a + b) / 2
        at_middle = centre_at(middle)
        yield from between(a, middle, at_a, at_middle)
        yield from between(middle, b, at_middle, at_b)

    first = centre_at(start_px)
    yield first
    yield from between(start_px, end_px, first, centre_at(end_px))
