"""Image pyramid for coarse-to-fine refinement: the image around the surface, with the mesh decimated to match."""

from dataclasses import dataclass, replace

import cv2
import numpy as np

from ...camera.pinhole import PinholeCamera
from ...surface.decimation import cluster_vertices
from ...surface.mesh import TriangleMesh

WINDOW = 0.07
"""Standard deviation of the Gaussian window of local means, relative to the square root of the surface's area in px."""

CELL_PX = 1.5
"""Cells of the vertex clustering, in pixels of the level."""


@dataclass(frozen=True)
class PyramidLevel:
    """The image and the surface at one resolution.

    Attributes
    ----------
    camera
        Intrinsics of the cropped and downsampled image.
    image, valid
        ``(H, W, C)`` float32 and ``(H, W)`` bool.
    mesh
        Decimated to the resolution of the level.
    window_px
        Standard deviation of the window of local means, pixels of the level.
    px
        Pixels of the full image per pixel of this level.
    """

    camera: PinholeCamera
    image: np.ndarray
    valid: np.ndarray
    mesh: TriangleMesh
    window_px: float
    px: float

    def margin(self, pixels: int) -> PinholeCamera:
        """The camera of the level's image with a margin of ``pixels`` on all sides."""
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
    mesh: TriangleMesh,
    *,
    sides: tuple[float, ...],
    area_px: float,
    depth_mm: float,
) -> list[PyramidLevel]:
    """Levels in which a surface of ``area_px`` in the image covers ``side**2`` pixels, in the order of ``sides``.

    Parameters
    ----------
    image, valid
        ``(H, W, C)`` the part of the image around the surface, and ``(H, W)`` bool: pixels that may be used.
    camera, mesh
        Those of this part, at full resolution.
    sides
        Increasing. Levels are never upsampled: those finer than the image are replaced by one at its resolution.
    depth_mm
        Typical depth of the surface, which sets the decimation.
    """
    levels: list[PyramidLevel] = []
    for side in reversed(sides):
        factor = min(side / np.sqrt(area_px), 1.0)
        if factor == 1.0 and levels:
            continue
        size = max(round(camera.width * factor), 8), max(round(camera.height * factor), 8)
        reduced, used = reduced_image(image, valid, size)
        level_camera = camera.resized(*size)
        cell_mm = CELL_PX * depth_mm / min(level_camera.fx, level_camera.fy)
        levels.append(
            PyramidLevel(
                camera=level_camera,
                image=reduced,
                valid=used,
                mesh=cluster_vertices(levels[-1].mesh if levels else mesh, cell_mm),
                window_px=WINDOW * factor * np.sqrt(area_px),
                px=camera.width / size[0],
            )
        )
    return levels[::-1]


def reduced_image(image: np.ndarray, valid: np.ndarray, size_wh: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """The image ``(h, w, C)`` float32 and its usable pixels ``(h, w)`` at a smaller size; means over usable pixels."""
    mask = valid.astype(np.float32)
    weight = cv2.resize(mask, size_wh, interpolation=cv2.INTER_AREA)
    reduced = cv2.resize(image * mask[..., None], size_wh, interpolation=cv2.INTER_AREA)
    reduced = reduced.reshape(*weight.shape, -1) / np.maximum(weight, 1e-6)[..., None]
    return reduced.astype(np.float32), weight > 0.5
