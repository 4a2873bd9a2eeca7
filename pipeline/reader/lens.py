"""What lens and sensor make of a view, for those who augment while they train: each effect a callable, in linear light.

Of a view's truths only :class:`.DistortedView` moves any.
"""

import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from ..errors import InputError
from ..images.pixel_values import codes_from_linear, linear_from_codes, to_uint8
from .view import View

Effect = Callable[[np.ndarray, View, np.random.Generator], np.ndarray]
"""``(H, W, 3)`` float32 linear light of a view, NaN where the lens shows nothing -> the same, changed."""
Range = tuple[float, float]
"""Ends between which a number is drawn."""

_LIGHT = linear_from_codes(np.arange(256) / 255).astype(np.float32)
_CODES = to_uint8(codes_from_linear(np.arange(65536) / 65535))
"""Light of each code, and the code of light in steps of a 20th of the darkest codes' or less."""
LAYER_PX, LARGEST_PX = 0.5, 12.0
"""Steps of the blur by depth, and its most: standard deviations, px."""
_LEAST = 1e-6
"""Of what must be above 0."""
_HIDDEN = np.float32(1e-4)
"""Weight of a colour where there is no other."""


def through_lens(view: View, effects: Sequence[Effect], seed: int) -> tuple[np.ndarray, np.ndarray]:
    """A view as a lens and a sensor would show it.

    Parameters
    ----------
    view
        The view.
    effects
        One after the other, in the order in which light meets them: background, defocus, round view, exposure, noise.
        The random numbers of each depend on ``seed``, the view's number and the effect's name alone.
    seed
        Of all; another one in each epoch.

    Returns
    -------
    ``(H, W, 3)`` uint8 RGB, and ``(H, W)`` bool: what the lens shows, black elsewhere.
    """
    linear = _LIGHT[view.rgb]
    for effect in effects:
        name = getattr(effect, "__name__", type(effect).__name__)
        linear = effect(linear, view, np.random.default_rng([seed, view.index, zlib.crc32(name.encode())]))
    shown = ~np.isnan(linear).any(axis=2)
    return _CODES[(np.where(shown[..., None], linear, 0).clip(0, 1) * 65535 + 0.5).astype(np.uint16)], shown


def _check_ranges(effect: object, **bounds: Range) -> None:
    """Refuse what is no range of an effect within its bounds, without any 0 and infinity."""
    for name, ends in vars(effect).items():
        low, high = ends if np.shape(ends) == (2,) else (np.nan, np.nan)
        least, most = bounds.get(name, (0, np.inf))
        if not (least <= low <= high <= most and np.isfinite(high - low)):
            raise InputError(
                f"{type(effect).__name__}: {name}: expected two numbers from {least:g} to {most:g}, the smaller one "
                f"first, found {ends!r}"
            )


@dataclass(frozen=True)
class Defocus:
    """Blur by depth; that of an edge is its nearer side's.

    Attributes
    ----------
    px_per_mm
        Standard deviation of the blur, px, for each mm of depth from the plane in focus.
    focus
        Where that plane is among the depths of the view: 0 the nearest, 1 the farthest.
    """

    px_per_mm: Range = (0.0, 0.1)
    focus: Range = (0.05, 0.95)

    def __post_init__(self) -> None:
        _check_ranges(self, focus=(0, 1))

    def __call__(self, linear: np.ndarray, view: View, rng: np.random.Generator) -> np.ndarray:
        """Apply the effect, see :data:`Effect`."""
        per_mm, focus = rng.uniform(*self.px_per_mm), rng.uniform(*self.focus)
        seen = view.depth_mm > 0
        if not seen.any():
            return linear
        depths = view.depth_mm[seen]
        # what is behind the surface is black: as far as its farthest point
        off = np.full(seen.shape, depths.max(), np.float32)
        off[seen] = depths
        off -= np.quantile(depths, focus)
        layers = np.rint((off * np.float32(per_mm)).clip(-LARGEST_PX, LARGEST_PX) / LAYER_PX).astype(int)
        # what a nearer layer hides, and its blurred rim shows, is not known
        result, hidden = np.zeros_like(linear), _HIDDEN * _blurred(linear, np.abs(layers).max())
        for layer in np.unique(layers)[::-1]:
            # over what lies behind: with a rim as soft as this layer is blurred, without a gap to nearer ones
            cover = _blurred((layers <= layer).astype(np.float32), layer)[..., None]
            here = (layers == layer).astype(np.float32)
            colour = _blurred(linear * here[..., None], layer) + hidden
            result += cover * (colour / (_blurred(here, layer)[..., None] + _HIDDEN) - result)
        return result


