"""The surface where a volume crosses a level: the triangles of scikit-image's marching cubes, with vertices of its own.

The table of Lorensen & Cline (SIGGRAPH 1987), as scikit-image has it, is asked for material and air alone; so every
vertex is the middle of an edge of the grid, between two neighbouring voxels, and the surface is closed. It is then
moved to where the linear interpolation of the values leaves the material. Around the volume lies air. A drill is a
second field, and a vertex lies at whichever of the two crossings is nearer to the material: the bone's own surface
keeps its vertices, bit by bit, and the drilled one is as exact as the drill's distances, whatever the grey values.
"""

from dataclasses import dataclass

import numpy as np

from ...surface.mesh import TriangleMesh
from ...transforms import transform_points
from ..volume import VoxelGrid, box_around, box_slices

NEAREST_TO_VOXEL = 1 / 1024
"""Least distance of a vertex from the voxels of its edge, in edges: no triangle shrinks to a point, not even when it
is written in single precision."""

_FAR_MM = 1e9


@dataclass(frozen=True)
class RemovedField:
    """What a drill removed, in a box of the volume; outside the box nothing is removed.

    Attributes
    ----------
    first
        ``(3,)`` the box's first voxel (x, y, z) in the volume.
    distance_mm
        ``(z, y, x)`` float32 signed distance to the removed solid near its surface: positive where bone stays.
    """

    first: np.ndarray
    distance_mm: np.ndarray

    @property
    def slices(self) -> tuple[slice, ...]:
        """The box in an array of the volume."""
        return box_slices(self.first, self.first + self.distance_mm.shape[::-1])

    def sampled(self, grid: VoxelGrid, points: np.ndarray, *, outside: float) -> np.ndarray:
        """``(N,)`` distances at points ``(N, 3)``, LPS mm, trilinearly, and another number ``outside`` the box.

        ``grid`` is that of the volume.
        """
        # slow to import, and of use where something was removed only
        from scipy.ndimage import map_coordinates

        place = (transform_points(grid.index_from_mesh, points) - self.first)[:, ::-1]
        # up to half a voxel outside the outermost centres the nearest counts
        within = ((place >= -0.5) & (place <= np.array(self.distance_mm.shape) - 0.5)).all(axis=1)
        found = map_coordinates(self.distance_mm, place.T, order=1, mode="nearest", output=np.float64)
        return np.where(within, found, outside)


@dataclass(frozen=True)
class Isosurface:
    """A closed surface.

    Attributes
    ----------
    mesh
        In the frame of the mesh (LPS), mm; fronts towards air.
    drilled
        ``(V,)`` bool: the vertices that the drill made, not the bone's own surface.
    """

    mesh: TriangleMesh
    drilled: np.ndarray


def isosurface(
    values: np.ndarray,
    level: float,
    grid: VoxelGrid,
    *,
    solid: np.ndarray | None = None,
    removed: RemovedField | None = None,
) -> Isosurface:
    """The closed surface of the material, half a voxel outside the volume where material touches its border.

    Parameters
    ----------
    values
        ``(Z, Y, X)`` finite numbers; material lies above ``level``. In a volume of integers a whole ``level`` counts as
        half of one more, so that no voxel lies on it.
    solid
        ``(Z, Y, X)`` bool: the voxels of material, where they are not all those above the level, such as those of one
        component, its holes filled. Between two voxels whose values do not tell where the material ends, it ends
        halfway.
    removed
        What a drill removed from them.
    """
    # slow to import, and of use for a CT only
    from skimage.measure import marching_cubes

    if values.dtype == np.bool_:
        values = values.view(np.uint8)
    if np.issubdtype(values.dtype, np.integer):
        level = level + 0.5 if float(level).is_integer() else level
    else:
        level = float(values.dtype.type(level))
    material = values > level if solid is None else solid
    inside = material if removed is None else material.copy()
    if removed is not None:
        inside[removed.slices] &= removed.distance_mm > 0
    if not inside.any():
        return Isosurface(TriangleMesh(np.empty((0, 3)), np.empty((0, 3), np.int32)), np.empty(0, np.bool_))
    first, stop = box_around(inside)
    box = np.pad(inside[box_slices(first, stop)], 1)
    middles, faces, _, _ = marching_cubes(box.astype(np.float32), 0.5, method="lorensen")

    # voxels (z, y, x) at the ends of each vertex's edge
    axis = np.argmax(middles % 1, axis=1)
    lower = np.floor(middles).astype(np.intp) + first[::-1] - 1
    upper = lower + np.eye(3, dtype=np.intp)[axis]
    leaving = box[tuple(np.floor(middles).astype(np.intp).T)]
    within, air = (np.where(leaving[:, None], *ends) for ends in ((lower, upper), (upper, lower)))
    is_voxel = ((air >= 0) & (air < values.shape)).all(axis=1)
    above = values[tuple(within.T)] - np.float64(level)
    below = values[tuple(np.clip(air, 0, np.array(values.shape) - 1).T)] - np.float64(level)
    share = np.full(len(middles), 0.5)
    np.divide(above, above - below, out=share, where=(above > 0) & (below <= 0) & is_voxel)
    drilled = np.zeros(len(middles), np.bool_)
    if removed is not None:
        kept = _distance(removed, air)
        at = np.flatnonzero(kept <= 0)
        rest = _distance(removed, within[at])
        cut = rest / (rest - kept[at])
        # the air may have been material before
        was_material = is_voxel[at]
        was_material[was_material] = material[tuple(air[at][was_material].T)]
        nearer = was_material | (cut < share[at])
        share[at[nearer]], drilled[at[nearer]] = cut[nearer], True
    share = np.clip(share, NEAREST_TO_VOXEL, 1 - NEAREST_TO_VOXEL)

    points = lower[:, ::-1].astype(np.float64)
    points[np.arange(len(points)), 2 - axis] += np.where(leaving, share, 1 - share)
    vertices = transform_points(grid.mesh_from_index, points)
    faces = faces[:, ::-1] if grid.is_left_handed else faces
    return Isosurface(TriangleMesh(vertices, np.ascontiguousarray(faces, np.int32)), drilled)


def _distance(removed: RemovedField, voxels: np.ndarray) -> np.ndarray:
    """``(N,)`` mm, the distance to what was removed at voxels ``(N, 3)``, (z, y, x); far, outside the box."""
    place = voxels - removed.first[::-1]
    within = ((place >= 0) & (place < removed.distance_mm.shape)).all(axis=1)
    distance = np.full(len(voxels), _FAR_MM)
    distance[within] = removed.distance_mm[tuple(place[within].T)]
    return distance
