"""The blur of a frame beside a view of what it shows: out of focus, and moved along a line.

Blur takes fine detail away wherever the surface lies, so the spectra of both tell it before the pose is exact: the
frame's is the view's times the blur's, and noise.
"""

from collections.abc import Callable
from typing import NamedTuple

import cv2
import numpy as np
from numpy.fft import fftfreq, rfft2, rfftfreq

TAPER_PX = 40.0
"""From the border of a mask to where its pixels count fully: an edge has a spectrum of its own."""
LOWEST, HIGHEST, FREQUENCIES = 1 / 60, 0.35, 3000
"""Of the frequencies that are compared, in cycles a pixel, and how many at most."""
LENGTHS = (0.6, 0.8, 1.0, 1.25, 1.6)
"""Of a motion that are tried, as shares of that of a Gaussian as wide."""
SHARPEST_PX = 0.3
TINY = 1e-6
"""Beside the squared code values of spectra."""


class Blur(NamedTuple):
    """A Gaussian of a standard deviation in px, and an even motion along ``(2,)`` px."""

    focus_px: float
    motion_px: np.ndarray

    @property
    def covariance_px(self) -> np.ndarray:
        """``(2, 2)`` px²: how wide it is, in each direction."""
        return self.focus_px**2 * np.eye(2) + np.outer(self.motion_px, self.motion_px) / 12

    @property
    def width_px(self) -> float:
        """Length of an even motion that is as wide, px."""
        return float(np.sqrt(12 * np.linalg.eigvalsh(self.covariance_px)[1]))

    def of(self, grey: np.ndarray, mask: np.ndarray) -> np.ndarray:
        """``(H, W)`` uint8 blurred within a mask, as if the rest were not there."""
        shares, codes = (
            cv2.filter2D(each.astype(np.float32), -1, self._kernel(), borderType=cv2.BORDER_REFLECT)
            for each in (mask, np.where(mask, grey, 0))
        )
        return np.where(mask, np.rint(codes / np.maximum(shares, 1e-3)), grey).astype(np.uint8)

    def _kernel(self) -> np.ndarray:
        steps = np.linspace(-0.5, 0.5, 2 * int(np.linalg.norm(self.motion_px)) + 1)[:, None] * self.motion_px
        reach = int(np.ceil(np.abs(steps).max() + 3 * self.focus_px)) + 1
        line = np.zeros((2 * reach + 1,) * 2)
        column, row = reach + np.rint(steps).astype(int).T
        np.add.at(line, (row, column), 1 / len(steps))
        kernel = cv2.GaussianBlur(line, (0, 0), max(self.focus_px, SHARPEST_PX), borderType=cv2.BORDER_CONSTANT)
        return kernel / kernel.sum()


def blur_between(sharp: np.ndarray, blurred: np.ndarray, mask: np.ndarray) -> Blur:
    """The blur that makes one ``(H, W)`` uint8 image of another that shows about the same, within a mask."""
    # that takes a while, and few frames come here
    from scipy.optimize import least_squares

    frequencies, before, after = _spectra(sharp, blurred, mask)
    squares = (frequencies**2).sum(axis=1)
    # each octave tells as much
    weight = np.sqrt(squares.min() / squares)
    lowest = squares <= np.quantile(squares, 0.05)
    gain = np.median(after[lowest] / before[lowest])

    def residuals(values: np.ndarray, weaker: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
        gain, noise = np.exp(np.clip(values[3:], -60, 60))
        return weight * np.log((before * gain * weaker(values[:3]) + noise + TINY) / after)

    def gaussian(root: np.ndarray) -> np.ndarray:
        wide = frequencies @ np.array([[root[0], 0], [root[1], root[2]]])
        return np.exp(-np.minimum((2 * np.pi) ** 2 * (wide**2).sum(axis=1), 60))

    def moved(blur: np.ndarray) -> np.ndarray:
        focus = np.exp(-np.minimum((2 * np.pi * blur[0]) ** 2 * squares, 60))
        return focus * np.sinc(frequencies @ blur[1:]) ** 2

    start = [2.0, 0.0, 2.0, np.log(gain), np.log(np.quantile(after, 0.05))]
    rough = least_squares(residuals, start, args=(gaussian,), loss="soft_l1", max_nfev=60).x
    root = np.array([[rough[0], 0], [rough[1], rough[2]]])
    (least, most), axes = np.linalg.eigh(root @ root.T)
    line = axes[:, 1] * np.sqrt(12 * (most - least))
    fits = [
        least_squares(
            residuals, [np.sqrt(max(least, 0.01)), *(length * line), *rough[3:]], args=(moved,), loss="soft_l1",
            max_nfev=25,
        )
        for length in LENGTHS
    ]  # fmt: skip
    focus, *motion = min(fits, key=lambda fit: fit.cost).x[:3]
    return Blur(abs(float(focus)), np.array(motion))


def _spectra(*images_and_mask: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """``(F, 2)`` frequencies in x and y, and the power of both images at each, where they are masked."""
    *images, mask = images_and_mask
    v, u = np.nonzero(mask)
    box = np.s_[v.min() : v.max() + 1, u.min() : u.max() + 1]
    depth = cv2.distanceTransform(np.pad(mask[box].astype(np.uint8), 1), cv2.DIST_L2, 3)[1:-1, 1:-1]
    window = (1 - np.cos(np.pi * np.minimum(depth / min(TAPER_PX, np.max(depth)), 1))) / 2
    shape = [cv2.getOptimalDFTSize(side) for side in window.shape]
    x, y = np.meshgrid(rfftfreq(shape[1]), fftfreq(shape[0]))
    radius = np.hypot(x, y)
    chosen = np.flatnonzero((radius > LOWEST) & (radius < HIGHEST))
    chosen = chosen[:: max(1, len(chosen) // FREQUENCIES)]
    powers = [
        # the Laplacian is about white: what a window makes of strong low frequencies would hide the others
        cv2.blur(np.abs(rfft2(window * cv2.Laplacian(image[box].astype(np.float32), cv2.CV_32F), shape)) ** 2, (3, 3))
        for image in images
    ]
    before, after = (power.ravel()[chosen] + TINY for power in powers)
    return np.stack([x.ravel()[chosen], y.ravel()[chosen]], axis=1), before, after
