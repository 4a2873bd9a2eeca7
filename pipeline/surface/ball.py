"""A ball: the part of a surface that matters."""

from dataclasses import dataclass

import numpy as np

DECIMALS = 3


@dataclass(frozen=True)
class Ball:
    """``centre`` (3,) and radius, mm, in the frame of the mesh."""

    centre: np.ndarray
    radius_mm: float

    def rounded(self) -> "Ball":
        """As files hold it: to a micrometre."""
        return Ball(np.round(self.centre, DECIMALS), round(self.radius_mm, DECIMALS))
