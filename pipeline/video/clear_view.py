"""What a scene looks like without instruments and hands, although each of its frames may show some. Needs ``cv2``.

At each pixel the samples of a scene fall into one or two groups of colours. Where there are two, one is tissue and the
other something in front of it. The larger group is not always tissue: an instrument may rest at a place. So each piece
of the view takes the group that needs least explanation: it is frequent, its colour occurs elsewhere in the tissue, and
it continues what surrounds the piece, it has more detail, and it is not burnt out.
"""

from collections.abc import Callable

import cv2
import numpy as np

SAME_COLOUR = 10.0
"""Largest distance in CIELAB of one group of colours."""

LEAST_SUPPORT = 0.12
"""Share of the samples that makes a second group."""

OFTEN = 0.25
"""Share of the samples from which on a group is not rare."""

_LEAST_PIECE_PX, _MOST_PIECES = 6, 60

FREQUENCY_WEIGHT, COLOUR_WEIGHT, CONTINUITY_WEIGHT, DETAIL_WEIGHT, BURNT_WEIGHT = 0.6, 0.5, 1.0, 0.8, 3.0

_BURNT_LIGHTNESS, _BURNT_CHROMA = 95.0, 6.0

_BINS, _BIN = 24, 5.0
"""Bins of the histogram of the tissue's a* and b*, and their width."""


