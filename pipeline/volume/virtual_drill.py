"""A virtual drill: spherical burrs that take bone away from a distance field.

A burr held still removes a ball; a stroke is a row of balls, close enough to each other for the ridges (scallops)
between them to be as high as wanted. In a field that is positive in bone, taking a solid away is the minimum of the
field and the signed distance to the solid, negative inside (constructive solid geometry on implicit functions:
Ricci, "A constructive geometry for computer graphics", 1973).
"""

import numpy as np

from .distance_field import ImplicitGrid


def subtract_burrs(grid: ImplicitGrid, centres: np.ndarray, radii: np.ndarray) -> None:
    """Take burrs away from the bone of a grid, each within its own box, so that its size is what it costs.

    Parameters
    ----------
    grid
        Changed in place, within two grid spacings round each burr: farther away no surface can be.
    centres
        ``(N, 3)`` of the burrs, mm, in the frame of the grid; they may lie outside it.
    radii
        ``(N,)`` mm.
    """
    for centre, radius in zip(centres.astype(np.float32), radii.astype(np.float32), strict=True):
        reach = radius + 2 * grid.spacing
        part, (x, y, z) = grid.box(centre - reach, centre + reach)
        distance = np.sqrt((x - centre[0]) ** 2 + (y - centre[1]) ** 2 + (z - centre[2]) ** 2) - radius
        np.minimum(grid.values[part], distance, out=grid.values[part])
