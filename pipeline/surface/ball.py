"""A ball: the part of a surface that matters."""

from dataclasses import dataclass

import numpy as np

from .mesh import TriangleMesh

DECIMALS = 3


@dataclass(frozen=True)
class Ball:
    """``centre`` (3,) and radius, mm, in the frame of the mesh."""

    centre: np.ndarray
    radius_mm: float

    def rounded(self) -> "Ball":
        """As files hold it: to a micrometre."""
        return Ball(np.round(self.centre, DECIMALS), round(self.radius_mm, DECIMALS))


def ball_around(mesh: TriangleMesh) -> Ball:
    """The ball about the mean of a surface's vertices that holds all of them, rounded."""
    centre = mesh.vertices.mean(axis=0)
    return Ball(centre, mesh.moved(-centre).radius).rounded()
