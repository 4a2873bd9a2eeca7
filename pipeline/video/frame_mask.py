"""A first mask of a chosen frame: what is not tissue. Needs ``cv2``.

Metal and gloves are told by their colour, in a small view. Their outlines are then drawn along the colours of the frame
(GrabCut, Rother et al. 2004), within a narrow band. Highlights and what the optics hide are added at full size.
"""

import cv2
import numpy as np

from ..images.highlights import highlights
from .film_reader import SMALL_WIDTH
from .frame_measures import foreign, view_of
from .view_circle import Circle, view_circle

LARGEST_COLD_SHARE = 0.3
"""Of a frame that is cold beyond this share, colour tells nothing."""

_BAND_PX = 5
"""Half the width of the band in which an outline is searched, px of the view."""

_SEED = 7


def single_mask(image: np.ndarray) -> np.ndarray:
    """As :func:`tissue_mask`, of a frame without its film: the circle of the view is looked for in the frame itself."""
    view = view_of(image)
    circle = view_circle(view.mean(axis=2))
    across, down = image.shape[1] / view.shape[1], image.shape[0] / view.shape[0]
    return tissue_mask(image, None, circle and circle.scaled(across, down))


def tissue_mask(image: np.ndarray, inside: np.ndarray | None, circle: Circle | None) -> np.ndarray:
    """``(H, W)`` bool: where a frame shows tissue.

    Parameters
    ----------
    image
        ``(H, W, 3)`` uint8 RGB, at full size.
    inside
        What the optics let through, as in :class:`.FilmScores`.
    circle
        Circle of the view, px of the full frame.
    """
    height, width = image.shape[:2]
    cold, glare = foreign(view_of(image))
    # with the highlights on it, and its border, where its colour mixes with the tissue's
    near = cv2.dilate(cold.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
    metal = cv2.dilate((cold | near & glare).astype(np.float32), np.ones((3, 3), np.uint8))
    outlined = _outlined(image, metal * np.float32(cold.mean() < LARGEST_COLD_SHARE))
    covered = cv2.resize(outlined.astype(np.float32), (width, height), interpolation=cv2.INTER_LINEAR)
    margin = 2 * max(1, round(width / 600)) + 1
    white = highlights(image / np.float32(255))
    hidden = cv2.dilate(((covered > 0.4) | white).astype(np.uint8), np.ones((margin, margin), np.uint8)) > 0
    if circle is not None:
        hidden |= ~circle.mask((width, height), shrunk_px=1.0)
    if inside is not None:
        lit = cv2.resize(inside.astype(np.float32), (width, height), interpolation=cv2.INTER_LINEAR)
        # the circle's own edge is exact; elsewhere, as where the view is cut, that of the small view
        hidden |= lit < (0.99 if circle is None else 0.5)
    return ~hidden


def without_combs(image: np.ndarray) -> np.ndarray:
    """An interlaced ``(H, W, 3)`` uint8 frame as its upper field shows it: rows 1, 3, ... are interpolated."""
    result = image.copy()
    above = image[0 : image.shape[0] - 1 : 2].astype(np.uint16)
    below = np.concatenate([image[2::2], image[-2 + image.shape[0] % 2 :: 2]])[: len(above)].astype(np.uint16)
    result[1::2] = ((above + below + 1) // 2).astype(np.uint8)
    return result


def _outlined(image: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """``(h, w)`` bool, :data:`SMALL_WIDTH` wide at most, of a mask of the view, float32 0..1."""
    scale = min(1.0, SMALL_WIDTH / image.shape[1])
    small = cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    coarse = cv2.resize(mask, (small.shape[1], small.shape[0]), interpolation=cv2.INTER_LINEAR) > 0.5
    return _along_colours(small, coarse, max(2, round(_BAND_PX * small.shape[1] / mask.shape[1] / 2)))


def _along_colours(image: np.ndarray, coarse: np.ndarray, band_px: int) -> np.ndarray:
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * band_px + 1, 2 * band_px + 1))
    near = cv2.dilate(coarse.astype(np.uint8), kernel) > 0
    sure = cv2.erode(coarse.astype(np.uint8), kernel) > 0
    if not coarse.any() or near.all():
        return coarse
    labels = np.where(coarse, cv2.GC_PR_FGD, cv2.GC_PR_BGD).astype(np.uint8)
    labels[~near], labels[sure] = cv2.GC_BGD, cv2.GC_FGD
    cv2.setRNGSeed(_SEED)
    cv2.grabCut(
        np.ascontiguousarray(image),
        labels,
        (0, 0, 1, 1),
        np.zeros((1, 65)),
        np.zeros((1, 65)),
        2,
        cv2.GC_INIT_WITH_MASK,
    )
    found = (labels == cv2.GC_FGD) | (labels == cv2.GC_PR_FGD)
    # where colours say nothing, everything or nothing would be taken
    return found if 0.5 * coarse.sum() < found.sum() < 2 * coarse.sum() else coarse


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
