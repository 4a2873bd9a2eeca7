"""Correlation of two images over all shifts at once, each shift over its own overlap of valid pixels.

By Fourier transforms (Padfield, "Masked object registration in the Fourier domain", 2012).
"""

from collections.abc import Iterable
from typing import NamedTuple

import cv2
import numpy as np

from .canonical_correlation import summed_correlation


class Spectra(NamedTuple):
    """Packed Fourier transforms ``(H, W)`` of an image.

    Attributes
    ----------
    region
        That of its valid pixels.
    planes
        Those of its planes, which are 0 elsewhere.
    products
        Those of the products of two planes, by their numbers.
    """

    region: np.ndarray
    planes: list[np.ndarray]
    products: dict[tuple[int, int], np.ndarray]

    @classmethod
    def of(cls, region: np.ndarray, planes: Iterable[np.ndarray], shape: tuple[int, int]) -> "Spectra":
        """Transform an image ``(h, w)``, in the corner of a canvas of some shape."""
        planes = list(planes)
        pairs = [(k, m) for k in range(len(planes)) for m in range(k, len(planes))]
        return cls(
            spectrum(region, shape),
            [spectrum(plane, shape) for plane in planes],
            {(k, m): spectrum(planes[k] * planes[m], shape) for k, m in pairs},
        )


def spectrum(plane: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """The packed Fourier transform of a plane ``(h, w)`` in the corner of a canvas."""
    canvas = np.zeros(shape, np.float32)
    canvas[: plane.shape[0], : plane.shape[1]] = plane
    return cv2.dft(canvas)


def correlated(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """``(H, W)`` by shift (y, x), cyclic: the sum of ``one`` times the ``other``, moved by the shift; both packed."""
    return cv2.idft(cv2.mulSpectrums(one, other, 0, conjB=True), flags=cv2.DFT_SCALE | cv2.DFT_REAL_OUTPUT)


def correlation_scores(features: Spectra, image: Spectra, reach: int, least_area: float) -> np.ndarray:
    """``(2 reach + 1, 2 reach + 1)`` sums of the squared canonical correlations by shift (y, x), from -reach.

    The image is moved against the features; 0 where both overlap in less than ``least_area`` px.
    """
    rows, columns = (np.r_[size - reach : size, 0 : reach + 1] for size in features.region.shape)

    def within_reach(one: np.ndarray, other: np.ndarray) -> np.ndarray:
        return correlated(one, other)[rows][:, columns].astype(np.float64)

    area = within_reach(features.region, image.region)
    count = np.maximum(area, 1.0)
    mean_p = np.stack([within_reach(each, image.region) for each in features.planes], axis=-1) / count[..., None]
    mean_y = np.stack([within_reach(features.region, each) for each in image.planes], axis=-1) / count[..., None]
    within_p = np.empty((*area.shape, len(features.planes), len(features.planes)))
    for (k, m), product in features.products.items():
        within_p[..., k, m] = within_p[..., m, k] = within_reach(product, image.region) / count
    within_y = np.empty((*area.shape, len(image.planes), len(image.planes)))
    for (c, d), product in image.products.items():
        within_y[..., c, d] = within_y[..., d, c] = within_reach(features.region, product) / count
    between = np.stack(
        [np.stack([within_reach(one, other) for other in image.planes], axis=-1) for one in features.planes], axis=-2
    )
    within_p -= mean_p[..., :, None] * mean_p[..., None, :]
    within_y -= mean_y[..., :, None] * mean_y[..., None, :]
    between = between / count[..., None, None] - mean_p[..., :, None] * mean_y[..., None, :]
    return np.where(area >= least_area, summed_correlation(within_y, within_p, between), 0.0)
