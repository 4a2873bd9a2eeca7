"""The refinement on synthetic photographs of a hilly surface, shaded independently of the refinement's features."""

import cv2
import numpy as np
import pytest

from oneframe.alignment.refinement import refine
from oneframe.alignment.refinement.refine import refine_pose
from oneframe.alignment.refinement.verdict import MAX_ROTATION_DEG, judged
from oneframe.camera.pinhole import PinholeCamera
from oneframe.projection.z_buffer import rasterise_depth
from oneframe.surface.mesh import TriangleMesh
from oneframe.transforms import rigid, rotation_angle_deg, rotation_from_vector, transform_points
from tests.conftest import grid_mesh

CAMERA = PinholeCamera(180, 135, fx=976.0, fy=979.0, cx=91.5, cy=66.0)
TRUE_POSE = rigid(rotation_from_vector(np.array([2.9, 0.3, 0.1])), np.array([0.5, -0.3, 300.0]))


def hills(seed: int, height: float = 3.0) -> TriangleMesh:
    """90 x 75 mm of hills and pits of all sizes without any period; demeaned."""
    rng = np.random.default_rng(seed)
    x, y = np.meshgrid(np.linspace(-45, 45, 121), np.linspace(-37, 37, 99))
    z = sum(cv2.GaussianBlur(rng.normal(size=x.shape), (0, 0), s) * height * s**1.5 for s in (2, 4, 8))
    mesh = grid_mesh(x, y, z)
    return mesh.moved(-mesh.vertices.mean(axis=0))


def photograph(mesh: TriangleMesh, seed: int = 0) -> np.ndarray:
    """Lambert's law under a lamp 40 mm from the lens, falling off with distance; blotches of albedo and noise."""
    rng = np.random.default_rng(seed)
    raster = rasterise_depth(mesh, CAMERA, TRUE_POSE)
    points = CAMERA.rays_cam(CAMERA.pixel_grid()) / raster.inverse_depth[..., None]
    normals = (mesh.face_normals @ TRUE_POSE[:3, :3].T)[raster.face]
    to_lamp = np.array([30.0, -25.0, 0.0]) - points
    distance = np.linalg.norm(to_lamp, axis=2)
    shade = np.clip((normals * to_lamp).sum(axis=2) / distance, 0, None) * (300 / distance) ** 2
    blotches = 1 + 0.2 * np.tanh(8 * cv2.GaussianBlur(rng.normal(size=shade.shape), (0, 0), 7))
    colour = np.array([0.85, 0.75, 0.6])
    image = (shade * blotches)[..., None] * colour + rng.normal(0, 0.02, (*shade.shape, 3))
    return np.clip(image, 0, 1).astype(np.float32)


@pytest.fixture(scope="module")
def mesh() -> TriangleMesh:
    return hills(1)


@pytest.fixture(scope="module")
def frame(mesh) -> np.ndarray:
    return photograph(mesh)


VALID = np.ones(CAMERA.shape_hw, bool)


def error(mesh: TriangleMesh, pose: np.ndarray) -> tuple[float, float]:
    """Rotation in degrees and mean distance of the images of the vertices, px."""
    projected = [CAMERA.project(transform_points(p, mesh.vertices)) for p in (TRUE_POSE, pose)]
    return rotation_angle_deg(pose[:3, :3] @ TRUE_POSE[:3, :3].T), float(
        np.linalg.norm(projected[0] - projected[1], axis=1).mean()
    )


def disturbed(rng: np.random.Generator, angle_deg: float, percent: float) -> np.ndarray:
    """The true pose, rotated about the surface's centre and moved by some percent of the distance, at random."""
    axis, direction = (v / np.linalg.norm(v) for v in rng.normal(size=(2, 3)))
    rotated = TRUE_POSE @ rigid(rotation_from_vector(np.radians(angle_deg) * axis))
    return rigid(translation=direction * percent / 100 * TRUE_POSE[2, 3]) @ rotated


