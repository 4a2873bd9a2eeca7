"""The plan of a virtual drill: strokes of spherical burrs, and how near they may come to what must stay."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Stroke:
    """A burr swept along a polyline.

    Attributes
    ----------
    radius_mm
        Radius of the burr, positive.
    points
        ``(N, 3)`` centres of the burr in the frame of the mesh (LPS), mm; one point is a burr at rest.
    """

    radius_mm: float
    points: np.ndarray


@dataclass(frozen=True)
class DrillPlan:
    """Strokes and margins.

    Attributes
    ----------
    strokes
        In any order: their union is removed.
    margins_mm
        Least thickness of bone that stays around each structure, by its name.
    """

    strokes: tuple[Stroke, ...]
    margins_mm: Mapping[str, float]
