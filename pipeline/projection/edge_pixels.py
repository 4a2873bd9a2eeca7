"""Which pixels of an exact view need more than one ray, and where in the pixel these go."""

import numpy as np

from ..camera.pinhole import PinholeCamera
from .z_buffer import inverse_depth_map

STEP_PX = 2.0
"""An edge departs from the plane of its neighbours by this depth at least, in pixel footprints (depth / f).

It takes in creases sharper than about 60 degrees, beside which surface may hide within a pixel.
"""


def edge_pixels(depth_mm: np.ndarray, observed: np.ndarray, camera: PinholeCamera) -> np.ndarray:
    """``(H, W)`` bool: pixels on both sides of silhouettes, of depth steps, and of the border of observed surface.

    Parameters
    ----------
    depth_mm
        ``(H, W)`` at the pixels' centres, 0 for background.
    observed
        ``(H, W)`` bool at the pixels' centres.
    camera
        The view's intrinsics.

    Notes
    -----
    Inverse depth is affine in the pixel on a plane, so its second difference along rows and columns tells steps from
    slopes however steep they are. Background, with inverse depth 0, needs no case of its own.
    """
    edges = np.zeros(depth_mm.shape, dtype=bool)
    if min(depth_mm.shape) < 3:
        return ~edges
    inverse_depth = inverse_depth_map(depth_mm)
    for f, swapped in ((camera.fx, False), (camera.fy, True)):
        # always along the last axis
        w, seen, out = (a.T if swapped else a for a in (inverse_depth, observed, edges))
        bend = np.abs(w[:, :-2] + w[:, 2:] - 2 * w[:, 1:-1]) > np.float32(STEP_PX / f) * w[:, 1:-1]
        out[:, 1:-1] |= bend
        out[:, 0] |= bend[:, 0]
        out[:, -1] |= bend[:, -1]
        change = seen[:, 1:] != seen[:, :-1]
        out[:, 1:] |= change
        out[:, :-1] |= change
    return edges


def pixel_pattern(count: int) -> np.ndarray:
    """``(count, 2)`` points in a pixel, -0.5..0.5, whose mean estimates the mean over the pixel.

    One point in each of ``count`` columns and rows (rooks on a chessboard), in the order of a Fibonacci lattice: with
    8 points the area on one side of a random straight edge is known to 0.057 (root mean square; 0.068 by Sobol's
    points, 0.11 by random ones).

    References: Niederreiter, "Random number generation and quasi-Monte Carlo methods", 1992, chapter 5.
    """
    index = np.arange(count)
    golden = (np.sqrt(5) - 1) / 2
    row = np.argsort(np.argsort(index * golden % 1, kind="stable"), kind="stable")
    return (np.stack([index, row], axis=1) + 0.5) / count - 0.5
