"""What lies behind the surface in a view, at random: networks should not learn that it is black."""

from collections.abc import Sequence

import cv2
import numpy as np

from ..errors import InputError
from .view import View


def with_background(view: View, rng: np.random.Generator, images: Sequence[np.ndarray] = ()) -> np.ndarray:
    """``(H, W, 3)`` uint8 RGB of a view with something behind surface and occluders, in place of any surroundings.

    Parameters
    ----------
    view
        The view.
    rng
        Source of what is shown.
    images
        ``(h, w, 3)`` uint8 RGB of any size, one of which is shown, cut to the view's proportions; without any, patches
        and texture of random colours are.
    """
    height, width = view.rgb.shape[:2]
    if len(images):
        image = images[int(rng.integers(len(images)))]
        if image.dtype != np.uint8 or image.ndim != 3 or image.shape[2] != 3:
            raise InputError(
                f"background: expected images (h, w, 3) of uint8 RGB, found {image.dtype} {image.shape}; convert them"
            )
        factor = max(width / image.shape[1], height / image.shape[0])
        size_wh = max(width, round(factor * image.shape[1])), max(height, round(factor * image.shape[0]))
        large = cv2.resize(image, size_wh, interpolation=cv2.INTER_AREA if factor < 1 else cv2.INTER_LINEAR)
        left, top = rng.integers(size_wh[0] - width + 1), rng.integers(size_wh[1] - height + 1)
        behind = large[top : top + height, left : left + width]
    else:
        behind = random_background(rng, width, height).clip(0, 255).astype(np.uint8)
    return np.where((view.mask_whole | view.mask_occluder)[..., None], view.rgb, behind)


def random_background(rng: np.random.Generator, width: int, height: int) -> np.ndarray:
    """Coarse patches and fine texture ``(h, w, 3)`` of random contrast, from flat to garish."""
    coarse, fine = (
        smooth(rng.normal(0, 1, (*rng.integers(2, most, 2), channels)), width, height)
        for most, channels in ((8, 3), (min(width, height), 1))
    )
    return rng.uniform(0, 255) + rng.normal(0, 30, 3) + rng.exponential(40) * coarse + rng.exponential(30) * fine


def smooth(values: np.ndarray, width: int, height: int) -> np.ndarray:
    """Few random values ``(h, w, C)`` spread smoothly over an image ``(H, W, C)`` float32."""
    spread = cv2.resize(values.astype(np.float32), (width, height), interpolation=cv2.INTER_LINEAR)
    return spread.reshape(height, width, -1)