def clear_view(samples: np.ndarray, valid: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Colours of a scene with what stands in front of it removed.

    Parameters
    ----------
    samples
        ``(K, h, w, 3)`` float32 CIELAB, registered.
    valid
        ``(K, h, w)`` bool.

    Returns
    -------
    ``(h, w, 3)`` float32 CIELAB, and ``(h, w)`` bool: enough samples show the pixel.
    """
    count = valid.sum(axis=0)
    seen = count >= max(2, 0.2 * len(samples))
    first = _median(samples, valid)
    near = valid & (_distance(samples, first) < SAME_COLOUR)
    far = valid & ~near
    second = _median(samples, far)
    support = near.sum(axis=0) / np.maximum(count, 1)
    near_second = far & (_distance(samples, second) < SAME_COLOUR)
    support_second = near_second.sum(axis=0) / np.maximum(count, 1)
    double = seen & (support_second >= LEAST_SUPPORT) & (np.linalg.norm(first - second, axis=-1) > SAME_COLOUR)
    double = cv2.morphologyEx(double.astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8)) > 0
    if double.any():
        other = _continued(first, second, support, support_second, double, seen)
        near[:, other] = near_second[:, other]
        first = np.where(other[..., None], second, first)
    # the mean of a group is less noisy than its median
    weight = near.sum(axis=0)[..., None]
    mean = (samples * near[..., None]).sum(axis=0) / np.maximum(weight, 1)
    return np.where(weight > 0, mean, first).astype(np.float32), seen


def _median(samples: np.ndarray, valid: np.ndarray) -> np.ndarray:
    """``(h, w, 3)`` median of the valid samples, 0 where there are none."""
    ordered = np.sort(np.where(valid[..., None], samples, np.float32(np.inf)), axis=0)
    middle = np.maximum(valid.sum(axis=0) - 1, 0)[None, ..., None] // 2
    median = np.take_along_axis(ordered, np.broadcast_to(middle, (1, *samples.shape[1:])), axis=0)[0]
    return np.where(np.isfinite(median), median, 0).astype(np.float32)


def _distance(samples: np.ndarray, colours: np.ndarray) -> np.ndarray:
    difference = samples - colours
    return np.sqrt(np.einsum("khwc,khwc->khw", difference, difference))


def _continued(
    first: np.ndarray,
    second: np.ndarray,
    support: np.ndarray,
    support_second: np.ndarray,
    double: np.ndarray,
    seen: np.ndarray,
) -> np.ndarray:
    """``(h, w)`` bool: where the second group is the tissue."""
    likely = _tissue_likelihood(first, seen & ~double)
    frequency = FREQUENCY_WEIGHT * np.log(np.maximum(support, 0.02) / np.maximum(support_second, 0.02))
    colour = COLOUR_WEIGHT * (likely(first) - likely(second))
    detail = DETAIL_WEIGHT * (_detail(first) - _detail(second))
    evidence = frequency + colour + detail
    burnt = _burnt(first), _burnt(second)
    other = np.zeros(double.shape, bool)
    pieces = _pieces(double, support_second)
    for _ in range(2):
        for piece in pieces:
            current = np.where(other[..., None], second, first)
            jumps = [_jump(candidate, current, piece, seen) for candidate in (first, second)]
            # above 0 the first group is tissue
            balance = float(evidence[piece].mean()) + CONTINUITY_WEIGHT * (jumps[1] - jumps[0]) / SAME_COLOUR
            # the middle of glare, which is burnt out, tells what the rest of it is
            shares = [min(1.0, 5 * float(white[piece].mean())) for white in burnt]
            balance += BURNT_WEIGHT * (shares[1] - shares[0])
            other[piece] = balance < 0
    return other


def _detail(colours: np.ndarray) -> np.ndarray:
    """Logarithm of the local contrast: instruments, gloves, blood and glare are smoother than bone."""
    lightness = np.ascontiguousarray(colours[..., 0])
    slope = cv2.magnitude(
        cv2.Sobel(lightness, cv2.CV_32F, 1, 0, scale=1 / 8), cv2.Sobel(lightness, cv2.CV_32F, 0, 1, scale=1 / 8)
    )
    return np.log(cv2.blur(slope, (7, 7)) + 0.5)


def _burnt(colours: np.ndarray) -> np.ndarray:
    return (colours[..., 0] > _BURNT_LIGHTNESS) & (np.hypot(colours[..., 1], colours[..., 2]) < _BURNT_CHROMA)


def _pieces(double: np.ndarray, support_second: np.ndarray) -> list[np.ndarray]:
    """Connected parts of a region, the largest first; where the second group is rare is another part."""
    pieces = []
    for part in (double & (support_second >= OFTEN), double & (support_second < OFTEN)):
        count, labels, stats, _ = cv2.connectedComponentsWithStats(part.astype(np.uint8), connectivity=8)
        pieces += [
            (int(stats[number, cv2.CC_STAT_AREA]), labels == number)
            for number in range(1, count)
            if stats[number, cv2.CC_STAT_AREA] >= _LEAST_PIECE_PX
        ]
    return [piece for _, piece in sorted(pieces, key=lambda each: -each[0])[:_MOST_PIECES]]


def _jump(candidate: np.ndarray, current: np.ndarray, piece: np.ndarray, seen: np.ndarray) -> float:
    """Mean difference in colour across the border of a piece if it had the candidate's colours."""
    mask = piece.astype(np.float32)
    around = ((cv2.dilate(mask, np.ones((5, 5), np.uint8)) > 0) & ~piece & seen).astype(np.float32)
    inner = piece & (cv2.erode(mask, np.ones((3, 3), np.uint8)) == 0)
    weight = np.asarray(cv2.boxFilter(around, -1, (7, 7), normalize=False))
    inner &= weight > 0
    if not inner.any():
        return 0.0
    outside = cv2.boxFilter(current * around[..., None], -1, (7, 7), normalize=False)[inner] / weight[inner][:, None]
    jumps = np.linalg.norm(candidate[inner] - outside, axis=-1)
    return float(np.minimum(jumps, 3 * SAME_COLOUR).mean())


def _tissue_likelihood(colours: np.ndarray, known: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
    """A function that gives the log-likelihood of colours by the histogram of a* and b* of the known tissue."""

    def bins(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        at = np.clip(np.rint(values[..., 1:] / _BIN) + _BINS // 2, 0, _BINS - 1).astype(np.intp)
        return at[..., 0], at[..., 1]

    counts = np.zeros((_BINS, _BINS), np.float32)
    np.add.at(counts, bins(colours[known]), 1)
    smooth = np.asarray(cv2.GaussianBlur(counts, (0, 0), 1.0))
    logarithm = np.log(smooth / max(float(smooth.sum()), 1.0) + 2e-3)
    return lambda values: logarithm[bins(values)]
