"""The reference view, and its visibility rule, which all colour modes share: which surface points the frame saw.

The frame saw a surface point X of a face if all of these hold, with z the depth of X and (u, v) its pixel:

* X is in front of the camera and (u, v) lies inside the grid of pixel centres;
* the face's front side faces the camera, with an angle of at most :data:`MAX_INCIDENCE_DEG` between ray and normal;
* z * w(u, v) = 1 within :data:`TOLERANCE_PX` / f, where w is the *inverse* depth map of the surface seen from the
  frame, interpolated bilinearly: with the same four pixels and weights as the colour.

Notes
-----
Inverse depth is affine in (u, v) on a plane, so the interpolation is exact inside a face, and only creases need the
tolerance. It amounts to :data:`TOLERANCE_PX` pixel footprints (z / f each) of depth, enough for a crease of 80° inside
a pixel. As the test uses the pixels of the colour lookup, it also rejects points whose colour would mix in another
surface: a pixel of weight a from a surface that is deeper or nearer by the relative step s passes only if a s is below
the tolerance. Frame pixels without surface (background, transparent) have w = 0, so every lookup that uses one fails.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..camera.pinhole import PinholeCamera
from ..images.pixel_values import sample_bilinear
from ..surface.mesh import TriangleMesh
from ..transforms import BLOCK, camera_centre, transform_points

TOLERANCE_PX = 1.5
"""Depth tolerance in pixel footprints: a wrongly accepted point is displaced by less than about one pixel."""

MAX_INCIDENCE_DEG = 87.0
"""Largest angle between ray and normal: beyond it the frame's pixels are stretched more than 19 times."""


@dataclass(frozen=True)
class SourceView:
    """The reference view: the aligned frame as the source of colour, with the inverse depth of the surface.

    Attributes
    ----------
    camera, cam_from_model
        Intrinsics and pose of the frame.
    image
        ``(H, W, 3)`` float32 code values, scaled to 0..1 and not linearised.
    inverse_depth
        ``(H, W)`` float32, 1/mm at the pixel centres; 0 where the frame shows no surface or is masked out.
    """

    camera: PinholeCamera
    cam_from_model: np.ndarray
    image: np.ndarray
    inverse_depth: np.ndarray

    @cached_property
    def depth_mm(self) -> np.ndarray:
        """``(H, W)`` float32 depth along the optical axis at the pixel centres, mm; 0 where ``inverse_depth`` is."""
        return np.divide(1.0, self.inverse_depth, out=np.zeros_like(self.inverse_depth), where=self.inverse_depth > 0)

    @property
    def depth_tolerance(self) -> float:
        """Relative depth tolerance."""
        return TOLERANCE_PX / min(self.camera.fx, self.camera.fy)

    def project(self, points_model: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """``(N, 3)`` model points -> ``(N, 2)`` pixels (NaN behind the camera) and ``(N,)`` depth in mm."""
        points_cam = transform_points(self.cam_from_model, points_model)
        return self.camera.project(points_cam), points_cam[:, 2]

    def unoccluded(self, points_model: np.ndarray) -> np.ndarray:
        """``(N, 3)`` surface points -> ``(N,)`` bool: inside the frame and not occluded; orientation is not tested."""
        pixels, z = self.project(points_model)
        surface = sample_bilinear(self.inverse_depth, pixels)
        with np.errstate(invalid="ignore"):
            return np.abs(z * surface - 1) <= self.depth_tolerance

    def observed(self, points_model: np.ndarray, normals_model: np.ndarray) -> np.ndarray:
        """``(N, 3)`` surface points and their unit face normals -> ``(N,)`` bool: the frame saw them."""
        seen = np.empty(len(points_model), dtype=bool)
        for start in range(0, len(points_model), BLOCK):
            points, normals = points_model[start : start + BLOCK], normals_model[start : start + BLOCK]
            facing = self.facing(points, normals)
            facing[facing] = self.unoccluded(points[facing])
            seen[start : start + BLOCK] = facing
        return seen

    def facing(self, points_model: np.ndarray, normals_model: np.ndarray) -> np.ndarray:
        """``(N, 3)`` points and unit normals -> ``(N,)`` bool: the front side faces the frame's camera."""
        # column by column: numpy is slow at reductions along an axis of three
        x, y, z = (
            centre - column for centre, column in zip(camera_centre(self.cam_from_model), points_model.T, strict=True)
        )
        nx, ny, nz = normals_model.T
        cosine = x * nx + y * ny + z * nz
        return cosine >= np.cos(np.radians(MAX_INCIDENCE_DEG)) * np.sqrt(x * x + y * y + z * z)

    def facing_faces(self, mesh: TriangleMesh) -> np.ndarray:
        """``(F,)`` bool: faces whose front side faces the frame's camera."""
        return self.facing(mesh.face_centres, mesh.face_normals)
