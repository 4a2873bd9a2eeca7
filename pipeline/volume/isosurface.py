"""The surface where a volume crosses a level: marching cubes with shared vertices, in slabs of bounded memory."""

from dataclasses import dataclass

import numpy as np

from ..surface.mesh import TriangleMesh


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
