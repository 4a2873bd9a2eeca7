"""Structures and a surface as a camera sees them, and which of them is the nearest at each pixel."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

Colour = tuple[float, float, float]


@dataclass(frozen=True)
class Layer:
    """A structure as a camera sees it, in a window of the image.

    Attributes
    ----------
    corner
        (x, y) of the window's top-left pixel.
    depth_mm
        ``(h, w)`` in the window, 0 where there is no structure.
    shade
        ``(h, w)`` how much each point faces the camera: 1 in full, 0 edge-on.
    colour
        sRGB code values 0..1.
    """

    corner: tuple[int, int]
    depth_mm: np.ndarray
    shade: np.ndarray
    colour: Colour


@dataclass(frozen=True)
class SurfaceLayer:
    """The surface as a camera sees it.

    Attributes
    ----------
    depth_mm
        ``(H, W)``, 0 where there is no surface.
    contour, edges
        ``(N, 2, 2)`` segments (x, y), px: where the surface ends, and where a nearer part of it hides a farther one.
    """

    depth_mm: np.ndarray
    contour: np.ndarray
    edges: np.ndarray


@dataclass(frozen=True)
class Seen:
    """How much of a structure is seen.

    Attributes
    ----------
    visible_px, hidden_px
        Pixels in front of the surface, and behind it; what a nearer structure covers does not count.
    shallowest_mm, deepest_mm
        How far the hidden ones lie behind the surface along the optical axis; 0 if there are none.
    """

    visible_px: int
    hidden_px: int
    shallowest_mm: float
    deepest_mm: float


@dataclass(frozen=True)
class LayerStack:
    """Which structure is the nearest at each pixel of a window, and how deep it lies.

    Attributes
    ----------
    corner
        (x, y) of the window.
    number
        ``(h, w)`` index of the structure, -1 for none.
    depth_mm
        ``(h, w)`` of that structure, infinite for none.
    below_mm
        ``(h, w)`` how far it lies behind the surface; 0 or less if the surface does not hide it.
    shape_hw
        Of the image.
    """

    corner: tuple[int, int]
    number: np.ndarray
    depth_mm: np.ndarray
    below_mm: np.ndarray
    shape_hw: tuple[int, int]

    @classmethod
    def of(cls, surface: SurfaceLayer, layers: Sequence[Layer]) -> "LayerStack":
        """Stack layers."""
        shape = surface.depth_mm.shape[:2]
        filled = [layer for layer in layers if layer.depth_mm.size]
        x0, y0 = (min((layer.corner[axis] for layer in filled), default=0) for axis in (0, 1))
        x1, y1 = (
            max((layer.corner[axis] + layer.depth_mm.shape[1 - axis] for layer in filled), default=0) for axis in (0, 1)
        )
        number, nearest = np.full((y1 - y0, x1 - x0), -1, np.int16), np.full((y1 - y0, x1 - x0), np.inf, np.float32)
        for index, layer in enumerate(layers):
            if not layer.depth_mm.size:
                continue
            (x, y), (h, w) = layer.corner, layer.depth_mm.shape
            part = np.s_[y - y0 : y - y0 + h, x - x0 : x - x0 + w]
            nearer = (layer.depth_mm > 0) & (layer.depth_mm < nearest[part])
            number[part][nearer] = index
            nearest[part][nearer] = layer.depth_mm[nearer]
        covered = surface.depth_mm[y0:y1, x0:x1]
        # without surface nothing is hidden
        below = np.where(covered > 0, nearest - covered, 0).astype(np.float32)
        below[number < 0] = 0
        return cls((x0, y0), number, nearest, below, (shape[0], shape[1]))

    def at(self, pixels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Depth, and depth below the surface, at ``(N, 2)`` pixels (x, y); infinite and 0 outside the window."""
        height, width = self.number.shape
        x, y = pixels[:, 0] - self.corner[0], pixels[:, 1] - self.corner[1]
        inside = (x >= 0) & (x < width) & (y >= 0) & (y < height)
        depth, below = np.full(len(pixels), np.inf, np.float32), np.zeros(len(pixels), np.float32)
        depth[inside] = self.depth_mm[y[inside], x[inside]]
        below[inside] = self.below_mm[y[inside], x[inside]]
        return depth, below

    def seen(self, number: int) -> Seen:
        """How much of the structure with this number is seen."""
        below = self.below_mm[self.number == number]
        hidden = below[below > 0]
        shallowest_mm = float(hidden.min()) if len(hidden) else 0.0
        return Seen(len(below) - len(hidden), len(hidden), shallowest_mm, float(hidden.max(initial=0.0)))

    @property
    def median_depth_mm(self) -> float | None:
        """The median depth of all structures that are seen; ``None`` without any."""
        depth = self.depth_mm[self.number >= 0]
        return float(np.median(depth)) if len(depth) else None
