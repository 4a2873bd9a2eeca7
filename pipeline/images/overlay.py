"""Overlays: structures and outlines drawn over an image, as in augmented reality."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

VISIBLE_OPACITY, HIDDEN_OPACITY = 0.75, 0.35
OUTLINE_COLOUR = (1.0, 0.85, 0.1)


@dataclass(frozen=True)
class Layer:
    """A structure as a camera sees it.

    Attributes
    ----------
    depth_mm
        ``(H, W)``, 0 where there is no structure.
    colour
        sRGB code values 0..1.
    """

    depth_mm: np.ndarray
    colour: tuple[float, float, float]


def draw_overlay(image: np.ndarray, surface_depth_mm: np.ndarray, layers: Sequence[Layer]) -> np.ndarray:
    """Draw structures and the surface's outline over an ``(H, W, 3)`` image (values 0..1).

    A structure has :data:`VISIBLE_OPACITY`, and :data:`HIDDEN_OPACITY` where the surface hides it. Nearer structures
    cover farther ones.
    """
    result = image.astype(np.float32, copy=True)
    mask = surface_depth_mm > 0
    result[_outline(mask)] = OUTLINE_COLOUR
    if not layers:
        return result
    depths = np.stack([np.where(layer.depth_mm > 0, layer.depth_mm, np.inf) for layer in layers])
    nearest = depths.argmin(axis=0)
    for number, layer in enumerate(layers):
        shown = (nearest == number) & (layer.depth_mm > 0)
        hidden = mask & (layer.depth_mm > surface_depth_mm)
        opacity = np.where(hidden, HIDDEN_OPACITY, VISIBLE_OPACITY)[..., None]
        blended = (1 - opacity) * result + opacity * np.array(layer.colour, np.float32)
        result = np.where(shown[..., None], blended, result)
        result[_outline(shown)] = layer.colour
    return result


def _outline(mask: np.ndarray) -> np.ndarray:
    """The pixels of a mask with at least one of four neighbours outside it; the image border does not count."""
    padded = np.pad(mask, 1, mode="edge")
    inner = padded[:-2, 1:-1] & padded[2:, 1:-1] & padded[1:-1, :-2] & padded[1:-1, 2:]
    return mask & ~inner
