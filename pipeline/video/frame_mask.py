"""A first mask of a chosen frame: what is not tissue. Needs ``cv2``.

Metal and gloves are told by their colour, in a small view; highlights are added at full size, and what the optics hide.
"""

import cv2
import numpy as np

from ..images.highlights import highlights
from .film_reader import SMALL_WIDTH
from .frame_measures import foreign, lit_part, view_of

LARGEST_COLD_SHARE = 0.3
"""Of a frame that is cold beyond this share, colour tells nothing."""


def single_mask(image: np.ndarray) -> np.ndarray:
    """As :func:`tissue_mask`, of a frame without its film: the black around the view is looked for in it alone."""
    scale = min(1.0, SMALL_WIDTH / image.shape[1])
    return tissue_mask(image, lit_part(cv2.resize(image, None, fx=scale, fy=scale).mean(axis=2)))


def tissue_mask(image: np.ndarray, inside: np.ndarray | None) -> np.ndarray:
    """``(H, W)`` bool: where a frame shows tissue.

    Parameters
    ----------
    image
        ``(H, W, 3)`` uint8 RGB, at full size.
    inside
        What the optics let through, as in :class:`.FilmScores`.
    """
    height, width = image.shape[:2]
    cold, glare = foreign(view_of(image))
    # with the highlights on it, and its border, where its colour mixes with the tissue's
    near = cv2.dilate(cold.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
    metal = cv2.dilate((cold | near & glare).astype(np.float32), np.ones((3, 3), np.uint8))
    covered = cv2.resize(metal, (width, height), interpolation=cv2.INTER_LINEAR) * (cold.mean() < LARGEST_COLD_SHARE)
    margin = 2 * max(1, round(width / 600)) + 1
    white = highlights(image / np.float32(255))
    hidden = cv2.dilate(((covered > 0.4) | white).astype(np.uint8), np.ones((margin, margin), np.uint8)) > 0
    if inside is not None:
        lit = cv2.resize(inside.astype(np.float32), (width, height), interpolation=cv2.INTER_LINEAR)
        hidden |= lit < 0.75
    return ~hidden


class Resampler:
    """Samples each frame at given places, bilinearly; they are prepared once."""

    def __init__(self, pixels: np.ndarray) -> None:
        """Sample at ``(H, W, 2)`` pixels (x, y) of a frame; black outside it."""
        self._across, self._down = (np.ascontiguousarray(pixels[..., axis], np.float32) for axis in (0, 1))

    def __call__(self, image: np.ndarray) -> np.ndarray:
        """``(h, w, 3)`` uint8 -> ``(H, W, 3)`` uint8."""
        return np.asarray(
            cv2.remap(image, self._across, self._down, interpolation=cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT)
        )
