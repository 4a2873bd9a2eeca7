"""How near a burr comes to structures, many times a second: by their vertices, which lie a voxel apart.

For what a pointer shows. What bone stays is decided by :mod:`oneframe.volume.drill.drill_guard`, exactly.
"""

from collections.abc import Mapping

import numpy as np

from ...surface.mesh import TriangleMesh

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

    def reached(self, start: np.ndarray, end: np.ndarray, radius_mm: float) -> np.ndarray:
        """The centre ``(3,)`` up to which a burr comes from ``start`` towards ``end``: where a margin begins."""
        middle, reach = (start + end) / 2, float(np.linalg.norm(end - start)) / 2 + radius_mm + self._widest
        close = _squared(self._points, (middle - self._middle).astype(np.float32)) < reach * reach
        if not close.any():
            return end
        points, margin = self._points[close] + self._middle, self._margin[close]
        first, last = 0.0, 1.0
        # twice: the second time between two neighbours of the first
        for _ in range(2):
            shares = np.linspace(first, last, _SAMPLES)
            for number, share in enumerate(shares):
                centre = start + share * (end - start)
                if np.min(np.sqrt(_squared(points, centre)) - margin) < radius_mm:
                    if number == 0:
                        return start + first * (end - start)
                    first, last = shares[number - 1], share
                    break
            else:
                return start + last * (end - start)
        return start + first * (end - start)


def _squared(points: np.ndarray, centre: np.ndarray) -> np.ndarray:
    offset = points - centre
    return np.einsum("ij,ij->i", offset, offset)
