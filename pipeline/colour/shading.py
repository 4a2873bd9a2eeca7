"""A surface with its colours: what every engine renders."""

from dataclasses import dataclass, field

import numpy as np

from ..surface.mesh import TriangleMesh
from .lens_shading import LensShading
from .seen_frame import SeenFrame
from .vertex_colours import VertexColours

SurfaceColour = VertexColours | SeenFrame


@dataclass(frozen=True)
class ColouredSurface:
    """What every engine renders.

    Attributes
    ----------
    mesh
        The surface, model frame, mm.
    colours
        Sources of its colour, of which the first that saw a point is taken; none for geometry alone, in neutral grey
        and observed on front sides.
    unseen
        ``(V, 3)`` code values 0..1 of the vertices for what no frame saw; ``None``: neutral grey.
    pivot_model
        ``(3,)`` mm: the point whose distance determines the filter of anti-aliased views; the origin if left out.
    light
        The light at the lens, in which the colours are albedos, see :mod:`oneframe.colour.lens_shading`; ``None``: the
        colours are shown as they are.
    """

    mesh: TriangleMesh
    colours: tuple[SurfaceColour, ...] = ()
    unseen: np.ndarray | None = None
    pivot_model: np.ndarray = field(default_factory=lambda: np.zeros(3))
    light: LensShading | None = None


def source_of(colour: SurfaceColour) -> SeenFrame | None:
    """The view that a colour is taken from, if it tells which points were seen."""
    return colour if isinstance(colour, SeenFrame) else colour.source
