"""Which of several frames colours a point of the surface: of those that saw it, the one that shows its face best.

Best is the resolution across the slope of the surface: the cosine of the angle between ray and normal, divided by the
size of a frame's pixel there (:meth:`.SourceView.resolution`). It is taken at the centre of the face in the pixel, so
the choice changes only from face to face, and where what a frame saw ends. The first of equals is taken.
"""

from collections.abc import Sequence

import numpy as np

from ..surface.mesh import TriangleMesh
from .source_view import SourceView


def resolutions(mesh: TriangleMesh, views: Sequence[SourceView]) -> np.ndarray:
    """``(V, F)`` resolution of each view at the centre of each face, frame pixels per mm."""
    return np.stack([view.resolution(mesh.face_centres, mesh.face_normals) for view in views])


def best_first(mesh: TriangleMesh, views: Sequence[SourceView | None]) -> np.ndarray:
    """``(V, F)`` uint8 numbers of the views, the one first that shows a face best; views may lack if there is one."""
    known = [view for view in views if view is not None]
    if len(known) < 2:
        return np.zeros((1, len(mesh.faces)), np.uint8)
    return np.argsort(-resolutions(mesh, known), axis=0, kind="stable").astype(np.uint8)
