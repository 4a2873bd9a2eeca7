"""Cast shadows: the shadow map against geometry, and a relief under a low sun, shaded by marching rays."""

import cv2
import numpy as np
import pytest

from oneframe.alignment.refinement.refine import refine_pose
from oneframe.camera.pinhole import PinholeCamera
from oneframe.light.directional_light import directional_light
from oneframe.projection.z_buffer import rasterise_depth
from oneframe.surface.mesh import TriangleMesh
from oneframe.transforms import rigid, rotation_from_vector, transform_points
from tests.conftest import grid_mesh

CAMERA = PinholeCamera(180, 135, fx=510.0, fy=508.5, cx=90.75, cy=66.0)
POSE = rigid(rotation_from_vector(np.array([3.0, 0.25, 0.1])), np.array([1.0, -1.0, 300.0]))
SPACING_MM = 1.2


def grid(height: np.ndarray, spacing_mm: float) -> TriangleMesh:
    rows, columns = height.shape
    x, y = np.meshgrid((np.arange(columns) - columns / 2) * spacing_mm, (np.arange(rows) - rows / 2) * spacing_mm)
    return grid_mesh(x, y, height)


def sun(azimuth_deg: float, elevation_deg: float) -> np.ndarray:
    azimuth, elevation = np.radians([azimuth_deg, elevation_deg])
    return np.array([np.cos(azimuth) * np.cos(elevation), np.sin(azimuth) * np.cos(elevation), np.sin(elevation)])


@pytest.mark.parametrize("elevation_deg", [15.0, 60.0])
def test_a_wall_casts_a_shadow_of_the_length_that_geometry_says(elevation_deg):
    """On a plane, 8 mm high, the light from +x: up to 8 mm / tan(elevation) on the other side of it."""
    height = np.zeros((61, 161))
    height[10:50, 80] = 8.0
    mesh = grid(height, 0.5)
    lit = directional_light(mesh, sun(0.0, elevation_deg)).lit
    middle = mesh.vertices[mesh.faces].mean(axis=1)
    flat = np.abs(mesh.face_normals[:, 2]) > 0.99
    behind_mm = mesh.vertices[80, 0] - middle[:, 0]
    beside = (middle[:, 1] > mesh.vertices[:, 1].min() + 7) & (middle[:, 1] < mesh.vertices[:, 1].min() + 23)
    length_mm = 8.0 / np.tan(np.radians(elevation_deg))
    shadow = flat & beside & (behind_mm > 1.0) & (behind_mm < length_mm - 1.0)
    assert shadow.sum() > 100
    assert lit[shadow].max() == 0
    rest = flat & ~((behind_mm > -1.0) & (behind_mm < length_mm + 1.0))
    assert lit[rest].min() == 1
    assert not directional_light(mesh.moved(np.array([300.0, -20, 5])), sun(0.0, elevation_deg)).lit[shadow].any()


def photograph(height: np.ndarray, mesh: TriangleMesh, towards: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Lambert's law under the sun where a march over the height field does not meet it, and a dim sky; blotches."""
    rows, columns = height.shape
    y, x = np.mgrid[:rows, :columns].astype(np.float32)
    lit = np.ones(height.shape, bool)
    for step in np.arange(1.0, 60.0, 0.5):
        along = (towards[:2] * step / np.linalg.norm(towards[:2])).astype(np.float32)
        ahead = cv2.remap(height.astype(np.float32), x + along[0], y + along[1], cv2.INTER_LINEAR, borderValue=-1e3)
        lit &= ahead < height + step * SPACING_MM * towards[2] / np.linalg.norm(towards[:2]) + 0.2
    blotches = 1 + 0.15 * np.tanh(2 * cv2.GaussianBlur(rng.normal(size=height.shape), (0, 0), 5) * 9)
    shade = blotches * (0.15 + lit * np.clip(mesh.vertex_normals @ towards, 0, None).reshape(height.shape))
    raster = rasterise_depth(mesh, CAMERA, POSE)
    points = CAMERA.rays_cam(CAMERA.pixel_grid()) / np.maximum(raster.inverse_depth, 1e-9)[..., None]
    there = transform_points(np.linalg.inv(POSE), points.reshape(-1, 3)).reshape(points.shape)
    column, row = (
        (there[..., axis] / SPACING_MM + size / 2).astype(np.float32) for axis, size in ((0, columns), (1, rows))
    )
    image = cv2.remap(shade.astype(np.float32), column, row, cv2.INTER_LINEAR)[..., None] * [0.9, 0.8, 0.7]
    return np.clip(image + rng.normal(0, 0.01, image.shape), 0, 1).astype(np.float32)


@pytest.fixture(scope="module")
def relief() -> tuple[np.ndarray, TriangleMesh]:
    rng = np.random.default_rng(0)
    height = np.zeros((125, 150))
    for sigma, rise in ((8.0, 8.0), (3.5, 3.0)):
        smooth = cv2.GaussianBlur(rng.normal(size=height.shape), (0, 0), sigma)
        height += rise * (1 + np.tanh(5 * smooth / smooth.std()))
    return height, grid(height, SPACING_MM)


def off_px(mesh: TriangleMesh, pose: np.ndarray) -> float:
    there, true = (CAMERA.project(transform_points(each, mesh.vertices[::50])) for each in (pose, POSE))
    seen = CAMERA.contains(true)
    return float(np.linalg.norm(there - true, axis=1)[seen].mean())


@pytest.mark.long
def test_cast_shadows_do_not_draw_a_pose_away(relief):
    """Under a low sun: what is accepted is near the truth, and nothing moves away from it by more than it admits."""
    height, mesh = relief
    image = photograph(height, mesh, sun(250.0, 25.0), np.random.default_rng(1))
    valid = np.ones(CAMERA.shape_hw, bool)
    stays = refine_pose(image, valid, CAMERA, mesh, POSE)
    assert off_px(mesh, stays.found) < 0.75
    assert not stays.accepted, stays.message
    assert "shadows of a side light" in stays.message
    moved = rigid(rotation_from_vector(np.radians([0.8, -0.6, 0.5])), np.array([1.5, -1.0, 2.0])) @ POSE
    result = refine_pose(image, valid, CAMERA, mesh, moved)
    assert result.accepted, result.message
    assert off_px(mesh, result.cam_from_model) < min(0.75, result.after.error_px)
