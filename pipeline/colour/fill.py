"""Colours for surface that the frame did not see: the observed ones, continued smoothly over the surface.

The mesh's graph is coarsened until every connected part is one node: the vertices that share their neighbour of highest
priority become one. On the way up a node takes the mean of the colours known in it. On the way down, nodes without a
known colour start from the value of the coarser node that holds them and are then smoothed, so that each is the mean of
its neighbours: nearly the harmonic function with the observed colours as boundary values. Far from them, where only
coarse nodes know a colour, it approaches means over ever larger parts of the observed surface.

All values are weighted means of observed colours, so none exceeds their range. Colours travel along the surface, never
through space; parts that touch no observed surface get the mean of all observed colours.

References: Gortler et al., "The lumigraph", SIGGRAPH 1996 (pull-push); Bornemann & Deuflhard, "The cascadic multigrid
method for elliptic problems", Numerische Mathematik 75, 1996 (smoothing from coarse to fine, more on coarse levels).
"""

from dataclasses import dataclass

import numpy as np

SWEEPS, MOST_SWEEPS = 4, 64
"""Smoothing sweeps on the finest level, doubled from level to level, and their largest number."""

SHRINKAGE = 0.9
"""Coarsening ends when a level keeps more than this fraction of its nodes."""


@dataclass(frozen=True)
class _Graph:
    """Nodes 0 to ``size`` - 1, and edges in both directions: ``(E,)`` ends, ordered by the first, and weights."""

    size: int
    first: np.ndarray
    second: np.ndarray
    weight: np.ndarray

    def smoothed(self, values: np.ndarray, free: np.ndarray, sweeps: int) -> np.ndarray:
        """``(N, C)`` values after damped Jacobi sweeps over the nodes that are ``(N,)`` bool free."""
        inner = free[self.first]
        number = np.cumsum(free) - 1
        first, second, weight = number[self.first[inner]], self.second[inner], self.weight[inner]
        count = int(np.count_nonzero(free))
        total = np.bincount(first, weight, count)
        reached = np.flatnonzero(free)[total > 0]
        values = values.copy()
        for _ in range(sweeps):
            means = [
                np.bincount(first, weight * channel[second], count)[total > 0] / total[total > 0]
                for channel in values.T
            ]
            # undamped sweeps would let neighbours swap their values for ever
            values[reached] = (values[reached] + np.stack(means, axis=1)) / 2
        return values

    def coarsened(self) -> tuple[np.ndarray, "_Graph"]:
        """``(N,)`` node of the coarser graph that holds each node, and that graph."""
        priority = _scattered(np.arange(self.size, dtype=np.uint32))
        best = priority.copy()
        np.minimum.at(best, self.first, priority[self.second])
        # as each priority belongs to one node
        held, holder = np.unique(best, return_inverse=True)
        return holder, _graph(len(held), holder[self.first], holder[self.second], self.weight)


def _graph(size: int, first: np.ndarray, second: np.ndarray, weight: np.ndarray) -> _Graph:
    """A graph from edges in both directions; edges of a node to itself are dropped, parallel ones become one."""
    apart = first != second
    key, place = np.unique(first[apart].astype(np.int64) * size + second[apart], return_inverse=True)
    return _Graph(size, key // size, key % size, np.bincount(place, weight[apart], len(key)))


def _scattered(index: np.ndarray) -> np.ndarray:
    """Distinct uint32 numbers without visible order (the finaliser of MurmurHash3)."""
    for shift, factor in ((16, 0x85EBCA6B), (13, 0xC2B2AE35)):
        index = (index ^ (index >> np.uint32(shift))) * np.uint32(factor)
    return index ^ (index >> np.uint32(16))


def filled_colours(vertices: np.ndarray, faces: np.ndarray, rgb: np.ndarray, known: np.ndarray) -> np.ndarray:
    """``(V, 3)`` float32: the colours of some vertices, continued over a mesh.

    Parameters
    ----------
    vertices, faces
        ``(V, 3)`` and ``(F, 3)``; vertices at one place count as one.
    rgb
        ``(V, 3)`` code values 0..1.
    known
        ``(V,)`` bool: the vertices whose colours are known.

    Raises
    ------
    ValueError
        No colour is known.
    """
    if not known.any():
        raise ValueError("expected vertices with known colours, found none")
    places, place = np.unique(np.ascontiguousarray(vertices, np.float64).view("V24").ravel(), return_inverse=True)
    size = len(places)
    a, b, c = place[faces].T
    first, second = np.concatenate([a, b, c, b, c, a]), np.concatenate([b, c, a, a, b, c])
    graphs, holders = [_graph(size, first, second, np.ones(len(first)))], []
    colour, weight = _means(rgb[known], place[known], np.ones(np.count_nonzero(known)), size)
    levels = [(colour, (weight > 0).astype(float))]
    while len(graphs[-1].first):
        holder, coarser = graphs[-1].coarsened()
        if coarser.size > SHRINKAGE * graphs[-1].size:
            break
        colour, weight = levels[-1]
        graphs.append(coarser)
        holders.append(holder)
        levels.append(_means(colour, holder, weight, coarser.size))
    values = np.repeat(rgb[known].mean(axis=0, dtype=np.float64)[None], graphs[-1].size, axis=0)
    for level in range(len(graphs) - 1, -1, -1):
        if level < len(holders):
            values = values[holders[level]]
        colour, weight = levels[level]
        values = np.where(weight[:, None] > 0, colour, values)
        values = graphs[level].smoothed(values, weight == 0, min(SWEEPS << level, MOST_SWEEPS))
    result = values[place].astype(np.float32)
    result[known] = rgb[known]
    return result


def _means(colour: np.ndarray, node: np.ndarray, weight: np.ndarray, size: int) -> tuple[np.ndarray, np.ndarray]:
    """``(size, C)`` weighted means of the colours in each node, and ``(size,)`` their weights."""
    total = np.bincount(node, weight, size)
    sums = np.stack([np.bincount(node, weight * channel, size) for channel in colour.T], axis=1)
    return np.divide(sums, total[:, None], out=np.zeros_like(sums), where=total[:, None] > 0), total
