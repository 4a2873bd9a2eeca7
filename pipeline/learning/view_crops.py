"""Views of a dataset in memory, and random crops of them to train on.

In held-out photographs the light moves with the lens, and nothing is cut out of the background; so crops are turned,
zoomed, relit, blurred, partly hidden, and lie on random backgrounds. Needs ``cv2``.
"""

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np

from oneframe.reader import Dataset, View
from oneframe.surface.mesh import TriangleMesh
from oneframe.transforms import inverse_rigid, transform_points

STRIDE = 8
"""Pixels from one cell of the network to the next."""
MULTIPLE = 2 * STRIDE
"""Width and height of what the network sees are multiples of this."""

CROP_WH = 128, 96
"""Largest crop, px."""

FULL = 32000
"""Code of the farthest surface from the middle of its box; codes are signed."""
NOTHING = -32768
"""Code where there is no surface."""


@dataclass(frozen=True)
class ViewCrops:
    """Views in memory.

    Attributes
    ----------
    rgba
        ``(N, H, W, 4)`` uint8, alpha 0 and black where there is no surface.
    codes
        ``(N, H, W, 3)`` int16: the surface's point at each pixel, from the middle of its box, or :data:`NOTHING`.
    middles
        ``(N, 2)`` px: the middle of what each view shows of the surface.
    centre_model, reach_mm
        ``(3,)`` mm the middle of the surface's box, and what :data:`FULL` stands for.
    """

    rgba: np.ndarray
    codes: np.ndarray
    middles: np.ndarray
    centre_model: np.ndarray
    reach_mm: float

    @classmethod
    def of(cls, views: Dataset, mesh: TriangleMesh, rgb: Callable[[View], np.ndarray]) -> "ViewCrops":
        """Read views of a surface (model frame), and colours ``(H, W, 3)`` uint8 for each."""
        least, most = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
        centre, reach_mm = (least + most) / 2, float((most - least).max() / 2)
        width, height = views.size_wh
        pixels = np.stack([*np.meshgrid(np.arange(width), np.arange(height)), np.ones((height, width))], axis=-1)
        rgba = np.zeros((len(views), height, width, 4), np.uint8)
        codes = np.full((len(views), height, width, 3), NOTHING, np.int16)
        middles = np.zeros((len(views), 2))
        for place, view in enumerate(views):
            seen, rays = view.mask, pixels @ np.linalg.inv(view.k).T
            points = transform_points(inverse_rigid(view.cam_from_model), rays[seen] * view.depth_mm[seen][:, None])
            codes[place][seen] = np.rint((points - centre) * (FULL / reach_mm))
            rgba[place][seen, :3] = rgb(view)[seen]
            rgba[place][seen, 3] = 255
            middles[place] = pixels[seen][:, :2].mean(axis=0)
        return cls(rgba, codes, middles, centre, reach_mm)

    @property
    def crop_wh(self) -> tuple[int, int]:
        """Width and height of the crops."""
        height, width = self.rgba.shape[1:3]
        return min(width, CROP_WH[0]) // MULTIPLE * MULTIPLE, min(height, CROP_WH[1]) // MULTIPLE * MULTIPLE

    def crop(self, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """A random crop ``(h, w, 3)`` uint8 of a random view, and ``(h / 8, w / 8, 3)`` codes at its cells."""
        place, (width, height) = rng.integers(len(self.rgba)), self.crop_wh
        angle, zoom = np.radians(rng.uniform(-20, 20)), np.exp(rng.uniform(-0.18, 0.18))
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]) / zoom
        shift = rng.uniform(-0.15, 0.15, 2) * (width, height)
        middle = self.middles[place] + shift - turn @ [(width - 1) / 2, (height - 1) / 2]
        view_from_crop = np.column_stack([turn, middle])
        cells = view_from_crop @ [[STRIDE, 0, (STRIDE - 1) / 2], [0, STRIDE, (STRIDE - 1) / 2], [0, 0, 1]]
        inverse = cv2.WARP_INVERSE_MAP
        rgba = cv2.warpAffine(self.rgba[place], view_from_crop, (width, height), flags=inverse | cv2.INTER_LINEAR)
        codes = cv2.warpAffine(
            self.codes[place], cells, (width // STRIDE, height // STRIDE), flags=inverse | cv2.INTER_NEAREST,
            borderValue=[NOTHING] * 3,
        )  # fmt: skip
        image, hidden = _photographed(rgba, rng)
        codes[hidden[STRIDE // 2 :: STRIDE, STRIDE // 2 :: STRIDE] > 0] = NOTHING
        return image, codes


def _photographed(rgba: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """A crop ``(h, w, 4)`` as another light, lens and background would show it, and what lies before it.

    Returns
    -------
    ``(h, w, 3)`` uint8, and ``(h, w)`` uint8, above 0 where instruments hide it.
    """
    height, width = rgba.shape[:2]
    light = rgba[..., :3] + (1 - rgba[..., 3:] / np.float32(255)) * _background(rng, width, height)
    light *= _smooth(np.exp(rng.normal(0, 0.12, (3, 4, 1))), width, height)
    tone = np.linspace(0, 1, 256)[:, None] ** np.exp(rng.normal(0, 0.2))
    tone = 255 * tone * np.exp(rng.normal(-0.05, 0.12) + rng.normal(0, 0.04, 3)) + rng.normal(0, 8)
    image = cv2.LUT(np.clip(light, 0, 255).astype(np.uint8), np.clip(tone, 0, 255).astype(np.uint8)[None])
    hidden = np.zeros((height, width), np.uint8)
    for _ in range(rng.integers(0, 3)):
        # instruments, and blood
        ellipse = _ellipse(rng, 0.03, 0.25, width, height)
        cv2.ellipse(image, ellipse, rng.uniform(0, 255, 3).tolist(), -1)
        cv2.ellipse(hidden, ellipse, [255.0], -1)
    for _ in range(rng.integers(0, 6)):
        # highlights
        cv2.ellipse(image, _ellipse(rng, 0.005, 0.03, width, height), [255.0] * 3, -1)
    if rng.random() < 0.5:
        image = cv2.GaussianBlur(image, (0, 0), rng.uniform(0.3, 1.2))
    noise = rng.uniform(0, 8) * rng.standard_normal(image.shape, np.float32)
    return np.clip(image + noise, 0, 255).astype(np.uint8), hidden


def _ellipse(
    rng: np.random.Generator, least: float, most: float, width: int, height: int
) -> tuple[list[float], list[float], float]:
    """Centre, axes (``least`` to ``most`` of the width) and angle, as OpenCV takes them."""
    centre, axes = rng.uniform(0, (width, height)), rng.uniform(least, most, 2) * width
    return centre.tolist(), axes.tolist(), rng.uniform(0, 180)


def _background(rng: np.random.Generator, width: int, height: int) -> np.ndarray:
    """Coarse patches and fine texture ``(h, w, 3)`` of random contrast, from flat to garish."""
    coarse, fine = (
        _smooth(rng.normal(0, 1, (*rng.integers(2, most, 2), channels)), width, height)
        for most, channels in ((8, 3), (min(width, height), 1))
    )
    return rng.uniform(0, 255) + rng.normal(0, 30, 3) + rng.exponential(40) * coarse + rng.exponential(30) * fine


def _smooth(values: np.ndarray, width: int, height: int) -> np.ndarray:
    """Few random values ``(h, w, C)`` spread smoothly over an image ``(H, W, C)`` float32."""
    spread = cv2.resize(values.astype(np.float32), (width, height), interpolation=cv2.INTER_LINEAR)
    return spread.reshape(height, width, -1)
