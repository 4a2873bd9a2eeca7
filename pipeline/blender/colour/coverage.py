"""How much of the surface the frame colours, and how exactly: measured by rendering the frame's own pose."""

from dataclasses import dataclass

import numpy as np

from ..render.engines import render_view
from ..render.material import SurfaceColour
from ..render.surface_scene import SurfaceScene
from .reference_view import ReferenceView


@dataclass(frozen=True)
class Coverage:
    """Figures of a coloured surface.

    Attributes
    ----------
    of_view
        Fraction of the surface in the frame's view that has a colour from it, 0..1.
    of_surface
        Fraction of the whole surface's area that the frame saw, 0..1.
    mean_error, max_error
        Absolute difference between the rendered view and the frame where there is colour, code values 0..255: mean over
        pixels and channels, and maximum.
    pixels
        Number of compared pixels.
    """

    of_view: float
    of_surface: float
    mean_error: float
    max_error: float
    pixels: int

    def summary(self) -> str:
        """The figures as one line."""
        return (
            f"the frame colours {self.of_view:.1%} of the surface in its view, {self.of_surface:.1%} of the whole; "
            f"a view rendered at its pose differs from the frame by {self.mean_error:.3f}/255 on average, "
            f"by at most {self.max_error:.1f}/255"
        )


def coverage_of(source: ReferenceView, colour: SurfaceColour) -> Coverage:
    """Render the frame's pose with a colour mode and compare the view with the frame."""
    frame = source.view
    with SurfaceScene(source.mesh, frame.camera, colour) as scene:
        view = render_view(scene, frame.cam_from_model)
    differences = 255 * np.abs(view.rgb[view.observed] - frame.image[view.observed])
    areas = np.linalg.norm(source.mesh.face_cross, axis=1)
    centres = source.mesh.vertices[source.mesh.faces].mean(axis=1)
    seen = frame.observed(centres, source.mesh.face_normals)
    return Coverage(
        of_view=float(view.observed.sum() / max(int(view.mask.sum()), 1)),
        of_surface=float(areas[seen].sum() / areas.sum()),
        mean_error=float(differences.mean()) if differences.size else 0.0,
        max_error=float(differences.max()) if differences.size else 0.0,
        pixels=int(np.count_nonzero(view.observed)),
    )
