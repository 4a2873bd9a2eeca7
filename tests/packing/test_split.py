"""Splits: parts are disjoint and a gap apart, and ``--split`` packs each with its own targets."""

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from oneframe.camera.pinhole import PinholeCamera
from oneframe.commands.__main__ import dispatch
from oneframe.errors import InputError
from oneframe.packing.manifest import read_manifest
from oneframe.packing.pack import verify_pack
from oneframe.packing.split import PARTS, Split, split_of_views
from oneframe.poses.distributions import Cone, Gaussian, ReferencePose, Shell, Trajectory
from oneframe.transforms import rigid, transform_points

REFERENCE = ReferencePose(rigid(np.diag([1.0, -1.0, -1.0]), [0.0, 0.0, 300.0]), np.array([0.0, 0.0, 3.0]))
CAMERA = PinholeCamera(640, 480, 2000.0, 1990.0, 310.5, 235.0)
CORNERS = np.array([[x, y, z] for x in (-30.0, 30) for y in (-25.0, 25) for z in (-8.0, 8)])
NEAR = {"distance_min": 0.9, "distance_max": 1.1, "roll_deg": 15.0}
SAMPLERS = {
    "cone": Cone(reference=REFERENCE, cone_deg=20.0, shift_mm=2.0, **NEAR),
    "gaussian": Gaussian(reference=REFERENCE, sigma_deg=5.0, sigma_mm=3.0),
    "shell": Shell(reference=REFERENCE, polar_deg=60.0, **NEAR),
    "trajectory": Trajectory(reference=REFERENCE, cone_deg=20.0, **NEAR),
}


def drawn(sampler: str, count: int, seed: int) -> np.ndarray:
    distribution = SAMPLERS[sampler]
    if isinstance(distribution, Trajectory):
        return distribution.poses(count)
    return np.stack([distribution.draw(np.random.default_rng([seed, index])) for index in range(count)])


def displacements_px(ones: np.ndarray, others: np.ndarray) -> np.ndarray:
    """RMS displacement of the corners between poses, ``(N, M)``, from its definition."""
    a, b = (np.stack([CAMERA.project(transform_points(pose, CORNERS)) for pose in some]) for some in (ones, others))
    return np.sqrt(((a[:, None] - b[None]) ** 2).sum(axis=-1).mean(axis=-1))


def parts(split: Split) -> list[tuple[int, ...]]:
    return [split.part(name) for name in PARTS]


cases = st.fixed_dictionaries(
    {
        "sampler": st.sampled_from(sorted(SAMPLERS)),
        "count": st.integers(40, 200),
        "seed": st.integers(0, 1000),
        "gap_px": st.floats(0, 12),
    }
)


@given(cases)
def test_parts_are_a_gap_apart(case):
    poses = drawn(case["sampler"], case["count"], case["seed"])
    gap = case["gap_px"]
    try:
        split = split_of_views(poses, CORNERS, CAMERA, gap_px=gap)
    except InputError:
        assume(False)
    every = [*split.train, *split.val, *split.test, *split.none]
    assert sorted(every) == list(range(len(poses)))
    for part in (*parts(split), split.none):
        assert list(part) == sorted(part)
    # fractions: test to a whole number; the others have lost what is too near, and only that
    assert len(split.test) == round(len(poses) / 10)
    assert len(split.val) <= round(len(poses) / 10)
    if gap == 0:
        assert not split.none
        assert len(split.val) == round(len(poses) / 10)
    # the nearest pair of two parts, by brute force
    apart = displacements_px(poses, poses)
    train, val, test, none = (np.array(part, int) for part in (*parts(split), split.none))
    nearest = min(apart[np.ix_(one, other)].min() for one, other in ((train, val), (train, test), (val, test)))
    assert nearest >= gap - 0.01
    # no view is left out without need
    if len(none):
        assert apart[np.ix_(none, np.concatenate([val, test]))].min(axis=1).max() < gap + 0.01


@pytest.mark.parametrize("sampler", ["cone", "gaussian", "shell"])
def test_val_and_test_are_spread_over_all_views(sampler):
    """Not a corner of the space of poses: the middle and the spread of distances and tilts are like those of all."""
    poses = drawn(sampler, 1000, 1)
    split = split_of_views(poses, CORNERS, CAMERA)
    for values in (poses[:, 2, 3], np.degrees(np.arccos(np.clip(-poses[:, 2, 2], -1, 1)))):
        for part in parts(split):
            chosen = values[list(part)]
            assert abs(np.mean(chosen) - values.mean()) < 1.3 * values.std()
            assert chosen.std() > 0.25 * values.std()


@pytest.mark.parametrize(
    ("count", "gap_px", "message"),
    [(50, 1e6, "leaves no view in train"), (50, -1.0, "at least 0 px"), (3, None, "too few")],
)
def test_what_cannot_be_split(count, gap_px, message):
    with pytest.raises(InputError, match=message):
        split_of_views(drawn("cone", count, 0), CORNERS, CAMERA, gap_px=gap_px)


VIEWS = 60


@pytest.fixture(scope="module")
def rendered(tmp_path_factory, write_tiny_case, run_oneframe) -> Path:
    folder = tmp_path_factory.mktemp("split")
    out = folder / "dataset"
    case = write_tiny_case(folder / "case")
    ended = run_oneframe("render", case, "--out", out, "--count", VIEWS, "--cone-deg", 40, "--workers", 1)
    assert ended.returncode == 0, ended.stderr
    return out


@pytest.mark.render
def test_parts_of_a_dataset(rendered, tmp_path, capfd):
    def packed(*options: object) -> tuple[set[int], str]:
        out = tmp_path / "-".join(map(str, options))
        assert dispatch([str(word) for word in ("pack", rendered, "--out", out, "--split", *options)]) == 0
        assert verify_pack(out) == []
        views = set(read_manifest(out).plan.views)
        targets = json.loads((out / "test_targets_bop19.json").read_text())
        assert {entry["im_id"] for entry in targets} <= views
        about = read_manifest(out).plan.about
        assert about.startswith(f"{options[0]}, of ")
        return views, about

    (train, info), (val, _), (test, _) = (packed(part) for part in ("train", "val", "test"))
    assert len(test) == VIEWS // 10
    assert len(train) + len(val) + len(test) == len(train | val | test)
    none = VIEWS - len(train | val | test)
    sentence = f"{len(train)} train, {len(val)} val, {len(test)} test; {none} in none, nearer than 0.64 px"
    assert sentence in info
    assert f"split: {sentence}" in capfd.readouterr().out
    wider, _ = packed("train", "--split-gap-px", 4)
    assert wider < train
