"""How far a view and a photograph are displaced against each other, and the view moved onto the photograph.

Optical flow explains nearly any difference by displacement. Here it may only explain what a wrong pose or a wrong shape
can: it is smoothed, with the weight of the texture that determines it. Needs ``cv2``.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from ...images.pixel_values import mask_box
from .similarity import channel_mean

SMOOTHING = 0.05
"""Standard deviation of the smoothing, relative to the longer side of the compared part."""
LEAST_SMOOTHING_PX = 6.0
MARGIN_PX = 24
NARROW_PX = 10.0
"""Standard deviation below which blurs are made at full size."""
FILL_PX = 8.0
"""Width of the blur that continues both images beyond the compared part: an edge at its border would be a false cue."""
TEXTURE_PX = 3.0
CLOSING_PX = 0.5
"""Displacement there and back that halves the trust in both."""
LEAST_WIDTH_PX = 0.25
"""Least scale of what the smooth displacement leaves: that of the search itself."""
PRIOR = 1e-2
ROUNDS = 4
SMALLEST_PX = 96
"""Smaller parts are enlarged for the flow, whose patches have 8 px at half the resolution."""


@dataclass(frozen=True)
class FlowAlignment:
    """A view moved onto a photograph.

    Attributes
    ----------
    aligned
        ``(H, W, 3)`` the view's code values, moved.
    mask
        ``(H, W)`` bool: pixels to compare whose displaced position is in the compared part too.
    median_px, high_px
        Median and 95th percentile of the displacement over the compared part, px.
    """

    aligned: np.ndarray
    mask: np.ndarray
    median_px: float
    high_px: float


def aligned_by_flow(real: np.ndarray, synthetic: np.ndarray, mask: np.ndarray) -> FlowAlignment:
    """Estimate the smooth displacement between ``(H, W, 3)`` images over an ``(H, W)`` bool mask, and undo it.

    The flow is that of dense inverse search (Kroeger et al. 2016). The moved view is interpolated by cubics, which blur
    little.

    Raises
    ------
    ValueError
        The mask is empty.
    """
    box = mask_box(mask, MARGIN_PX)
    flow = _smooth_flow(channel_mean(real[box]), channel_mean(synthetic[box]), mask[box])
    height, width = flow.shape[:2]
    v, u = np.mgrid[:height, :width].astype(np.float32)
    aligned, kept = synthetic.copy(), np.zeros_like(mask)
    to_u, to_v = u + flow[..., 0], v + flow[..., 1]
    aligned[box] = np.clip(
        cv2.remap(synthetic[box], to_u, to_v, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE), 0, 1
    )
    # nothing may come from beyond the border
    there = cv2.remap(mask[box].astype(np.float32), to_u, to_v, cv2.INTER_LINEAR) > 0.999
    kept[box] = mask[box] & there
    lengths = _lengths(flow)[mask[box]]
    return FlowAlignment(aligned, kept, float(np.median(lengths)), float(np.percentile(lengths, 95)))


def _smooth_flow(real: np.ndarray, synthetic: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """``(H, W, 2)`` float32: the pixel at x of the photograph shows what the view shows at x + flow."""
    real, synthetic = _continued(real, mask), _continued(synthetic, mask)
    factor = max(1.0, SMALLEST_PX / min(mask.shape))
    size = (round(mask.shape[1] * factor), round(mask.shape[0] * factor))
    codes = [np.clip(np.rint(cv2.resize(image, size) * 255), 0, 255).astype(np.uint8) for image in (real, synthetic)]
    there, back = _dense_flow(codes[0], codes[1]), _dense_flow(codes[1], codes[0])
    flow = cv2.resize(there, mask.shape[::-1]) / np.float32(factor)
    error = cv2.resize(_closing_error(there, back), mask.shape[::-1]) / np.float32(factor)
    weight = np.where(mask, _texture(synthetic) + 1e-6, 0) / (1 + (error / CLOSING_PX) ** 2) ** 2
    sigma = max(SMOOTHING * max(mask.shape), LEAST_SMOOTHING_PX)
    planes = np.stack(cv2.split(flow))
    # from the typical displacement to local ones, without what they do not explain
    smooth = np.median(planes[:, mask], axis=1).astype(np.float32)[:, None, None]
    for _ in range(ROUNDS):
        left = cv2.magnitude(*(planes - smooth))
        width = np.float32(max(float(np.median(left[mask])), LEAST_WIDTH_PX))
        kept = weight / (1 + (left / width) ** 2) ** 2
        total = _blurred(kept, sigma)
        # where nothing is known nearby, the typical displacement
        prior = np.float32(PRIOR * float(total[mask].max()))
        moved = planes * kept
        typical = moved.sum(axis=(1, 2)) / max(float(kept.sum()), 1e-20)
        smooth = np.stack([_blurred(plane, sigma) for plane in moved])
        smooth = (smooth + prior * typical[:, None, None]) / (total + prior + np.float32(1e-20))
    return np.ascontiguousarray(smooth.transpose(1, 2, 0))


def _dense_flow(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """``(H, W, 2)`` float32: the pixel at x of the first image is at x + flow in the second."""
    search = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
    search.setFinestScale(0)
    return np.asarray(search.calc(first, second, np.zeros((*first.shape, 2), np.float32)), np.float32)


def _closing_error(there: np.ndarray, back: np.ndarray) -> np.ndarray:
    """``(H, W)`` how far a pixel comes back from where it started, px."""
    v, u = np.mgrid[: there.shape[0], : there.shape[1]].astype(np.float32)
    returned = cv2.remap(back, u + there[..., 0], v + there[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return _lengths(there + returned)


def _lengths(vectors: np.ndarray) -> np.ndarray:
    """``(H, W, 2)`` -> ``(H, W)``; numpy is slow along an axis of two."""
    return cv2.magnitude(*cv2.split(vectors))


def _texture(image: np.ndarray) -> np.ndarray:
    """``(H, W)`` smaller eigenvalue of the structure tensor: large where a displacement shows in both directions."""
    x, y = cv2.Sobel(image, cv2.CV_32F, 1, 0), cv2.Sobel(image, cv2.CV_32F, 0, 1)
    xx, yy, xy = (_blurred(product, TEXTURE_PX) for product in (x * x, y * y, x * y))
    return (xx + yy) / 2 - np.sqrt(((xx - yy) / 2) ** 2 + xy**2)


def _continued(image: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """The image inside the mask; outside, the blurred colours of its border, and the mean far from it."""
    weight = mask.astype(np.float32)
    total = _blurred(weight, FILL_PX)
    mean = np.float32(image[mask].mean())
    around = (_blurred(image * weight, FILL_PX) + np.float32(1e-3) * mean) / (total + np.float32(1e-3))
    return np.where(mask, image, around).astype(np.float32)


def _blurred(values: np.ndarray, sigma: float) -> np.ndarray:
    """Blurred; a wide blur of a reduced image, which differs little and takes a tenth of the time."""
    values = values.astype(np.float32)
    factor = max(int(sigma / NARROW_PX), 1)
    size = tuple(max(length // factor, 1) for length in values.shape[1::-1])
    reduced = values if factor == 1 else cv2.resize(values, size, interpolation=cv2.INTER_AREA)
    blurred = cv2.GaussianBlur(reduced, (0, 0), sigma / factor, borderType=cv2.BORDER_CONSTANT)
    return blurred if factor == 1 else cv2.resize(blurred, values.shape[1::-1])
