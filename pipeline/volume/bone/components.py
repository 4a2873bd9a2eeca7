"""The connected parts of a mask of voxels, by runs along x.

A run is a row of voxels of the mask; runs of neighbouring rows that overlap belong together. A CT has far fewer runs
than voxels, so little memory is needed beside that of the mask.
"""

from dataclasses import dataclass

import numpy as np

_LAYERS = 16
"""Layers whose runs are found at a time, which bounds the memory that it takes."""


@dataclass(frozen=True)
class Components:
    """Parts of a mask whose voxels touch by their faces.

    Attributes
    ----------
    start, stop
        ``(R,)`` first voxel of each run and one past its last, counted as if each row had one voxel more.
    part
        ``(R,)`` number of the run's part, 0 to P - 1.
    voxels
        ``(P,)`` number of voxels of each part.
    """

    start: np.ndarray
    stop: np.ndarray
    part: np.ndarray
    voxels: np.ndarray

    def paint(self, mask: np.ndarray, parts: np.ndarray, value: bool) -> None:
        """Set the voxels of the parts that ``(P,)`` bool selects, in the ``(Z, Y, X)`` mask or one of its shape."""
        depth, height, width = mask.shape
        chosen = parts[self.part]
        layer = height * (width + 1)
        for first in range(0, depth, _LAYERS):
            block = mask[first : first + _LAYERS]
            at = slice(*np.searchsorted(self.start, [first * layer, (first + len(block)) * layer]))
            runs = chosen[at]
            # +1 where a run begins, -1 where it ends
            change = np.zeros(len(block) * layer + 1, np.int8)
            change[self.start[at][runs] - first * layer] = 1
            change[self.stop[at][runs] - first * layer] = -1
            inside = np.cumsum(change[:-1], dtype=np.int8).view(np.bool_).reshape(len(block), height, width + 1)
            block[inside[:, :, :-1]] = value

    def touching_border(self, shape: tuple[int, ...]) -> np.ndarray:
        """``(P,)`` bool: the parts with a voxel in the outermost layers of a mask of this ``shape`` (Z, Y, X)."""
        depth, height, width = shape
        row, x = np.divmod(self.start, width + 1)
        z, y = np.divmod(row, height)
        ends = x + self.stop - self.start
        outer = (z == 0) | (z == depth - 1) | (y == 0) | (y == height - 1) | (x == 0) | (ends == width)
        found = np.zeros(len(self.voxels), np.bool_)
        found[self.part[outer]] = True
        return found


def components(mask: np.ndarray) -> Components:
    """The parts of a ``(Z, Y, X)`` bool mask."""
    height, width = mask.shape[1:]
    start, stop = _runs(mask)
    row = start // (width + 1)
    links = []
    for rows, has_next in ((1, row % height < height - 1), (height, np.ones(len(row), np.bool_))):
        run = np.flatnonzero(has_next)
        shift = rows * (width + 1)
        first = np.searchsorted(stop, start[run] + shift, side="right")
        count = np.searchsorted(start, stop[run] + shift, side="left") - first
        end = np.cumsum(count)
        other = np.arange(end[-1] if len(end) else 0) + np.repeat(first - end + count, count)
        links.append((np.repeat(run, count), other))
    root = _joined(len(start), *(np.concatenate(ends).astype(np.int32) for ends in zip(*links, strict=True)))
    _, part = np.unique(root, return_inverse=True)
    part = part.reshape(-1)
    return Components(start, stop, part, np.bincount(part, stop - start).astype(np.int64))


def _runs(mask: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Start and stop of all runs, in order."""
    depth, height, width = mask.shape
    found = []
    for first in range(0, depth, _LAYERS):
        block = mask[first : first + _LAYERS]
        # one voxel more in front of the block and after each row, which ends the runs
        padded = np.zeros((len(block) * height, width + 1), np.bool_)
        padded[:, :width] = block.reshape(-1, width)
        flat = np.concatenate([np.zeros(1, np.bool_), padded.ravel()])
        found.append(np.flatnonzero(flat[1:] != flat[:-1]) + first * height * (width + 1))
    changes = np.concatenate(found)
    return changes[::2], changes[1::2]


def _joined(count: int, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """``(count,)`` the least member of each one's part, where ``a`` and ``b`` (L,) are linked.

    All trees at once: the roots of linked ones are joined, the paths halved until they are short, and links within a
    tree dropped (Shiloach & Vishkin, "An O(log n) parallel connectivity algorithm", Journal of Algorithms 1982).
    """
    parent = np.arange(count, dtype=np.int32)
    while len(a):
        larger, smaller = np.maximum(parent[a], parent[b]), np.minimum(parent[a], parent[b])
        apart = larger != smaller
        a, b = a[apart], b[apart]
        parent[larger[apart]] = smaller[apart]
        while not np.array_equal(shorter := parent[parent], parent):
            parent = shorter
    return parent
