"""Which of several frames colours a point of the surface: of those that saw it, the one that shows its face best.

Best is the resolution across the slope of the surface: the cosine of the angle between ray and normal, divided by the
size of a frame's pixel there (:meth:`.SourceView.resolution`). It is taken at the centre of the face in the pixel, so
the choice changes only from face to face, and where what a frame saw ends. The first of equals is taken.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from ..camera.pinhole import PinholeCamera
from ..projection.rendered_view import RenderedView
from ..projection.z_buffer import rasterise_depth
from ..surface.mesh import TriangleMesh
from .source_view import SourceView

Render = Callable[[np.ndarray], RenderedView]
"""From ``cam_from_model`` (4x4, mm) to the view from there."""


def resolutions(mesh: TriangleMesh, views: Sequence[SourceView]) -> np.ndarray:
    """``(V, F)`` resolution of each view at the centre of each face, frame pixels per mm."""
    return np.stack([view.resolution(mesh.face_centres, mesh.face_normals) for view in views])


def best_of(
    mesh: TriangleMesh, camera: PinholeCamera, views: Sequence[SourceView | None], renders: Sequence[Render]
) -> Render:
    """What renders the surface with the colours of several views, from what renders it with those of each."""
    if len(renders) == 1:
        return renders[0]
    # behind the last face: of pixels without one
    resolution = np.pad(resolutions(mesh, [view for view in views if view is not None]), ((0, 0), (0, 1)))

    def render(cam_from_model: np.ndarray) -> RenderedView:
        found = [render(cam_from_model) for render in renders]
        face = rasterise_depth(mesh, camera, cam_from_model).face
        rgb, observed = found[0].rgb.copy(), np.zeros(face.shape, dtype=bool)
        best = np.full(face.shape, -np.inf)
        for view, of_faces in zip(found, resolution, strict=True):
            better = view.observed & (of_faces[face] > best)
            rgb[better], best[better] = view.rgb[better], of_faces[face][better]
            observed |= better
        return replace(found[0], rgb=rgb, observed=observed)

    return render
