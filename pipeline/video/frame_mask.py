"""A first mask of a chosen frame: what is not tissue. Needs ``cv2``.

Instruments, hands and glare are found against the clear view of the scene, at its small size. Their outlines are then
drawn along the colours of the frame (GrabCut, Rother et al. 2004), within a narrow band. Overexposed pixels and what
the optics hide are added at full size.
"""

import cv2
import numpy as np

from .film_reader import SMALL_WIDTH
from .frame_measures import normalised_lab, view_of
from .obstruction import ObstructionFinder
from .passage import ComparedFrame, registered
from .view_circle import Circle, view_circle

OVEREXPOSED = 250
"""Code value that all three channels reach where the sensor's range ends."""

_BAND_PX = 5
"""Half the width of the band in which an outline is searched, px of the view."""

_SEED = 7


def tissue_mask(
    image: np.ndarray, compared: ComparedFrame, inside: np.ndarray | None = None, circle: Circle | None = None
) -> np.ndarray:
    """``(H, W)`` bool: where a frame shows tissue.

    Parameters
    ----------
    image
        ``(H, W, 3)`` uint8 RGB, at full size.
    compared, inside
        What the frame was compared with, and what the optics let through, as in :class:`.FilmScores`.
    circle
        Circle of the view, px of the full frame.
    """
    view = view_of(image)
    found = compared.clear_view.finder().find(*registered(view, compared.placement, inside), compared.gain)
    foreign = (found.mask | found.glare).astype(np.float32)
    foreign = cv2.warpAffine(
        foreign, compared.placement.key_from_view, view.shape[1::-1], flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    )
    return _not_hidden(image, foreign, inside, circle)


def single_mask(image: np.ndarray) -> np.ndarray:
    """As :func:`tissue_mask`, of a frame without its film: metal and gloves by their colour, glare, the view's circle.

    ``(H, W)`` bool, of ``(H, W, 3)`` uint8 RGB.
    """
    view = view_of(image)
    everywhere = np.ones(view.shape[:2], bool)
    # compared with itself nothing differs: what is colder than the frame's own tissue remains
    cold = ObstructionFinder(normalised_lab(view, 1.0), everywhere).find(view, everywhere, 1.0).mask
    circle = view_circle(view.mean(axis=2))
    across, down = image.shape[1] / view.shape[1], image.shape[0] / view.shape[0]
    return _not_hidden(image, cold.astype(np.float32), None, circle and circle.scaled(across, down))


def _not_hidden(image: np.ndarray, foreign: np.ndarray, inside: np.ndarray | None, circle: Circle | None) -> np.ndarray:
    height, width = image.shape[:2]
    covered = cv2.resize(_outlined(image, foreign).astype(np.float32), (width, height), interpolation=cv2.INTER_LINEAR)
    margin = 2 * max(1, round(width / 600)) + 1
    bright = (image.min(axis=2) >= OVEREXPOSED).astype(np.uint8)
    hidden = cv2.dilate(((covered > 0.4) | (bright > 0)).astype(np.uint8), np.ones((margin, margin), np.uint8)) > 0
    if circle is not None:
        hidden |= ~circle.mask((width, height), shrunk_px=1.0)
    elif inside is not None:
        lit = cv2.resize(inside.astype(np.float32), (width, height), interpolation=cv2.INTER_LINEAR)
        hidden |= lit < 0.99
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
