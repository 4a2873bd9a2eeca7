"""How far a view is from another one of the same pose: in colour, and along the outlines of the surface."""

from dataclasses import dataclass

import numpy as np

from ..camera.pinhole import PinholeCamera
from ..images.pixel_values import to_uint8
from .view import RenderedView

STEP_PX = 2.0
"""Depths of neighbours or of two views, in pixel footprints (depth / f), beyond which they are of other surface."""


@dataclass(frozen=True)
class ViewError:
    """Differences between two views.

    Attributes
    ----------
    colour
        Mean absolute difference of the 8-bit RGB where the true view shows surface, of 255.
    outline_px
        Mean distance between the outlines, of the silhouette and of what stands before other surface: the area that
        shows something else, divided by their length.
    """

    colour: float
    outline_px: float

    def within(self, other: "ViewError", share: float = 1.0) -> bool:
        """Whether neither exceeds a share of the other's."""
        return self.colour <= share * other.colour and self.outline_px <= share * other.outline_px

    def worst(self, other: "ViewError") -> "ViewError":
        """The larger value of each."""
        return ViewError(max(self.colour, other.colour), max(self.outline_px, other.outline_px))


def view_error(view: RenderedView, truth: RenderedView, camera: PinholeCamera) -> ViewError:
    """The error of a view; 0 for two views without surface."""
    shown = truth.mask | view.mask
    if not shown.any():
        return ViewError(0.0, 0.0)
    codes, true_codes = (to_uint8(each.rgb[shown]).astype(np.int16) for each in (view, truth))
    step = np.float32(STEP_PX / min(camera.fx, camera.fy))
    both = view.mask & truth.mask
    other = np.abs(view.depth_mm - truth.depth_mm) > step * np.minimum(view.depth_mm, truth.depth_mm)
    different = int(np.count_nonzero((view.mask ^ truth.mask) | (both & other)))
    return ViewError(
        float(np.abs(codes - true_codes).mean()), different / max(_outline_length(truth.depth_mm, step), 1)
    )


def _outline_length(depth_mm: np.ndarray, step: np.float32) -> float:
    """Length of the outlines, px: of the pairs of neighbours that they separate, a line of any direction has 4/pi."""
    pairs = 0
    for rows in (depth_mm, depth_mm.T):
        nearer, farther = np.minimum(rows[:, 1:], rows[:, :-1]), np.maximum(rows[:, 1:], rows[:, :-1])
        pairs += int(np.count_nonzero(farther - nearer > step * nearer))
    return pairs * np.pi / 4
