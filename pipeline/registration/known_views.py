"""Known views: what the aligned frame shows of the surface, seen from any pose."""

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np

from ..camera.pinhole import PinholeCamera
from ..colour.ray_tracer import RayTracer
from ..colour.shading import ColouredSurface
from ..colour.source_view import SourceView
from ..surface.mesh import TriangleMesh
from ..transforms import inverse_rigid, rotation_angle_deg, transform_points
from .light import without_light

NEAR_TILT_DEG, NEAR_ROLL_DEG, NEAR_SHARE, NEAR_WIDTHS = 8.0, 20.0, 0.06, 0.1
"""How far a pose may be from a view that stands for its own: tilt, rotation, share of the distance, and shift in the
image, relative to its width."""

STEP_PX = 4
"""Between the pixels whose flow is used."""

LEAST_TEXTURE = 6.0
"""Standard deviation in code values around a pixel without which its flow says nothing."""


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

    @cached_property
    def detail(self) -> np.ndarray:
        """``(H, W)`` uint8: the view without its light."""
        return without_light(self.grey, self.shown)

    @cached_property
    def textured(self) -> np.ndarray:
        """``(N, 2)`` pixels well inside of what is shown whose flow says something."""
        detail = self.detail.astype(np.float32)
        mean, square = (cv2.GaussianBlur(each, (0, 0), 3.0) for each in (detail, detail**2))
        texture = np.sqrt(np.maximum(square - mean**2, 0))
        inside = cv2.erode(self.shown.astype(np.uint8), np.ones((9, 9), np.uint8)) > 0
        v, u = np.nonzero((inside & (texture > LEAST_TEXTURE))[STEP_PX // 2 :: STEP_PX, STEP_PX // 2 :: STEP_PX])
        return STEP_PX // 2 + STEP_PX * np.stack([u, v], axis=1)

    @cached_property
    def points(self) -> np.ndarray:
        """``(N, 3)`` points of the surface at :attr:`textured`, model frame, mm."""
        return self.lifted(self.textured)

    def placed(self, cam_from_model: np.ndarray) -> np.ndarray:
        """``(H, W, 2)`` float32: where another pose shows what each pixel shows; background at the mean depth."""
        other_from_cam, k = cam_from_model @ inverse_rigid(self.cam_from_model), self.camera.k
        turn, shift = k @ other_from_cam[:3, :3] @ np.linalg.inv(k), k @ other_from_cam[:3, 3]
        u = np.arange(self.camera.width, dtype=np.float32)
        v = np.arange(self.camera.height, dtype=np.float32)[:, None]
        x, y, z = (
            np.float32(a) * u + (np.float32(b) * v + np.float32(c)) + np.float32(d) * self._nearness
            for (a, b, c), d in zip(turn, shift, strict=True)
        )
        return np.dstack([x / z, y / z])

    def stands_for(self, cam_from_model: np.ndarray) -> bool:
        """Whether another pose is so near that the view is almost the one from there."""
        if not self.shown.any():
            return False
        other_from_cam = cam_from_model @ inverse_rigid(self.cam_from_model)
        middle = np.stack([self._middle_cam, transform_points(other_from_cam, self._middle_cam)])
        before_px, after_px = self.camera.project(middle)
        return bool(
            other_from_cam[2, 2] > np.cos(np.radians(NEAR_TILT_DEG))
            and rotation_angle_deg(other_from_cam[:3, :3]) < NEAR_ROLL_DEG
            and abs(middle[1, 2] / middle[0, 2] - 1) < NEAR_SHARE
            and np.linalg.norm(after_px - before_px) < NEAR_WIDTHS * self.camera.width
        )

    @cached_property
    def _nearness(self) -> np.ndarray:
        nearness = np.divide(1.0, self.depth_mm, out=np.zeros_like(self.depth_mm), where=self.depth_mm > 0)
        return np.where(nearness > 0, nearness, nearness[self.shown].mean())

    @cached_property
    def _middle_cam(self) -> np.ndarray:
        v, u = np.nonzero(self.shown)
        ray = self.camera.rays_cam(np.array([[u.mean(), v.mean()]]))[0]
        return ray * float(np.median(self.depth_mm[self.shown]))

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
        self._tracer = RayTracer(ColouredSurface(mesh, (source,)), source.camera)
        self._latest: KnownView | None = None

    def near(self, cam_from_model: np.ndarray) -> KnownView:
        """A view that is not far from a pose (4x4, mm): the latest one if it may stand for the pose's own."""
        view = self._latest
        if view is None or not view.stands_for(cam_from_model):
            view = self._latest = self.at(cam_from_model)
        return view

    def at(self, cam_from_model: np.ndarray) -> KnownView:
        """The view of a pose (4x4, mm)."""
        seen = self._tracer.render(cam_from_model)
        return KnownView(
            grey=grey_codes(seen.rgb),
            depth_mm=seen.depth_mm,
            shown=seen.observed,
            camera=self.source.camera,
            cam_from_model=cam_from_model,
        )


def grey_codes(image: np.ndarray) -> np.ndarray:
    """``(H, W, 3)`` float32 code values 0..1 or uint8 -> ``(H, W)`` uint8."""
    codes = image if image.dtype == np.uint8 else np.rint(255 * np.clip(image, 0, 1)).astype(np.uint8)
    return cv2.cvtColor(codes, cv2.COLOR_RGB2GRAY)
