"""What makes a frame worse than the one that is aligned: light, sensor, what covers it, focus and motion.

Needs ``cv2``.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from oneframe.images.pixel_values import to_uint8

from .refinement import Spoil, blurred, noisy, occluded, specular

BLOOD = np.array([0.35, 0.03, 0.02], np.float32)
HAZE = 0.85


@dataclass(frozen=True)
class Degradation:
    """A kind: what it does to a frame, by which amounts, of which one leaves it clean, and the label of these."""

    spoil: Spoil
    amounts: tuple[float, ...]
    clean: float
    label: str


def compressed(image: np.ndarray, quality: float, _rng: np.random.Generator) -> np.ndarray:
    """The frame after JPEG."""
    coded = cv2.imencode(".jpg", to_uint8(image), [cv2.IMWRITE_JPEG_QUALITY, int(quality)])[1]
    return cv2.imdecode(coded, cv2.IMREAD_COLOR).astype(np.float32) / 255


def bloody(image: np.ndarray, part: float, rng: np.random.Generator) -> np.ndarray:
    """The frame with opaque pools over this part of it, with a soft rim."""
    height, width = image.shape[:2]
    field = cv2.GaussianBlur(rng.normal(size=(height, width)).astype(np.float32), (0, 0), width / 16)
    cover = (field > np.quantile(field, 1 - part)).astype(np.float32)
    soft = cv2.GaussianBlur(cover, (0, 0), 1.5)[..., None]
    return (1 - soft) * image + soft * BLOOD


def shaken(image: np.ndarray, length_px: float, rng: np.random.Generator) -> np.ndarray:
    """The frame blurred by a straight motion in a random direction."""
    angle, steps = rng.uniform(0, np.pi), np.linspace(-0.5, 0.5, int(2 * length_px) + 1) * length_px
    side = int(length_px) + 3
    kernel = np.zeros((side, side))
    u, v = (np.rint(side // 2 + steps * turn).astype(int) for turn in (np.cos(angle), np.sin(angle)))
    np.add.at(kernel, (v, u), 1 / len(steps))
    return cv2.filter2D(image, -1, kernel, borderType=cv2.BORDER_REFLECT)


DEGRADATIONS = {
    "gain": Degradation(lambda i, a, _: i * np.float32(a), (0.2, 0.35, 1.0, 1.6, 2.6), 1.0, "factor"),
    "gamma": Degradation(lambda i, a, _: i ** np.float32(a), (0.4, 0.6, 1.0, 1.7, 2.5), 1.0, "exponent"),
    "noise": Degradation(noisy, (0.0, 0.03, 0.1, 0.2, 0.4), 0.0, "standard deviation (of 1)"),
    "JPEG": Degradation(compressed, (100.0, 40.0, 20.0, 10.0, 4.0), 100.0, "quality"),
    "haze": Degradation(
        lambda i, a, _: i + np.float32(a) * (np.float32(HAZE) - i), (0.0, 0.3, 0.6, 0.85, 0.95), 0.0, "opacity"
    ),
    "instruments": Degradation(occluded, (0.0, 0.2, 0.4, 0.6, 0.8), 0.0, "part covered"),
    "blood": Degradation(bloody, (0.0, 0.2, 0.4, 0.6, 0.8), 0.0, "part covered"),
    "glare": Degradation(specular, (0.0, 0.05, 0.1, 0.2, 0.4), 0.0, "part under glare"),
    "blur": Degradation(blurred, (0.0, 1.5, 3.0, 5.0, 8.0), 0.0, "standard deviation (px)"),
    "motion blur": Degradation(shaken, (0.0, 9.0, 18.0, 35.0, 55.0), 0.0, "length (px)"),
}
CLEAN, WRONG = "clean", ("mirrored", "other scene")
