"""A virtual drill: spherical burrs that remove bone from a distance field.

A burr at rest removes a ball; a stroke is a row of balls whose spacing sets the height of the ridges (scallops)
between them. In a field that is positive in bone, removing a solid is the minimum of the field and the signed distance
to the solid, negative inside (constructive solid geometry on implicit functions: Ricci, "A constructive geometry for
computer graphics", 1973).
"""

import numpy as np

from .distance_field import ImplicitGrid


def subtract_burrs(grid: ImplicitGrid, centres: np.ndarray, radii: np.ndarray) -> None:
    """Remove burrs from the bone of a grid; the cost of each burr depends on its own size only.

    Parameters
    ----------
    grid
        Changed in place, within two grid spacings around each burr: the new surface is never farther away.
    centres
        ``(N, 3)`` centres of the burrs, mm, in the frame of the grid; they may lie outside it.
    radii
        ``(N,)`` radii of the burrs, mm.
    """
    for centre, radius in zip(centres.astype(np.float32), radii.astype(np.float32), strict=True):
        reach = radius + 2 * grid.spacing
        part, (x, y, z) = grid.box(centre - reach, centre + reach)
        distance = np.sqrt((x - centre[0]) ** 2 + (y - centre[1]) ** 2 + (z - centre[2]) ** 2) - radius
        np.minimum(grid.values[part], distance, out=grid.values[part])
