"""Views of a dataset in memory, and random crops of them to train on.

In held-out photographs the light moves with the lens, and nothing is cut out of the background; so crops are turned,
zoomed, relit, blurred, partly hidden, and lie on random backgrounds. Needs ``cv2``.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from operator import attrgetter

import cv2
import numpy as np

from ..camera.pinhole import PinholeCamera
from ..errors import InputError
from ..reader import View
from ..reader.background import random_background, smooth
from ..transforms import inverse_rigid, transform_points
from .pose_network import MULTIPLE, STRIDE, NetworkRecord

CROP_WH = 128, 96
"""Largest crop, px."""
MUCH_LARGER = 1.25
"""Views in which the surface is larger than a crop by this factor are made smaller."""

FULL = 32000
"""Code of the farthest surface from the middle of its box; codes are signed."""
NOTHING = -32768
"""Code where there is no surface."""


@dataclass(frozen=True)
class ViewCrops:
    """Views in memory, so small that a crop holds what they show of the surface.

    Attributes
    ----------
    rgba
        ``(N, H, W, 4)`` uint8, alpha 0 and black where nothing is seen, nor around the surface.
    around
        ``(N, H, W)`` bool: what surrounds the surface, with ``--surroundings``. Half of the crops do without: elsewhere
        something else may be there.
    codes
        ``(N, H, W, 3)`` int16: the surface's point at each pixel, from the middle of its box, or :data:`NOTHING`.
    middles
        ``(N, 2)`` px: the middle of what each view shows of the surface.
    camera
        Of the views at this size.
    centre_model, reach_mm
        ``(3,)`` mm the middle of the surface's box, and what :data:`FULL` stands for.
    """

    rgba: np.ndarray
    around: np.ndarray
    codes: np.ndarray
    middles: np.ndarray
    camera: PinholeCamera
    centre_model: np.ndarray
    reach_mm: float

    @classmethod
    def of(
        cls,
        views: Sequence[View],
        rgb: Callable[[View], np.ndarray] = attrgetter("rgb"),
        advance: Callable[[], None] = lambda: None,
    ) -> "ViewCrops":
        """Read views of one dataset, and colours ``(H, W, 3)`` uint8 for each; after each ``advance`` is called."""
        files, boxes = views[0].files, np.array([view.boxes.bbox_visib for view in views])
        camera = files.description.camera
        too_large = float((np.median(boxes[:, 2:], axis=0) / CROP_WH).max())
        if too_large > MUCH_LARGER:
            camera = camera.resized(round(camera.width / too_large), round(camera.height / too_large))
        if min(camera.size_wh) < 2 * MULTIPLE:
            raise InputError(
                f"expected views of at least {2 * MULTIPLE} px, found {camera.width}x{camera.height}; render larger"
            )
        least, most = files.mesh.bounds
        centre, reach_mm = (least + most) / 2, float((most - least).max() / 2)
        rays = camera.rays_cam(camera.pixel_grid())
        rgba = np.zeros((len(views), *camera.shape_hw, 4), np.uint8)
        around = np.zeros((len(views), *camera.shape_hw), bool)
        codes = np.full((len(views), *camera.shape_hw, 3), NOTHING, np.int16)
        middles = np.zeros((len(views), 2))
        for place, view in enumerate(views):
            surface_mm = view.depth_mm * view.mask
            covers = (view.mask | view.mask_occluder | view.mask_surround)[..., None]
            depth_mm = cv2.resize(surface_mm, camera.size_wh, interpolation=cv2.INTER_NEAREST_EXACT)
            shown = np.dstack([rgb(view), np.full(covers.shape, 255, np.uint8)]) * covers
            small = cv2.resize(shown, camera.size_wh, interpolation=cv2.INTER_AREA)
            drawn = small[..., 3] >= 128
            seen = drawn & (depth_mm > 0)
            beside = view.mask_surround.astype(np.uint8)
            around[place] = cv2.resize(beside, camera.size_wh, interpolation=cv2.INTER_NEAREST_EXACT)
            points = transform_points(inverse_rigid(view.cam_from_model), rays[seen] * depth_mm[seen][:, None])
            codes[place][seen] = np.rint((points - centre) * (FULL / reach_mm))
            # what is beside all that does not count
            rgba[place][drawn] = np.rint(255.0 * small[drawn] / small[drawn][:, 3:])
            middles[place] = np.argwhere(seen)[:, ::-1].mean(axis=0)
            advance()
        return cls(rgba, around, codes, middles, camera, centre, reach_mm)

    @property
    def crop_wh(self) -> tuple[int, int]:
        """Width and height of the crops."""
        width, height = self.camera.size_wh
        return min(width, CROP_WH[0]) // MULTIPLE * MULTIPLE, min(height, CROP_WH[1]) // MULTIPLE * MULTIPLE

    def record(self, views: Sequence[View], steps: int, seed: int) -> NetworkRecord:
        """What a network belongs to that was trained on the crops of these views."""
        description, (width, height) = views[0].files.description, self.camera.size_wh
        return NetworkRecord(
            surface=str(description.content["geometry_sha256"]),
            dataset=description.identity,
            views=len(views),
            steps=steps,
            seed=seed,
            width=width,
            height=height,
            fx=self.camera.fx,
            centre_model=tuple(self.centre_model.tolist()),
            reach_mm=self.reach_mm,
        )

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
        rgba = self.rgba[place]
        if self.around[place].any() and rng.random() < 0.5:
            rgba = rgba * ~self.around[place][..., None]
        rgba = cv2.warpAffine(rgba, view_from_crop, (width, height), flags=inverse | cv2.INTER_LINEAR)
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
    ``(h, w, 3)`` uint8, and ``(h, w)`` uint8, above 0 where something hides it.
    """
    height, width = rgba.shape[:2]
    light = rgba[..., :3] + (1 - rgba[..., 3:] / np.float32(255)) * random_background(rng, width, height)
    light *= smooth(np.exp(rng.normal(0, 0.12, (3, 4, 1))), width, height)
    tone = np.linspace(0, 1, 256)[:, None] ** np.exp(rng.normal(0, 0.2))
    tone = 255 * tone * np.exp(rng.normal(-0.05, 0.12) + rng.normal(0, 0.04, 3)) + rng.normal(0, 8)
    image = cv2.LUT(np.clip(light, 0, 255).astype(np.uint8), np.clip(tone, 0, 255).astype(np.uint8)[None])
    hidden = np.zeros((height, width), np.uint8)
    for _ in range(rng.integers(0, 3)):
        # tools, and blood
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
