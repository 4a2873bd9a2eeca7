"""Poses on a ring around the reference pose."""

from dataclasses import dataclass

import numpy as np

from .distributions import Orbit


@dataclass(frozen=True, kw_only=True)
class Ring(Orbit):
    """All at the same tilt, at any azimuth."""

    cone_deg: float

    def draw(self, rng: np.random.Generator) -> np.ndarray:
        """Draw one ``(4, 4)`` ``cam_from_model``."""
        azimuth, distance = rng.random(2)
        factor = self.distance_min + distance * (self.distance_max - self.distance_min)
        tilt = np.radians(self.cone_deg), 2 * np.pi * azimuth
        return self.reference.orbit(tilt, 0.0, factor * self.reference.distance_mm)
