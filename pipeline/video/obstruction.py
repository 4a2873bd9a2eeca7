"""What stands in front of the tissue in a frame: instruments, hands, blood, glare, by comparison with the clear view.

Needs ``cv2``.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from .frame_measures import normalised_lab

DIFFERENT = 9.0
"""Distance in CIELAB, averaged over 5x5 px of a view, from which on a frame differs from the clear view."""

GLARE_LIGHTNESS, GLARE_CHROMA, GLARE_EXCESS = 88.0, 16.0, 10.0
"""Glare is lighter than this, less coloured, and this much lighter than the clear view."""

COLD, COLD_LIGHTNESS = 0.35, 25.0
"""Metal and gloves have less than this share of the tissue's red and yellow (a* + b* relative to L*); tissue itself
only where it is darker, or in highlights."""

_WARM_TISSUE = 0.06
_LARGEST_COLD_SHARE = 0.3
_LARGEST_GAIN = 4.0
_LEAST_LIGHTNESS = 8.0


@dataclass(frozen=True)
class Obstruction:
    """What a frame shows in front of the tissue.

    Attributes
    ----------
    mask
        ``(h, w)`` bool in the scene's key view: foreign objects.
    glare
        ``(h, w)`` bool: light that the clear view does not show.
    looked_at
        ``(h, w)`` bool: where both frame and clear view show something.
    gain
        By which the frame's code values were multiplied to have the brightness of the clear view.
    """

    mask: np.ndarray
    glare: np.ndarray
    looked_at: np.ndarray
    gain: float

    @property
    def share(self) -> float:
        """Share of the view that foreign objects cover."""
        return float((self.mask & ~self.glare).sum() / max(int(self.looked_at.sum()), 1))

    @property
    def glare_share(self) -> float:
        """Share of the view that is glare."""
        return float(self.glare.sum() / max(int(self.looked_at.sum()), 1))


class ObstructionFinder:
    """Compares the frames of one scene with its clear view."""

    def __init__(self, reference: np.ndarray, seen: np.ndarray, *, still: bool = True) -> None:
        """``reference`` ``(h, w, 3)`` float32 CIELAB, ``seen`` ``(h, w)`` bool: where it is known.

        Unless the camera stays ``still``, whatever moves differs: only what is colder than tissue is then found.
        """
        self._reference, self._seen, self._still = reference, seen, still
        kernel = np.ones((3, 3), np.uint8)
        self._low, self._high = cv2.erode(reference, kernel), cv2.dilate(reference, kernel)
        warmth = float(np.median(_warmth(reference)[seen])) if seen.any() else 0.0
        self._coldest = COLD * warmth
        # tissue that is itself cold, or a film without colour: colour alone tells nothing
        cold_share = (self._cold(reference) & seen).sum() / max(int(seen.sum()), 1)
        if warmth < _WARM_TISSUE or cold_share > _LARGEST_COLD_SHARE:
            self._coldest = -np.inf

    def find(self, view: np.ndarray, valid: np.ndarray, gain: float) -> Obstruction:
        """Compare a registered ``(h, w, 3)`` uint8 RGB view, multiplied by ``gain``, with the clear view."""
        looked_at = valid & self._seen
        lab = normalised_lab(view, gain)
        excess = self._commonest_ratio(lab, looked_at)
        for step in range(3):
            if step and abs(np.log(excess)) < 0.02:
                break
            gain = gain * float(np.clip(excess, 1 / _LARGEST_GAIN, _LARGEST_GAIN))
            lab = normalised_lab(view, gain)
            mask, glare = self._masks(lab, looked_at)
            good = looked_at & ~mask & ~glare & self._bright_enough(lab)
            if good.sum() < 0.1 * max(int(looked_at.sum()), 1):
                break
            excess = float(np.median(self._reference[good][:, 0] / lab[good][:, 0]))
        return Obstruction(mask, glare, looked_at, gain)

    def _bright_enough(self, lab: np.ndarray) -> np.ndarray:
        return (lab[..., 0] > _LEAST_LIGHTNESS) & (self._reference[..., 0] > _LEAST_LIGHTNESS)

    def _commonest_ratio(self, lab: np.ndarray, looked_at: np.ndarray) -> float:
        """Lightness of the clear view over that of a frame where most pixels agree on it, whatever covers the others.

        L* is nearly proportional to code values, so this is the frame's missing gain.
        """
        good = looked_at & self._bright_enough(lab)
        if not good.any():
            return 1.0
        ratio = np.log(self._reference[good][:, 0] / lab[good][:, 0])
        counts, edges = np.histogram(ratio, bins=120, range=(-1.5, 1.5))
        smooth = np.convolve(counts, (1, 2, 3, 2, 1), mode="same")
        at = int(np.argmax(smooth))
        near = np.abs(ratio - (edges[at] + edges[at + 1]) / 2) < 0.06
        return float(np.exp(np.median(ratio[near]))) if near.mean() > 0.1 else 1.0

    def _masks(self, lab: np.ndarray, looked_at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        beyond = np.maximum(np.maximum(self._low - lab, lab - self._high), 0)
        different = np.sqrt(np.einsum("hwc,hwc->hw", beyond, beyond))
        different[~looked_at] = 0
        different *= self._still
        different = cv2.blur(different, (5, 5)) > DIFFERENT
        chroma = np.hypot(lab[..., 1], lab[..., 2])
        excess = lab[..., 0] - self._reference[..., 0]
        glare = (lab[..., 0] > GLARE_LIGHTNESS) & (chroma < GLARE_CHROMA) & (excess > GLARE_EXCESS) & looked_at
        different |= self._cold(lab) & looked_at & ~glare
        opened = cv2.morphologyEx(different.astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8)) > 0
        return opened & looked_at, glare

    def _cold(self, lab: np.ndarray) -> np.ndarray:
        lightness = lab[..., 0]
        cold = (_warmth(lab) < self._coldest) & (lightness > COLD_LIGHTNESS) & (lightness < GLARE_LIGHTNESS)
        return cv2.morphologyEx(cold.astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8)) > 0


def _warmth(lab: np.ndarray) -> np.ndarray:
    return (lab[..., 1] + lab[..., 2]) / np.maximum(lab[..., 0], 1.0)
