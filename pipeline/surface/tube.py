"""A tube around a curve, as a closed mesh: nerves and vessels."""

import numpy as np

from .mesh import TriangleMesh, checked_mesh


def tube(path: np.ndarray, radius: float, sides: int = 16, steps: int = 8) -> TriangleMesh:
    """A closed tube of ``radius`` (mm) around a Catmull-Rom curve through ``(N, 3)`` points (mm).

    Parameters
    ----------
    path
        ``(N, 3)`` points.
    radius
        Same unit as the points.
    sides, steps
        Vertices per ring; rings per segment of the path.
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
