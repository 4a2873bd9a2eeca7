"""The part of an image that an alignment looks at, from coarse to fine, with the surface reduced to match."""

from dataclasses import dataclass, replace

import cv2
import numpy as np

from ...camera.pinhole import PinholeCamera
from ...surface.decimation import cluster_vertices
from .shading_features import Surface

WINDOW = 0.07
"""Standard deviation of the window of local means over the square root of the surface's area in the image."""

CELL_PX = 1.5
"""Cells of the reduced surface, in pixels of the level."""


@dataclass(frozen=True)
class PyramidLevel:
    """One resolution.

    Attributes
    ----------
    camera
        Of the cropped and reduced image.
    image, valid
        ``(H, W, C)`` float32 and ``(H, W)`` bool.
    surface
        With detail to match.
    window_px
        Window of local means.
    px
        Pixels of the full image per pixel of this level.
    """

    camera: PinholeCamera
    image: np.ndarray
    valid: np.ndarray
    surface: Surface
    window_px: float
    px: float

    def margin(self, pixels: int) -> PinholeCamera:
        """The camera of the level's image with a margin on all sides."""
        camera = self.camera
        return replace(
            camera,
            width=camera.width + 2 * pixels,
            height=camera.height + 2 * pixels,
            cx=camera.cx + pixels,
            cy=camera.cy + pixels,
        )


def pyramid(
    image: np.ndarray,
    valid: np.ndarray,
    camera: PinholeCamera,
    surface: Surface,
    *,
    crop: tuple[int, int, int, int],
    sides: tuple[float, ...],
    area_px: float,
    depth_mm: float,
) -> list[PyramidLevel]:
    """Levels in which a surface of ``area_px`` in the image has an area of ``side**2``, in the order of ``sides``.

    Parameters
    ----------
    crop
        Pixels x0 <= x < x1, y0 <= y < y1 as (x0, y0, x1, y1).
    sides
        Increasing. Nothing is enlarged: levels that would be finer than the image are left out but for one at its own
        resolution.
    depth_mm
        Of the surface, for the detail that a pixel shows.
    """
    x0, y0, x1, y1 = crop
    part = replace(camera, width=x1 - x0, height=y1 - y0, cx=camera.cx - x0, cy=camera.cy - y0)
    pixels, mask = image[y0:y1, x0:x1], valid[y0:y1, x0:x1].astype(np.float32)
    levels: list[PyramidLevel] = []
    for side in reversed(sides):
        factor = min(side / np.sqrt(area_px), 1.0)
        if factor == 1.0 and levels:
            continue
        size = max(round(part.width * factor), 8), max(round(part.height * factor), 8)
        weight = cv2.resize(mask, size, interpolation=cv2.INTER_AREA)
        reduced = cv2.resize(pixels * mask[..., None], size, interpolation=cv2.INTER_AREA)
        reduced = reduced.reshape(*weight.shape, -1) / np.maximum(weight, 1e-6)[..., None]
        level_camera = part.resized(*size)
        previous = levels[-1].surface if levels else surface
        cell_mm = CELL_PX * depth_mm / min(level_camera.fx, level_camera.fy)
        levels.append(
            PyramidLevel(
                camera=level_camera,
                image=reduced.astype(np.float32),
                valid=weight > 0.5,
                surface=Surface(*cluster_vertices(previous.mesh, cell_mm, previous.colours)),
                window_px=WINDOW * factor * np.sqrt(area_px),
                px=part.width / size[0],
            )
        )
    return levels[::-1]
