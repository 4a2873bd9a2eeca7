"""A network learns where a picture shows which point of a surface, and PnP turns that into its pose."""

from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from oneframe.camera.pinhole import PinholeCamera
from oneframe.images.png import encode_png
from oneframe.transforms import rigid, rotation_angle_deg, rotation_from_vector, transform_points
from scripts.benchmarks.learning.pose_trials import PoseTrial, Training, median_errors, pose_of
from scripts.benchmarks.learning.training_scenes import TrainingScene
from scripts.benchmarks.learning.view_crops import FULL, NOTHING, ViewCrops

CAMERA = PinholeCamera(128, 96, 150.0, 150.0, 63.5, 47.5)
POSE = rigid(rotation_from_vector(np.array([0.4, -0.3, 0.2])), np.array([3.0, -2.0, 200.0]))


def test_a_network_learns_points_and_finds_the_pose_of_what_it_trained_on():
    network_room = pytest.importorskip("scripts.benchmarks.learning.coordinate_network", exc_type=ImportError)
    views = textured_plane(np.random.default_rng(0))
    network = network_room.trained_network(views, 120, 0, lambda: None)
    seen = network_room.predicted(network, views.rgba[0, ..., :3])
    points = seen[:, 2:5] * views.reach_mm
    pose = pose_of(points, seen[:, :2], seen[:, 5] * views.reach_mm, CAMERA)
    assert rotation_angle_deg(pose[:3, :3] @ POSE[:3, :3].T) < 10


def test_a_pose_stands_against_wrong_points_that_claim_to_be_sure():
    rng = np.random.default_rng(0)
    points = rng.uniform(-40, 40, (200, 3))
    pixels = CAMERA.project(transform_points(POSE, points)) + rng.normal(0, 0.3, (200, 2))
    points[:60] = rng.uniform(-40, 40, (60, 3))
    pose = pose_of(points, pixels, np.full(200, 1.0), CAMERA)
    assert rotation_angle_deg(pose[:3, :3] @ POSE[:3, :3].T) < 0.5
    assert pose_of(points[:5], pixels[:5], np.ones(5), CAMERA) is None


def test_errors_beside_another_training_are_paired_by_photograph():
    rng = np.random.default_rng(0)
    few, many = (Training("scene", name, 10, 20, 0) for name in ("views", "photographs"))
    hard, seeds = np.exp(rng.normal(0, 2, 9)), np.exp(rng.normal(0, 0.1, 3))

    def trials(training: Training, times: float, seeds: np.ndarray) -> list[PoseTrial]:
        return [
            PoseTrial(*training._replace(seed=seed), 1.0, f"{number}.png", 1.0, 1.0, times * of_seed * error)
            for seed, of_seed in enumerate(seeds)
            for number, error in enumerate(hard)
        ]

    alike = [*trials(few, 3.0, np.ones(1)), *trials(many, 1.0, np.ones(1))]
    assert median_errors(alike, few, "px", many) == pytest.approx((3.0, 3.0, 3.0))
    middle, low, high = median_errors(alike, few, "px")
    assert middle == pytest.approx(3 * np.median(hard))
    assert high > 2 * low
    several = [*trials(few, 3.0, seeds), *trials(many, 1.0, seeds)]
    middle, low, high = median_errors(several, few, "px", many)
    assert middle == pytest.approx(3.0)
    assert 2 < low < middle < high < 4


def test_photographs_are_taken_once_at_the_poses_of_the_views(tmp_path, write_tiny_case):
    shots, mesh_from_model = [], rigid(translation=np.array([1.0, 2.0, 3.0]))

    def photographer(camera, missing, *, samples):
        for cam_from_mesh, path in missing:
            shots.append((cam_from_mesh, path.name))
            path.write_bytes(encode_png(np.full((*camera.shape_hw, 3), len(shots), np.uint8)))
            yield path

    views = SimpleViews(SimpleNamespace(index=place, cam_from_model=POSE) for place in range(3))
    case = write_tiny_case(tmp_path / "case")
    scene = TrainingScene("tiny", case, tmp_path / "none.json", tmp_path / "data", photographer=photographer)
    for count in (2, 3):
        rgb = scene.photographed(views[:count], mesh_from_model)
    assert [name for _, name in shots] == ["000000.png", "000001.png", "000002.png"]
    np.testing.assert_allclose(shots[2][0] @ mesh_from_model, POSE, atol=1e-12)
    assert [rgb(view).max() for view in views] == [1, 2, 3]


class SimpleViews(list):
    size_wh = 32, 24

    def __getitem__(self, places):
        return SimpleViews(super().__getitem__(places))


def textured_plane(rng: np.random.Generator) -> ViewCrops:
    """One view of a square of coarse patches, as :meth:`.ViewCrops.of` reads it."""
    v, u = np.mgrid[: CAMERA.height, : CAMERA.width]
    rays = CAMERA.rays_cam(np.stack([u, v], axis=-1).astype(float))
    normal = POSE[:3, 2]
    points_cam = rays * ((normal @ POSE[:3, 3]) / (rays @ normal))[..., None]
    points = transform_points(np.linalg.inv(POSE), points_cam.reshape(-1, 3)).reshape(points_cam.shape)
    seen = np.abs(points).max(axis=-1) < 60
    texture = cv2.resize(rng.integers(0, 255, (12, 12, 3)).astype(np.uint8), (121, 121))
    rgb = cv2.remap(texture, *np.float32(points[..., :2] + 60).transpose(2, 0, 1), cv2.INTER_LINEAR)
    codes = np.where(seen[..., None], np.rint(points * FULL / 60), NOTHING).astype(np.int16)
    rgba = np.where(seen[..., None], np.dstack([rgb, np.full(seen.shape, 255, np.uint8)]), 0).astype(np.uint8)
    return ViewCrops(rgba[None], codes[None], np.array([[63.5, 47.5]]), np.zeros(3), 60.0)
