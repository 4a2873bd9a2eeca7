"""How near a drill came to each structure, on the surface that is written."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ...surface.deviation import SurfaceTree
from ...surface.mesh import TriangleMesh
from ..bone.isosurface import Isosurface, RemovedField
from ..volume import VoxelGrid

_FEW = 100
_ROUNDING_MM = 1e-3


@dataclass(frozen=True)
class Clearance:
    """The smallest distance of what the drill made from a structure.

    Attributes
    ----------
    structure
        Its name.
    margin_mm
        What the plan asks for; ``None`` if nothing.
    smallest_mm
        Found; negative by the depth to which the drill went into the structure, as far as that is known.
    at
        ``(3,)`` where, on the drilled surface or in the structure, in the frame of the mesh, mm.
    """

    structure: str
    margin_mm: float | None
    smallest_mm: float
    at: np.ndarray


def clearances(
    surface: Isosurface,
    removed: RemovedField,
    grid: VoxelGrid,
    structures: Mapping[str, TriangleMesh],
    margins_mm: Mapping[str, float],
) -> tuple[Clearance, ...]:
    """The clearance of each structure, the nearest first; none if nothing of the surface is drilled.

    It is measured at vertices, midpoints of edges and centres of faces.

    Parameters
    ----------
    surface
        As written: smoothed and simplified.
    removed
        What the drill removed, on ``grid``: bone may be missing all around a structure that the drill went through,
        which the surface alone does not show.
    structures
        Meshes by name, in the frame of the mesh.
    margins_mm
        What the plan asks for.
    """
    mesh, drilled = surface.mesh, surface.drilled
    if not drilled.any():
        return ()
    # a flat face around a round structure comes nearer than its corners
    corners = mesh.vertices[mesh.faces[drilled[mesh.faces].all(axis=1)]]
    middles = (corners + np.roll(corners, 1, axis=1)) / 2
    made = np.concatenate([mesh.vertices[drilled], middles.reshape(-1, 3), corners.mean(axis=1)])
    found = []
    for name, structure in structures.items():
        tree = SurfaceTree(structure)
        # a few first: they rule out most of the others
        distance = tree.distances(made, float(tree.distances(made[:: max(len(made) // _FEW, 1)]).min()))
        nearest = int(np.argmin(distance))
        smallest, at = float(distance[nearest]), made[nearest]
        left = removed.sampled(grid, structure.vertices, outside=np.inf)
        deepest = int(np.argmin(left))
        if left[deepest] < 0:
            smallest, at = float(left[deepest]), structure.vertices[deepest]
        found.append(Clearance(name, margins_mm.get(name), smallest, at))
    return tuple(sorted(found, key=lambda each: each.smallest_mm))


def violations(found: Sequence[Clearance]) -> list[str]:
    """A sentence for each margin that was not held."""
    sentences = []
    for each in found:
        place = f"({', '.join(f'{value:.1f}' for value in each.at)}) mm"
        if each.smallest_mm < 0:
            sentences.append(f"{each.structure}: the drill went {-each.smallest_mm:.2f} mm into it, at {place}")
        elif each.margin_mm is not None and each.smallest_mm < each.margin_mm - _ROUNDING_MM:
            sentences.append(
                f"{each.structure}: expected a margin of {each.margin_mm:g} mm, found {each.smallest_mm:.2f} mm at "
                f"{place}"
            )
    return sentences
