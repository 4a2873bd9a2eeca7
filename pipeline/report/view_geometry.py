"""Where a view was taken from: its angle and its distance, as seen from the middle of the frame's surface."""

from dataclasses import dataclass

import numpy as np

from ..camera.pinhole import PinholeCamera
from ..projection.visible_surface import most_central
from ..projection.z_buffer import inverse_depth_of
from ..surface.mesh import TriangleMesh
from ..transforms import camera_centre, inverse_rigid, transform_points

ALONG = 160
"""Pixels along the width of the picture in which the pivot is looked for."""


def pose_data(cam_from_model: np.ndarray) -> dict[str, object]:
    """A camera for a page: its centre and its rotation, which leads into its frame."""
    return {
        "centre": np.round(camera_centre(cam_from_model), 4).tolist(),
        "rotation": np.round(cam_from_model[:3, :3], 6).ravel().tolist(),
    }


@dataclass(frozen=True)
class SourceFrame:
    """The source frame's camera, and the point that views are described from.

    Attributes
    ----------
    camera
        Its intrinsics.
    cam_from_model
        ``(4, 4)``, mm.
    pivot_model
        ``(3,)`` mm: the surface point in the middle of what the camera sees, as the samplers use it; the origin of the
        model if no surface is known.
    """

    camera: PinholeCamera
    cam_from_model: np.ndarray
    pivot_model: np.ndarray

    @classmethod
    def of(cls, camera: PinholeCamera, cam_from_model: np.ndarray, mesh: TriangleMesh | None) -> "SourceFrame":
        """Find the pivot on a surface (model frame, mm)."""
        pivot = None if mesh is None else _pivot(camera, cam_from_model, mesh)
        return cls(camera, cam_from_model, np.zeros(3) if pivot is None else pivot)

    def data(self) -> dict[str, object]:
        """For a page."""
        return pose_data(self.cam_from_model) | {"pivot": self.pivot_model.tolist()}

    def angle_deg(self, cam_from_model: np.ndarray) -> float:
        """At the pivot, between the directions to the source frame's camera and to another, 0..180."""
        own, other = (
            camera_centre(pose) - self.pivot_model for pose in (self.cam_from_model, np.asarray(cam_from_model))
        )
        across = float(np.linalg.norm(np.cross(own, other)))
        return float(np.degrees(np.arctan2(across, float(own @ other))))

    def distance_of(self, cam_from_model: np.ndarray) -> float:
        """From another camera's centre of projection to the pivot, mm."""
        return float(np.linalg.norm(camera_centre(cam_from_model) - self.pivot_model))


def _pivot(camera: PinholeCamera, cam_from_model: np.ndarray, mesh: TriangleMesh) -> np.ndarray | None:
    coarse = camera.resized(min(ALONG, camera.width), max(1, round(camera.height * min(ALONG / camera.width, 1))))
    inverse_depth = inverse_depth_of(mesh, coarse, cam_from_model)
    rows, columns = np.nonzero(inverse_depth)
    if not len(rows):
        return None
    pixels = np.column_stack([columns, rows]).astype(float)
    nearest = most_central(pixels)
    depth = 1 / inverse_depth[rows[nearest], columns[nearest]]
    point_cam = coarse.rays_cam(pixels[nearest : nearest + 1]) * depth
    return transform_points(inverse_rigid(cam_from_model), point_cam)[0]