@pytest.mark.long
def test_both_sides_of_the_largest_rotation(mesh, frame, monkeypatch):
    asked = []
    monkeypatch.setattr(
        refine, "judged", lambda *given, **named: asked.append((given, named)) or judged(*given, **named)
    )

    def turned(angle_deg: float) -> np.ndarray:
        return TRUE_POSE @ rigid(rotation_from_vector(TRUE_POSE[:3, :3].T @ [np.radians(angle_deg), 0, 0]))

    assert refine_pose(frame, VALID, CAMERA, mesh, turned(MAX_ROTATION_DEG - 0.5)).accepted
    # the same pose, found from farther away
    (_, *given), named = asked[-1]
    found = judged(turned(MAX_ROTATION_DEG + 0.5), *given, **named)
    assert not found.accepted
    assert "at a rotation of" in found.message


def test_converges_from_a_rough_pose(mesh, frame, rng):
    start = disturbed(rng, 5, 5)
    fractions = []
    result = refine_pose(frame, VALID, CAMERA, mesh, start, progress=fractions.append)
    assert result.accepted, result.message
    rotated, moved = error(mesh, result.cam_from_model)
    assert rotated < 0.5
    assert moved < 0.75
    assert result.after.score > result.before.score
    # pixels mean pixels: the errors of both poses, without knowing the truth
    assert result.before.error_px == pytest.approx(error(mesh, start)[1], rel=0.15)
    assert moved / 3 < result.after.error_px < 3
    assert "depth" in result.uncertainty.weakest
    lateral, depth = result.uncertainty.translation_mm[:2].max(), result.uncertainty.translation_mm[2]
    assert lateral < depth / 2
    assert fractions == sorted(fractions)
    assert fractions[0] == 0
    assert fractions[-1] == 1


def test_masked_pixels_have_no_influence(mesh, frame, rng):
    spoilt, valid = frame.copy(), VALID.copy()
    spoilt[:, 60:83] = rng.random((135, 23, 3), np.float32)
    valid[:, 60:83] = False
    result = refine_pose(spoilt, valid, CAMERA, mesh, disturbed(rng, 2, 2))
    assert result.accepted, result.message
    assert error(mesh, result.cam_from_model)[1] < 0.75


@pytest.mark.parametrize("kind", ["flat", "other surface", "nothing valid"])
def test_a_wrong_image_is_refused(mesh, frame, rng, kind):
    image, valid = frame, VALID
    if kind == "flat":
        image = np.full_like(frame, 0.5)
    elif kind == "other surface":
        image = photograph(hills(2))
    else:
        valid = np.zeros_like(VALID)
    start = disturbed(rng, 2, 2)
    result = refine_pose(image, valid, CAMERA, mesh, start)
    assert not result.accepted, result.message
    assert not result.verified
    # not trusted: then nothing is said about the start, and less than the truth about the pose that was found
    assert result.objection in result.message
    assert np.isnan(result.before.error_px)
    assert result.can_be_taken == (kind == "other surface")
    np.testing.assert_allclose(result.cam_from_model, start, atol=1e-12)


@pytest.mark.parametrize("wide", [480, 1920])
@pytest.mark.parametrize(("across_px", "enough"), [(22.0, True), (13.0, False)])
def test_enough_surface_is_enough_in_an_image_of_any_size(mesh, wide, across_px, enough):
    """480 px of it are enough in any image, 170 are in none; the image itself shows nothing."""
    across_mm = float(np.sqrt(np.prod(np.ptp(mesh.vertices, axis=0)[:2])))
    focal = across_px / across_mm * 300
    camera = PinholeCamera(wide, wide * 3 // 4, focal, focal, wide / 2, wide * 3 / 8)
    image = np.full((*camera.shape_hw, 1), 0.5, np.float32)
    result = refine_pose(image, np.ones(camera.shape_hw, bool), camera, mesh, TRUE_POSE)
    assert ("no detail" in result.message) == enough
    assert ("almost no surface" in result.message) != enough
