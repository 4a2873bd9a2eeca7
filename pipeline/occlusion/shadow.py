"""The shadow of a mesh in the light at the lens: a z-buffer from the lamp, as fine as the view's pixels."""

from dataclasses import replace

import numpy as np

from ..camera.pinhole import PinholeCamera
from ..colour.lens_shading import LensShading
from ..projection.z_buffer import rasterise_depth
from ..surface.mesh import TriangleMesh


class Shadow:
    """The shadow of a mesh, model frame, mm, in the light of the lens of a view with this pose (4x4, mm)."""

    def __init__(
        self, mesh: TriangleMesh, light: LensShading, camera: PinholeCamera, cam_from_model: np.ndarray
    ) -> None:
        self.camera, self.cam_from_model = camera, cam_from_model
        lamp, distance_mm = light.at(cam_from_model)
        self._lamp_cam_mm = x, y, _ = lamp.place_cam_mm
        lamp_from_model = cam_from_model.copy()
        lamp_from_model[:3, 3] -= self._lamp_cam_mm
        # the lens' own image where it works, and half an image around it
        cx = camera.cx + camera.fx * x / distance_mm + camera.width // 2
        cy = camera.cy + camera.fy * y / distance_mm + camera.height // 2
        self._seen = replace(camera, width=2 * camera.width, height=2 * camera.height, cx=cx, cy=cy)
        self._inverse_depth = rasterise_depth(mesh, self._seen, lamp_from_model).inverse_depth

    def covers(self, depth_mm: np.ndarray) -> np.ndarray:
        """``(H, W)`` bool: it falls on what the pixels of the view show at this depth, 0 for nothing."""
        v, u = np.nonzero(depth_mm)
        camera, seen, (x, y, z) = self.camera, self._seen, self._lamp_cam_mm
        depth = depth_mm[v, u].astype(np.float64)
        inverse = 1 / (depth - z)
        right = ((u - camera.cx) * depth - camera.fx * x) * inverse + seen.cx
        down = ((v - camera.cy) * depth - camera.fy * y) * inverse + seen.cy
        texel = tuple(
            np.clip(np.rint(at), 0, size - 1).astype(int) for at, size in ((down, seen.height), (right, seen.width))
        )
        covered = np.zeros(depth_mm.shape, bool)
        covered[v, u] = self._inverse_depth[texel] > inverse
        return covered
