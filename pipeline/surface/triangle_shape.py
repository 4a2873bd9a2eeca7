"""Shape of triangles: unit normal and quality."""

import numpy as np

from .quadrics import cross, dot

DEGENERATE = 1e-3
"""Quality below which a triangle has no normal to speak of."""
SMALLEST_QUALITY = 0.15
"""Of a face that a collapse makes. Worse ones may only get better."""


def shapes(first_side: np.ndarray, second_side: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Normals and quality of triangles.

    Parameters
    ----------
    first_side, second_side
        ``(3, N)`` from the first corner to the second and third, mm.

    Returns
    -------
    Unit normals ``(3, N)``, and ``(N,)`` quality: 1 equilateral, 0 without area.
    """
    normal = cross(first_side, second_side)
    area = np.sqrt(dot(normal, normal))
    third_side = second_side - first_side
    sides = dot(first_side, first_side) + dot(second_side, second_side) + dot(third_side, third_side)
    normal /= np.maximum(area, 1e-300)
    return normal, np.sqrt(12.0) * area / np.maximum(sides, 1e-300)


def face_shapes(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Unit normals ``(3, F)`` and quality ``(F,)`` of faces ``(3, F)`` with vertices ``(3, V)``."""
    start, first, second = (np.take(vertices, corner, axis=1) for corner in faces)
    return shapes(first - start, second - start)
