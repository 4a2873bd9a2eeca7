"""What a drill must spare: structures, and a margin around each."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np

from ...errors import InputError
from ...surface.deviation import SurfaceTree
from ...surface.mesh import TriangleMesh
from ...transforms import transform_points
from ..volume import VoxelGrid, box_slices
from .filled import filled

BLOCK = 16
"""Voxels along an axis of the blocks whose distances are computed, once and when they are asked for. They are always
the same blocks, so that the numbers do not depend on what was asked before."""

_EXACT_VOXELS = 1.01
"""Depths are exact so near to where a margin ends: both ends of an edge of the grid that it crosses are."""


@dataclass(frozen=True)
class _Structure:
    """A structure; ``inside`` (z, y, x) bool from voxel ``first`` on."""

    margin_mm: float
    tree: SurfaceTree
    first: np.ndarray
    inside: np.ndarray


class DrillGuard:
    """What bone must stay around structures, on the grid of a volume.

    Mutable: a block that was computed is kept.

    Parameters
    ----------
    grid
        Of the volume.
    structures
        Closed meshes (LPS, mm) by name.
    margins_mm
        Least thickness that stays around structures; those that are not named are not spared.

    Raises
    ------
    InputError
        A mesh is not closed, or there is a margin of a structure that is not there: it would protect nothing.
    """

    def __init__(
        self, grid: VoxelGrid, structures: Mapping[str, TriangleMesh], margins_mm: Mapping[str, float]
    ) -> None:
        check_margins(margins_mm, structures)
        self._grid = grid
        self._structures = [
            _Structure(margin, SurfaceTree(structures[name]), *filled(structures[name], grid))
            for name, margin in margins_mm.items()
        ]
        self._blocks: dict[tuple[int, ...], np.ndarray | None] = {}

    def spare(self, distance_mm: np.ndarray, first: np.ndarray) -> None:
        """Raise distances to a removed solid, in place, to how deep the voxels lie in a margin.

        Parameters
        ----------
        distance_mm
            ``(z, y, x)`` float32 of the box that begins at voxel ``first`` (x, y, z), negative where bone is removed.
        """
        stop = first + distance_mm.shape[::-1]
        low, high = first // BLOCK, (stop - 1) // BLOCK + 1
        for place in np.ndindex(*(high - low)):
            key = tuple(int(at) for at in low + place)
            if key not in self._blocks:
                self._blocks[key] = self._depth(np.array(key) * BLOCK)
            block = self._blocks[key]
            if block is None:
                continue
            at = np.array(key) * BLOCK
            begin, end = np.maximum(first, at), np.minimum(stop, at + BLOCK)
            part = distance_mm[box_slices(begin - first, end - first)]
            np.maximum(part, block[box_slices(begin - at, end - at)], out=part)

    def _depth(self, first: np.ndarray) -> np.ndarray | None:
        """``(z, y, x)`` float32, how deep the voxels of a block lie in a margin, mm; ``None`` if none does."""
        size = np.minimum(first + BLOCK, self._grid.size) - first
        deepest: np.ndarray | None = None
        for structure in self._structures:
            depth = self._depth_around(structure, first, size)
            if depth is not None:
                deepest = depth if deepest is None else np.maximum(deepest, depth)
        return deepest

    def _depth_around(self, structure: _Structure, first: np.ndarray, size: np.ndarray) -> np.ndarray | None:
        spacing, margin = self._grid.spacing_mm, structure.margin_mm
        band = _EXACT_VOXELS * float(spacing.max())
        inside = _part_of(structure, first, size)
        far = float(np.linalg.norm(spacing * (size - 1))) / 2 + margin + band
        middle = self._placed((first + (size - 1) / 2)[None])
        if float(structure.tree.distances(middle, far)[0]) > far and not inside.any():
            return None
        places = np.moveaxis(np.indices(inside.shape)[::-1], 0, -1).reshape(-1, 3) + first
        distance = structure.tree.distances(self._placed(places), margin + band).reshape(inside.shape)
        return (margin - np.where(inside, -distance, distance)).astype(np.float32)

    def _placed(self, index: np.ndarray) -> np.ndarray:
        """``(N, 3)`` points of index space in the frame of the mesh."""
        return transform_points(self._grid.mesh_from_index, index)


def check_margins(margins_mm: Collection[str], structures: Collection[str]) -> None:
    """Check that there is a structure of the name for each margin.

    Raises
    ------
    InputError
        There is none: the margin would protect nothing.
    """
    missing = sorted(set(margins_mm) - set(structures))
    if missing:
        raise InputError(
            f"margins: expected structures of the label map ({', '.join(sorted(structures)) or 'there are none'}), "
            f"found {', '.join(missing)}; give labels that have them, with their names in labels.json, dataset.json or "
            "ITK-SNAP's label descriptions (.txt) beside them, or remove their margins"
        )


def _part_of(structure: _Structure, first: np.ndarray, size: np.ndarray) -> np.ndarray:
    """``(z, y, x)`` bool: which voxels of a box lie in a structure."""
    inside = np.zeros(size[::-1], np.bool_)
    low = np.maximum(structure.first, first)
    high = np.minimum(structure.first + structure.inside.shape[::-1], first + size)
    if (high > low).all():
        here, there = box_slices(low - first, high - first), box_slices(low - structure.first, high - structure.first)
        inside[here] = structure.inside[there]
    return inside
