"""Errors of trainings beside each other, and the photographs that a network is trained on."""

from types import SimpleNamespace

import numpy as np
import pytest

from oneframe.images.png import encode_png
from oneframe.transforms import rigid, rotation_from_vector
from scripts.benchmarks.learning.pose_trials import PoseTrial, Training, median_errors
from scripts.benchmarks.learning.training_scenes import TrainingScene

POSE = rigid(rotation_from_vector(np.array([0.4, -0.3, 0.2])), np.array([3.0, -2.0, 200.0]))


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
