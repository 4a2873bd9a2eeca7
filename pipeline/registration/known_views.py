"""Known views: what the aligned frame shows of the surface, seen from any pose."""

from dataclasses import dataclass

import cv2
import numpy as np

from ..camera.pinhole import PinholeCamera
from ..colour.ray_tracer import RayTracer
from ..colour.source_view import SourceView
from ..projection.rays import MeshRays
from ..surface.mesh import TriangleMesh
from ..transforms import inverse_rigid, transform_points


@dataclass(frozen=True)
class KnownView:
    """A view at a known pose.

    Attributes
    ----------
    grey
        ``(H, W)`` uint8.
    depth_mm
        ``(H, W)`` float32, along the optical axis.
    shown
        ``(H, W)`` bool: the pixel shows surface that the aligned frame saw.
    camera, cam_from_model
        Intrinsics, and pose (4x4, mm).
    """

    grey: np.ndarray
    depth_mm: np.ndarray
    shown: np.ndarray
    camera: PinholeCamera
    cam_from_model: np.ndarray

    def lifted(self, pixels: np.ndarray) -> np.ndarray:
        """``(N, 2)`` pixels -> ``(N, 3)`` points of the surface, model frame, mm: at the depth of the nearest pixel."""
        u, v = np.rint(pixels).astype(int).T
        points_cam = self.camera.rays_cam(pixels) * self.depth_mm[v, u][:, None]
        return transform_points(inverse_rigid(self.cam_from_model), points_cam)


class KnownViews:
    """Renders known views of one surface with one camera."""

    def __init__(self, mesh: TriangleMesh, source: SourceView) -> None:
        """Prepare a surface (model frame) that is coloured by its aligned frame."""
        self.source = source
        self._tracer = RayTracer(mesh, source.camera, source, rays=MeshRays(mesh))
        self._latest: KnownView | None = None

    def at(self, cam_from_model: np.ndarray) -> KnownView:
        """The view of a pose (4x4, mm); the latest one is kept, for the next frame begins where this one ends."""
        if self._latest is not None and np.array_equal(self._latest.cam_from_model, cam_from_model):
            return self._latest
        seen = self._tracer.render(cam_from_model)
        self._latest = KnownView(
            grey=grey_codes(seen.rgb),
            depth_mm=seen.depth_mm,
            shown=seen.observed,
            camera=self.source.camera,
            cam_from_model=cam_from_model,
        )
        return self._latest


def grey_codes(image: np.ndarray) -> np.ndarray:
    """``(H, W, 3)`` float32 code values 0..1 or uint8 -> ``(H, W)`` uint8."""
    codes = image if image.dtype == np.uint8 else np.rint(255 * np.clip(image, 0, 1)).astype(np.uint8)
    return cv2.cvtColor(codes, cv2.COLOR_RGB2GRAY)
