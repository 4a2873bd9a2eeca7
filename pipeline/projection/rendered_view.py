"""One rendered view of a surface: the arrays that every renderer gives."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class RenderedView:
    """One rendered view.

    Attributes
    ----------
    rgb
        ``(H, W, 3)`` float32 code values 0..1; black where there is no surface.
    depth_mm
        ``(H, W)`` float32 depth of the surface along the optical axis at the pixel's centre; 0 for none.
    source
        ``(H, W)`` uint8: which frame saw the surface at the pixel's centre and gave its colour, from 1; 0 for none.
    near_unseen
        ``(H, W)`` bool: observed, but within about one frame pixel of the border of the observed surface; only scenes
        for anti-aliasing have it.
    occluder_mm
        ``(H, W)`` float32 depth of what stands in front of the surface or beside it, which colours show; 0 for none.
        ``None``: nothing does anywhere.
    sheet
        ``(H, W)`` bool: beyond the surface's edge, colours show what surrounds it, unless something stands in front.
        ``None``: black.
    """

    rgb: np.ndarray
    depth_mm: np.ndarray
    source: np.ndarray
    near_unseen: np.ndarray
    occluder_mm: np.ndarray | None = None
    sheet: np.ndarray | None = None

    @property
    def mask(self) -> np.ndarray:
        """``(H, W)`` bool: there is surface at the pixel's centre, whatever stands in front of it."""
        return self.depth_mm > 0

    @property
    def occluder(self) -> np.ndarray:
        """``(H, W)`` bool: something else than the surface is seen at the pixel's centre."""
        return np.zeros(self.mask.shape, bool) if self.occluder_mm is None else self.occluder_mm > 0

    @property
    def visible(self) -> np.ndarray:
        """``(H, W)`` bool: the surface at the pixel's centre that nothing stands in front of."""
        return self.mask if self.occluder_mm is None else self.mask & ~self.occluder

    @property
    def visible_mm(self) -> np.ndarray:
        """``(H, W)`` float32 depth of the visible surface; 0 for none."""
        return self.depth_mm if self.occluder_mm is None else np.where(self.visible, self.depth_mm, np.float32(0))

    @property
    def seen_mm(self) -> np.ndarray:
        """``(H, W)`` float32 depth of what is seen, surface or not; 0 for nothing."""
        return self.depth_mm if self.occluder_mm is None else np.where(self.occluder, self.occluder_mm, self.depth_mm)

    @property
    def surround(self) -> np.ndarray:
        """``(H, W)`` bool: what surrounds the surface is seen at the pixel's centre."""
        return np.zeros(self.mask.shape, bool) if self.sheet is None else self.sheet & ~self.occluder

    @property
    def observed(self) -> np.ndarray:
        """``(H, W)`` bool: a frame saw the surface at the pixel's centre."""
        return self.source > 0


Render = Callable[[np.ndarray], RenderedView]
"""From ``cam_from_model`` (4x4, mm) to the view from there."""