def _blurred(image: np.ndarray, layer: int) -> np.ndarray:
    return cv2.GaussianBlur(image, (0, 0), abs(layer) * LAYER_PX, borderType=cv2.BORDER_REFLECT) if layer else image


@dataclass(frozen=True)
class RoundView:
    """The microscope's round view: nothing outside a circle, and less light towards its rim.

    Attributes
    ----------
    radius, off
        Of the circle, and how far its middle is from the image's across and down; relative to the image's width.
    darker
        Light that is lost at the rim, 0..1; it grows with the square of the distance.
    """

    radius: Range = (0.45, 0.7)
    off: Range = (-0.05, 0.05)
    darker: Range = (0.0, 0.4)

    def __post_init__(self) -> None:
        _check_ranges(self, radius=(_LEAST, np.inf), off=(-np.inf, np.inf), darker=(0, 1))

    def __call__(self, linear: np.ndarray, view: View, rng: np.random.Generator) -> np.ndarray:
        """Apply the effect, see :data:`Effect`."""
        height, width = linear.shape[:2]
        radius, darker = width * rng.uniform(*self.radius), rng.uniform(*self.darker)
        across, down = width * rng.uniform(*self.off, 2)
        u, v = np.arange(width) - (width - 1) / 2 - across, np.arange(height) - (height - 1) / 2 - down
        squared = ((u[None] ** 2 + v[:, None] ** 2) / radius**2).astype(np.float32)[..., None]
        return np.where(squared < 1, linear * (1 - np.float32(darker) * squared), np.float32(np.nan))


@dataclass(frozen=True)
class Exposure:
    """More or less light, and another white balance.

    Attributes
    ----------
    gain, white
        Factor of the light, and a further one of red and of blue; drawn evenly by their logarithms.
    """

    gain: Range = (0.5, 2.0)
    white: Range = (0.85, 1.18)

    def __post_init__(self) -> None:
        _check_ranges(self, gain=(_LEAST, np.inf), white=(_LEAST, np.inf))

    def __call__(self, linear: np.ndarray, view: View, rng: np.random.Generator) -> np.ndarray:
        """Apply the effect, see :data:`Effect`."""
        low, high = np.log([self.gain, self.white, self.white]).T
        gain, red, blue = np.exp(rng.uniform(low, high))
        return linear * (gain * np.array([red, 1, blue])).astype(np.float32)


@dataclass(frozen=True)
class SensorNoise:
    """Noise of light and of the sensor, of variance ``shot`` × light + ``read`` squared; white is 1."""

    shot: Range = (0.0, 0.005)
    read: Range = (0.0, 0.01)

    def __post_init__(self) -> None:
        _check_ranges(self)

    def __call__(self, linear: np.ndarray, view: View, rng: np.random.Generator) -> np.ndarray:
        """Apply the effect, see :data:`Effect`."""
        shot, read = (np.float32(rng.uniform(*ends)) for ends in (self.shot, self.read))
        deviation = np.sqrt(shot * np.maximum(linear, 0) + read**2)
        return linear + deviation * rng.standard_normal(linear.shape, np.float32)
