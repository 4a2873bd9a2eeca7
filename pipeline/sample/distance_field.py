"""Solids as signed distance fields on a grid, their surfaces, and tubes: the modelling tools of the sample case.

Shapes are signed distances in mm, negative inside. A grid holds the signed distance to the surface of the material,
positive inside it; carving and filling keep distances accurate near the surface only. Needs
``scipy``, and ``skimage`` for marching cubes (Lewiner et al. 2003, topologically consistent).
"""

from collections.abc import Callable, Sequence

import numpy as np
from scipy.ndimage import map_coordinates
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from skimage.measure import marching_cubes

from ..surface.mesh import TriangleMesh, checked_mesh

Shape = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]
"""Signed distance, negative inside, from coordinates x, y, z in mm that broadcast."""


class ImplicitGrid:
    """A block of material to carve, or of air to fill, between two corners, mm.

    Attributes
    ----------
    axes
        Coordinates of the grid planes along x, y and z, mm.
    values
        ``(X, Y, Z)`` float32, positive in material.
    """

    def __init__(self, lower: np.ndarray, upper: np.ndarray, spacing: float, *, solid: bool = True) -> None:
        self.lower, self.upper, self.spacing = lower, upper, spacing
        counts = np.round((upper - lower) / spacing).astype(int) + 1
        self.axes = [(lower[i] + spacing * np.arange(counts[i])).astype(np.float32) for i in range(3)]
        self.values = np.full(counts, 1e3 if solid else -1e3, np.float32)

    def box(self, lower: np.ndarray | None = None, upper: np.ndarray | None = None) -> tuple[tuple, tuple]:
        """Slices of the box between two corners, mm, and its coordinates x, y, z, mm, as arrays that broadcast."""
        slices = []
        for axis in range(3):
            start = 0 if lower is None else np.searchsorted(self.axes[axis], lower[axis])
            stop = None if upper is None else np.searchsorted(self.axes[axis], upper[axis])
            slices.append(slice(start, stop))
        return tuple(slices), np.ix_(*(values[part] for values, part in zip(self.axes, slices, strict=True)))

    def carve(
        self, shape: Shape, lower: np.ndarray | None = None, upper: np.ndarray | None = None, *, blend: float = 0.0
    ) -> None:
        """Remove a shape, within the box between two corners; the new edge is rounded over ``blend`` mm."""
        part, coordinates = self.box(lower, upper)
        self.values[part] = smooth_minimum(self.values[part], shape(*coordinates), blend)

    def fill(
        self, shape: Shape, lower: np.ndarray | None = None, upper: np.ndarray | None = None, *, blend: float = 0.0
    ) -> None:
        """Add a shape of material; parameters as for :meth:`carve`."""
        part, coordinates = self.box(lower, upper)
        self.values[part] = -smooth_minimum(-self.values[part], shape(*coordinates), blend)

    def at(self, values: np.ndarray, points: np.ndarray) -> np.ndarray:
        """``(X, Y, Z)`` values at the grid points -> ``(N,)`` at ``(N, 3)`` points inside the grid, trilinearly."""
        place = (points - self.lower) / self.spacing
        return map_coordinates(values, place.T, output=np.float64, order=1, mode="nearest")

    def surface(self) -> tuple[np.ndarray, np.ndarray]:
        """``(V, 3)`` vertices, mm, and ``(F, 3)`` faces of the zero level; fronts towards air, open at the ends."""
        vertices, faces, _, _ = marching_cubes(
            self.values, 0.0, spacing=(self.spacing,) * 3, gradient_direction="ascent"
        )
        return vertices + self.lower, faces


def smooth_minimum(a: np.ndarray, b: np.ndarray, blend: float) -> np.ndarray:
    """Polynomial smooth minimum (Inigo Quilez); differs from the minimum only where |a - b| < blend."""
    if blend == 0:
        return np.minimum(a, b)
    overlap = np.maximum(1 - np.abs(a - b) / np.float32(blend), 0)
    return np.minimum(a, b) - overlap * overlap * np.float32(blend / 4)


