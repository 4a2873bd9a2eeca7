"""Poses proposed from the frame alone: a shaded surface is found, and the search can be stopped."""

import numpy as np
import pytest

from oneframe.alignment.proposal import propose, template_search
from oneframe.camera.pinhole import PinholeCamera
from oneframe.projection.z_buffer import rasterise_depth
from oneframe.surface.mesh import TriangleMesh
from oneframe.transforms import rigid, rotation_angle_deg, rotation_from_vector

CAMERA = PinholeCamera(160, 120, 800.0, 800.0, 79.5, 59.5)
POSE = rigid(rotation_from_vector(np.array([0.6, -1.1, 2.0])), np.array([6.0, -4.0, 800.0]))


def lumpy_ball() -> TriangleMesh:
    """A long and flat closed surface with a different relief on every side."""
    u, v = np.meshgrid(np.linspace(0, 2 * np.pi, 80, endpoint=False), np.linspace(0.02, np.pi - 0.02, 50))
    ray = np.stack([np.sin(v) * np.cos(u), np.sin(v) * np.sin(u), np.cos(v)], axis=-1).reshape(-1, 3)
    rng = np.random.default_rng(4)
    radius = 50 + 2 * np.sin(rng.normal(0, 5, (12, 3)) @ ray.T + rng.uniform(0, 6, (12, 1))).sum(axis=0)
    i, j = np.mgrid[0:49, 0:80]
    a, b, c, d = (((i + k) * 80 + (j + m) % 80).ravel() for k, m in ((0, 0), (0, 1), (1, 0), (1, 1)))
    return TriangleMesh(
        ray * radius[:, None] * (1.0, 0.75, 0.55), np.concatenate([np.stack([a, c, b], 1), np.stack([b, c, d], 1)])
    )


@pytest.fixture(scope="module")
def shaded() -> tuple[TriangleMesh, np.ndarray]:
    """The surface, and its frame under a light beside the lens, before a dark ground, with noise."""
    mesh = lumpy_ball()
    face = rasterise_depth(mesh, CAMERA, POSE).face
    normal = mesh.face_cross @ POSE[:3, :3].T
    cosine = np.abs(normal[:, 2]) / np.linalg.norm(normal, axis=1)
    grey = np.where(face >= 0, 0.8 * cosine[face], 0.1) + np.random.default_rng(1).normal(0, 0.02, face.shape)
    return mesh, np.repeat(grey[..., None], 3, axis=2).astype(np.float32)


def test_a_shaded_surface_is_found_without_a_rough_pose(shaded, monkeypatch):
    mesh, image = shaded
    # sizes and candidates enough for this surface
    monkeypatch.setattr(template_search, "SPANS", (0.78, 0.97))
    monkeypatch.setattr(propose, "REFINED", (30, 4))
    seen: list[float] = []
    found = propose.propose_poses(image, np.ones(CAMERA.shape_hw, bool), CAMERA, mesh, progress=seen.append)
    best = found[0].cam_from_model
    assert rotation_angle_deg(best[:3, :3] @ POSE[:3, :3].T) < 5
    assert np.linalg.norm(best[:3, 3]) == pytest.approx(np.linalg.norm(POSE[:3, 3]), rel=0.05)
    assert [each.score for each in found] == sorted((each.score for each in found), reverse=True)
    assert seen == sorted(seen)
    assert seen[-1] == 1


def test_the_search_ends_at_an_exception_of_its_progress(shaded):
    mesh, image = shaded

    def stop(fraction: float) -> None:
        if fraction > 0:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        propose.propose_poses(image, np.ones(CAMERA.shape_hw, bool), CAMERA, mesh, progress=stop)
