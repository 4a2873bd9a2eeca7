"""A virtual drill in a volume: what the strokes of a plan remove, and how near they come to structures.

Removing the solids of all strokes is the minimum of their signed distances, and keeping the margins of structures the
maximum with how deep a voxel lies in one (constructive solid geometry on implicit functions: Ricci, "A constructive
geometry for computer graphics", 1973). Neither depends on an order.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ...errors import InputError
from ...surface.deviation import squared_triangle_distances
from ...surface.mesh import TriangleMesh
from ...transforms import transform_points
from ..bone.isosurface import Isosurface, RemovedField
from ..volume import VoxelGrid, box_slices
from .drill_plan import DrillPlan, check_margins

FAR_MM = np.float32(1e3)
"""Distance where nothing is removed."""

_REACH_VOXELS = 2.0
"""Around a stroke and a margin, where distances count: both ends of an edge of the grid that is cut lie there."""

_NEIGHBOURS = 12
"""Faces with the nearest centres, one of which is the nearest where faces are of about one size."""

_FEW = 100
_ROUNDING_MM = 1e-3

_PAIRS = 1 << 20
"""Pairs of a triangle and a row that are looked at together, which bounds the memory."""

_SHIFT = np.array([0.0, np.pi, np.e]) * 1e-7
"""Voxels: so that no row of the grid on which a mesh was made runs through its vertices."""


def removed_by_plan(plan: DrillPlan, grid: VoxelGrid, structures: Mapping[str, TriangleMesh]) -> RemovedField | None:
    """What a plan removes from a volume with these structures, closed meshes by name; ``None`` without strokes."""
    check_margins(plan.margins_mm, structures)
    if not plan.strokes:
        return None
    spacing = grid.spacing_mm
    capsules = []
    for stroke in plan.strokes:
        # in mm along the axes of the index, which are orthogonal, so that distances are the same
        points = transform_points(grid.index_from_mesh, stroke.points) * spacing
        for start, end in zip(
            points[: max(len(points) - 1, 1)], points[1:] if len(points) > 1 else points, strict=True
        ):
            reach = stroke.radius_mm + _REACH_VOXELS * spacing
            first = np.clip(np.ceil((np.minimum(start, end) - reach) / spacing), 0, grid.size).astype(np.int64)
            stop = np.clip(np.floor((np.maximum(start, end) + reach) / spacing) + 1, first, grid.size).astype(np.int64)
            capsules.append((stroke.radius_mm, start, end, first, stop))
    low, high = np.min([each[3] for each in capsules], axis=0), np.max([each[4] for each in capsules], axis=0)
    distance = np.full((high - low)[::-1], FAR_MM, np.float32)
    for radius_mm, start, end, first, stop in capsules:
        part = distance[box_slices(first - low, stop - low)]
        np.minimum(part, _capsule_mm(radius_mm, start, end, (first, stop), spacing), out=part)
    removed = RemovedField(low, distance)
    for name, margin in plan.margins_mm.items():
        _spare(removed, grid, structures[name], margin)
    return removed


def _capsule_mm(
    radius_mm: float, start: np.ndarray, end: np.ndarray, box: tuple[np.ndarray, np.ndarray], spacing_mm: np.ndarray
) -> np.ndarray:
    """``(z, y, x)`` float32 signed distances of the voxels of a box to a capsule, negative inside, mm."""
    # from its start, so that single precision is enough far from the origin too
    x, y, z = (
        (np.arange(a, b) * step - at).astype(np.float32) for a, b, step, at in zip(*box, spacing_mm, start, strict=True)
    )
    y, z = y[:, None], z[:, None, None]
    way = (end - start).astype(np.float32)
    squared = way @ way
    if squared > 0:
        along = np.clip((x * way[0] + y * way[1] + z * way[2]) / squared, 0, 1)
        x, y, z = x - along * way[0], y - along * way[1], z - along * way[2]
    return np.sqrt(x * x + y * y + z * z) - np.float32(radius_mm)


def _spare(removed: RemovedField, grid: VoxelGrid, structure: TriangleMesh, margin_mm: float) -> None:
    """Raise the distances, in place, to how deep the voxels lie in the margin around a structure."""
    band = margin_mm + _REACH_VOXELS * float(grid.spacing_mm.max())
    depth, height, width = removed.distance_mm.shape
    box = grid.shifted(removed.first, (width, height, depth))
    inside = np.zeros(removed.distance_mm.shape, np.bool_)
    first, own = filled(structure, box)
    inside[box_slices(first, first + own.shape[::-1])] = own
    lower, upper = structure.bounds + np.array([[-band], [band]])
    places = np.argwhere(removed.distance_mm < FAR_MM)
    points = transform_points(box.mesh_from_index, places[:, ::-1].astype(np.float64))
    near = ((points >= lower) & (points <= upper)).all(axis=1)
    places, points = places[near], points[near]
    at = tuple(places.T)
    distance = surface_distances(points, structure, band)
    deep = (margin_mm - np.where(inside[at], -distance, distance)).astype(np.float32)
    removed.distance_mm[at] = np.maximum(removed.distance_mm[at], deep)


def surface_distances(points: np.ndarray, mesh: TriangleMesh, within_mm: float = np.inf) -> np.ndarray:
    """``(N,)`` distances of many points ``(N, 3)`` from a mesh of faces of about one size, mm.

    Beyond ``within_mm`` they are only some larger distance.
    """
    # not before there is a plan: it takes long to import
    from scipy.spatial import cKDTree

    corners = mesh.vertices[mesh.faces]
    centres = mesh.face_centres
    reach = within_mm + float(np.linalg.norm(corners - centres[:, None], axis=2).max())
    tree = cKDTree(centres)
    found, _ = tree.query(points, distance_upper_bound=reach)
    close = np.flatnonzero(np.isfinite(found))
    count = min(_NEIGHBOURS, len(centres))
    _, faces = tree.query(points[close], k=count)
    for face in faces.reshape(-1, count).T:
        a, b, c = corners[face].transpose(1, 2, 0)
        squared = squared_triangle_distances(b - a, c - a, points[close].T - a)
        found[close] = np.minimum(found[close], np.sqrt(squared))
    return found


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
        # a few first: they rule out most of the others
        few = surface_distances(made[:: max(len(made) // _FEW, 1)], structure)
        distance = surface_distances(made, structure, float(few.min()))
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


def filled(mesh: TriangleMesh, grid: VoxelGrid) -> tuple[np.ndarray, np.ndarray]:
    """The voxels of a grid whose centres lie inside a closed mesh (LPS, mm).

    Returns
    -------
    The first voxel ``(3,)`` (x, y, z) of the box that holds them, and ``(z, y, x)`` bool; empty outside the grid.
    """
    points = transform_points(grid.index_from_mesh, mesh.vertices) + _SHIFT
    first = np.clip(np.ceil(points.min(axis=0)), 0, grid.size).astype(np.int64)
    stop = np.maximum(np.clip(np.floor(points.max(axis=0)) + 1, 0, grid.size).astype(np.int64), first)
    width, height, depth = (int(count) for count in stop - first)
    if not width * height * depth:
        return first, np.zeros((0, 0, 0), np.bool_)
    points -= first
    # the last column counts what lies beyond the box
    crossed = np.zeros((depth * height, width + 1), np.uint8)
    corners = points[mesh.faces][:, :, 1:]
    low = np.maximum(np.ceil(corners.min(axis=1)), 0).astype(np.int64)
    high = np.minimum(np.floor(corners.max(axis=1)), [height - 1, depth - 1]).astype(np.int64)
    extent = np.maximum(high - low + 1, 0)
    count = extent[:, 0] * extent[:, 1]
    ends = np.cumsum(count)
    face = 0
    while face < len(count):
        done = int(ends[face - 1]) if face else 0
        last = max(int(np.searchsorted(ends, done + _PAIRS)), face + 1)
        owner = np.repeat(np.arange(face, last), count[face:last])
        place = np.arange(len(owner)) - (ends - count)[owner] + done
        y, z = low[owner, 0] + place % extent[owner, 0], low[owner, 1] + place // extent[owner, 0]
        hit, x = _crossings(points, mesh.faces[owner], y, z)
        column = np.clip(np.ceil(x), 0, width).astype(np.int64)
        np.bitwise_xor.at(crossed.reshape(-1), (z[hit] * height + y[hit]) * (width + 1) + column, 1)
        face = last
    parity = np.bitwise_xor.accumulate(crossed, axis=1)
    if parity[:, -1].any():
        raise InputError("structure: expected a closed mesh, found one with holes; close them")
    return first, np.ascontiguousarray(parity[:, :-1]).reshape(depth, height, width).view(np.bool_)


def _crossings(points: np.ndarray, faces: np.ndarray, y: np.ndarray, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Which of the rows along x at (y, z) cross triangles ``(N, 3)``, as indices, and at what x."""
    weights, left = [], []
    for a, b in ((1, 2), (2, 0), (0, 1)):
        # always from the vertex of the lower number, so that both faces of an edge agree to the last bit
        i, j = faces[:, a], faces[:, b]
        p, q = points[np.minimum(i, j)], points[np.maximum(i, j)]
        area = (q[:, 1] - p[:, 1]) * (z - p[:, 2]) - (q[:, 2] - p[:, 2]) * (y - p[:, 1])
        weights.append(np.where(i < j, area, -area))
        left.append((area >= 0) ^ (i > j))
    hit = np.flatnonzero((left[0] == left[1]) & (left[1] == left[2]))
    share = np.stack([weight[hit] for weight in weights], axis=1)
    total = share.sum(axis=1)
    total[total == 0] = 1.0
    return hit, np.einsum("nk,nk->n", share, points[faces[hit], 0]) / total
