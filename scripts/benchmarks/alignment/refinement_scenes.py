"""An image with a known pose for trials of the refinement: the frame of a case."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from oneframe.camera.distortion import undistort
from oneframe.camera.pinhole import PinholeCamera
from oneframe.case.case_file import read_case
from oneframe.errors import InputError
from oneframe.projection.z_buffer import rasterise_depth
from oneframe.surface.mesh import TriangleMesh
from oneframe.surface.mesh_reader import read_mesh
from oneframe.transforms import inverse_rigid, rigid, rotation_from_vector, transform_points, turned_about

from ..published import read_codes

VISIBLE_POINTS = 2000
"""Approximate number of points that represent the visible surface."""


@dataclass(frozen=True)
class RefinementScene:
    """An image with its true pose.

    Attributes
    ----------
    image, valid
        ``(H, W, 3)`` float32 RGB 0..1, undistorted; ``(H, W)`` bool, pixels that may be used.
    camera, mesh, cam_from_model
        Intrinsics; the mesh in the model frame, mm; the true pose.
    points
        ``(N, 3)`` mm, visible points of the surface, model frame.
    largest_px, largest_deg
        Largest displacement and rotation error of a refined pose that counts as right; ``None``: any angle.
    """

    name: str
    image: np.ndarray
    valid: np.ndarray
    camera: PinholeCamera
    mesh: TriangleMesh
    cam_from_model: np.ndarray
    points: np.ndarray
    largest_px: float
    largest_deg: float | None

    @property
    def middle_cam(self) -> np.ndarray:
        """``(3,)`` the middle of the visible surface, camera frame, mm."""
        return transform_points(self.cam_from_model, self.points).mean(axis=0)


def case_scene(path: Path) -> RefinementScene:
    """The frame of a case file, with the pose in the file as the true one."""
    case = read_case(path)
    mesh, _ = read_mesh(case.mesh)
    mesh = mesh.scaled(case.mm_per_unit)
    offset = mesh.vertices.mean(axis=0)
    mesh, pose = mesh.moved(-offset), case.cam_from_mesh @ rigid(translation=offset)
    image, valid = _read_image(case.image), np.ones(case.camera.shape_hw, bool)
    if image.shape[:2] != case.camera.shape_hw:
        raise InputError(
            f"{case.image}: expected {case.camera.size_wh} px as in {path.name}, found {image.shape[1::-1]}; "
            "correct the size in the case file, or name the frame that belongs to it"
        )
    if case.distortion is not None:
        image, valid = undistort(image, case.camera, case.distortion)
    points = visible_points(mesh, case.camera, pose)
    return RefinementScene(path.stem, image, valid, case.camera, mesh, pose, points, 2.0, 1.0)


def disturbed_pose(scene: RefinementScene, angle_deg: float, percent: float, rng: np.random.Generator) -> np.ndarray:
    """``(4, 4)`` true pose, rotated about the middle of the visible surface and shifted by a part of its distance.

    Both in random directions.
    """
    shift_mm = percent / 100 * np.linalg.norm(scene.middle_cam)
    axis, direction = (v / np.linalg.norm(v) for v in rng.normal(size=(2, 3)))
    turned = turned_about(scene.middle_cam, rotation_from_vector(np.radians(angle_deg) * axis))
    return rigid(translation=shift_mm * direction) @ turned @ scene.cam_from_model


def displacement_px(scene: RefinementScene, cam_from_model: np.ndarray) -> float:
    """Mean distance in the image between the visible points at a pose and at the true pose, px."""
    found, true = (
        scene.camera.project(transform_points(pose, scene.points)) for pose in (cam_from_model, scene.cam_from_model)
    )
    return float(np.linalg.norm(found - true, axis=1).mean())


def visible_points(mesh: TriangleMesh, camera: PinholeCamera, cam_from_model: np.ndarray) -> np.ndarray:
    """``(N, 3)`` mm, model frame: about :data:`VISIBLE_POINTS` points of the surface that the camera sees."""
    factor = max(camera.width / 320, 1.0)
    small = camera.resized(round(camera.width / factor), round(camera.height / factor))
    raster = rasterise_depth(mesh, small, cam_from_model)
    seen = raster.face >= 0
    points_cam = small.rays_cam(small.pixel_grid())[seen] / raster.inverse_depth[seen][:, None]
    return transform_points(inverse_rigid(cam_from_model), points_cam[:: max(len(points_cam) // VISIBLE_POINTS, 1)])


def _read_image(path: Path) -> np.ndarray:
    return read_codes(path).astype(np.float32) / 255
