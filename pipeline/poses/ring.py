"""Poses on a ring around the frame's viewing direction."""

from dataclasses import dataclass

import numpy as np

from .distributions import Orbit


@dataclass(frozen=True, kw_only=True)
class Ring(Orbit):
    """Views that are all tilted by the same angle, evenly around; the distance is uniform."""

    cone_deg: float

    def draw(self, rng: np.random.Generator) -> np.ndarray:
        """Draw one ``(4, 4)`` ``cam_from_model``."""
        around, part = rng.random(2)
        tilt, angle = np.radians(self.cone_deg), 2 * np.pi * around
        factor = self.distance_min + part * (self.distance_max - self.distance_min)
        return self.reference.orbit(
            (tilt * np.cos(angle), tilt * np.sin(angle)), 0.0, factor * self.reference.distance_mm
        )
