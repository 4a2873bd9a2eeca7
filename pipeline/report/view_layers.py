"""Masks and depth of a view as one small picture: depth in its colour, lossy; masks in its alpha, exact.

A viewer reads the alpha back as ``NO_SURFACE``, ``UNSEEN`` or ``SEEN``. All are nearly opaque, so that no
browser loses the depth below them. The picture is for looking at, not for measuring.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from .thumbnails import shrunk, webp

SEEN, UNSEEN, NO_SURFACE = 255, 253, 251
"""Alpha of surface that the source frame saw, of other surface, and of the rest."""
DEPTH_QUALITY = 60
"""Quality of WebP; depth is smooth."""


@dataclass(frozen=True)
class ViewLayers:
    """Depth and masks of a view.

    Attributes
    ----------
    depth_mm
        ``(H, W)`` float32, 0 where there is none; ``None`` if it is missing.
    mask, observed
        ``(H, W)`` bool; ``None`` if missing.
    """

    depth_mm: np.ndarray | None
    mask: np.ndarray | None
    observed: np.ndarray | None

    def range_mm(self) -> tuple[float, float] | None:
        """Nearest and farthest depth; ``None`` without any."""
        if self.depth_mm is None or not (inside := self.depth_mm > 0).any():
            return None
        values = self.depth_mm[inside]
        return float(values.min()), float(values.max())

    def picture(self, width_px: int) -> np.ndarray | None:
        """``(h, w, 4)`` uint8: depth from 0 (nearest) to 255 (farthest), three times, and the masks."""
        given = next((layer for layer in (self.mask, self.depth_mm, self.observed) if layer is not None), None)
        if given is None:
            return None
        some = np.zeros(given.shape, bool)
        mask = self.mask if self.mask is not None else some if self.depth_mm is None else self.depth_mm > 0
        observed = some if self.observed is None else self.observed
        inside = _share(mask, width_px) >= 0.5
        # the share of the surface, not of the pixel
        seen = inside & (_share(observed & mask, width_px) >= 0.5 * _share(mask, width_px))
        levels = np.zeros(inside.shape, np.uint8)
        if self.depth_mm is not None and (bounds := self.range_mm()) is not None:
            levels = _levels(self.depth_mm, bounds, width_px)
        alpha = np.where(seen, SEEN, np.where(inside, UNSEEN, NO_SURFACE)).astype(np.uint8)
        return np.dstack([levels, levels, levels, alpha])

    def encoded(self, width_px: int) -> bytes | None:
        """The picture as WebP."""
        picture = self.picture(width_px)
        return None if picture is None else webp(picture, DEPTH_QUALITY)


def _share(mask: np.ndarray, width_px: int) -> np.ndarray:
    """``(h, w)`` the share of each pixel of the small picture that lies in the mask, 0..1."""
    return shrunk(mask.astype(np.float32), width_px)


def _levels(depth_mm: np.ndarray, bounds: tuple[float, float], width_px: int) -> np.ndarray:
    near, far = bounds
    valid = depth_mm > 0
    weight = _share(valid, width_px)
    # empty areas get the mean: an edge at the silhouette would cost bytes and blur the depth beside it
    mean = shrunk(np.where(valid, depth_mm, 0).astype(np.float32), width_px) / np.maximum(weight, 1e-6)
    filled = np.where(weight > 0, mean, float(depth_mm[valid].mean()))
    scaled = 255 * (filled - near) / max(far - near, 1e-6)
    return cv2.medianBlur(np.clip(np.rint(scaled), 0, 255).astype(np.uint8), 3)