def ball(x: np.ndarray, y: np.ndarray, z: np.ndarray, centre: tuple, radii: tuple) -> np.ndarray:
    """Signed distance (approximate) to an ellipsoid with semi-axes ``radii``, mm."""
    qx, qy, qz = ((p - np.float32(c)) / np.float32(r) for p, c, r in zip((x, y, z), centre, radii, strict=True))
    return (np.sqrt(qx * qx + qy * qy + qz * qz) - 1) * np.float32(min(radii))


def polyline(
    x: np.ndarray, y: np.ndarray, z: np.ndarray, points: np.ndarray, radii: Sequence[float] | None = None
) -> np.ndarray:
    """Distance to a polyline ``(N, 3)``, less a radius that varies linearly between its points; mm."""
    radii = (0.0,) * len(points) if radii is None else radii
    nearest = np.full(np.broadcast_shapes(np.shape(x), np.shape(y), np.shape(z)), np.inf, np.float32)
    for a, b, radius_a, radius_b in zip(points[:-1], points[1:], radii[:-1], radii[1:], strict=True):
        direction = (b - a).astype(np.float32)
        px, py, pz = (p - np.float32(c) for p, c in zip((x, y, z), a, strict=True))
        along = (px * direction[0] + py * direction[1] + pz * direction[2]) / float(direction @ direction)
        along = np.clip(along, 0, 1)
        dx, dy, dz = px - along * direction[0], py - along * direction[1], pz - along * direction[2]
        distance = np.sqrt(dx * dx + dy * dy + dz * dz) - (radius_a + along * (radius_b - radius_a))
        nearest = np.minimum(nearest, distance)
    return nearest


def largest_component(vertices: np.ndarray, faces: np.ndarray) -> TriangleMesh:
    """The connected component with the most vertices."""
    edges = faces[:, [0, 1, 1, 2]].reshape(-1, 2)
    graph = coo_array((np.ones(len(edges), bool), tuple(edges.T)), shape=(len(vertices), len(vertices)))
    _, label = connected_components(graph, directed=False)
    largest = np.argmax(np.bincount(label))
    mesh, _ = checked_mesh(vertices, faces[label[faces[:, 0]] == largest], "sample surface")
    return mesh


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


def tube(path: np.ndarray, radius: float, sides: int = 16, steps: int = 8) -> TriangleMesh:
    """A nerve or vessel: a closed tube of ``radius`` (mm) around a Catmull-Rom curve through ``(N, 3)`` points (mm).

    ``sides`` are vertices per ring, ``steps`` rings per segment of the path.
    """
    padded = np.concatenate([[2 * path[0] - path[1]], path, [2 * path[-1] - path[-2]]])
    t = np.arange(steps)[:, None, None] / steps
    p0, p1, p2, p3 = (padded[i : len(padded) - 3 + i] for i in range(4))
    curve = 0.5 * (2 * p1 + (p2 - p0) * t + (2 * p0 - 5 * p1 + 4 * p2 - p3) * t**2 + (3 * (p1 - p2) + p3 - p0) * t**3)
    curve = np.concatenate([curve.transpose(1, 0, 2).reshape(-1, 3), path[-1:]])
    tangent = np.gradient(curve, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    # no tube in use runs along (0, 0, 1), so one reference direction orients all rings without a twist
    side = np.cross(tangent, [0.0, 0.0, 1.0])
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    angle = np.arange(sides) * (2 * np.pi / sides)
    ring = np.cos(angle)[:, None] * side[:, None] + np.sin(angle)[:, None] * np.cross(tangent, side)[:, None]
    rings = (curve[:, None] + radius * ring).reshape(-1, 3)
    tips = curve[[0, -1]] + 0.5 * radius * np.array([[-1.0], [1.0]]) * tangent[[0, -1]]
    vertices = np.concatenate([rings, tips])
    here = np.arange(sides)
    ahead = (here + 1) % sides
    start = np.arange(len(curve) - 1)[:, None] * sides
    a, b, c, d = start + here, start + ahead, start + sides + ahead, start + sides + here
    first, last, end = len(rings), len(rings) + 1, (len(curve) - 1) * sides
    quads = [np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)]
    caps = [
        np.stack([np.full(sides, first), ahead, here], -1),
        np.stack([np.full(sides, last), end + here, end + ahead], -1),
    ]
    return checked_mesh(vertices, np.concatenate(quads + caps), "sample structure")[0]
