"""Trials with known truth: properties that hold for any solver."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from oneframe.transforms import rigid, rotation_from_vector
from scripts.benchmarks.alignment.landmark_accuracy import (
    accuracy,
    outlier_rejection,
)
from scripts.benchmarks.alignment.landmark_trials import (
    MICROSCOPE,
    PEERS,
    PoseErrors,
    box_trial,
    pose_error,
    run_trials,
    surface_trial,
)


@settings(max_examples=12)
@given(seed=st.integers(0, 2**32), count=st.integers(6, 12))
def test_exact_clicks_give_the_true_pose(seed, count):
    """Ours and SQPnP; EPnP gets whole pixels, which are not exact."""
    rng = np.random.default_rng(seed)
    ours, peers = run_trials(lambda: box_trial(rng, count, 0.0), 2)
    for errors in (ours, peers["SQPnP + LM"]):
        assert errors.rotation_deg == pytest.approx(np.zeros(2), abs=1e-4)
        assert errors.mesh_px == pytest.approx(np.zeros(2), abs=1e-3)


@given(seed=st.integers(0, 2**32), angle_deg=st.floats(0.01, 179), shift_px=st.floats(-200, 200))
def test_the_error_is_the_rotation_and_the_shift_in_the_image(seed, angle_deg, shift_px):
    """A turn by any angle is found again; of a flat surface parallel to the image, shifts move every point alike."""
    rng = np.random.default_rng(seed)
    trial = box_trial(rng, 5, 0.0)
    axis = rng.normal(size=3)
    turned = rigid(rotation_from_vector(np.radians(angle_deg) * axis / np.linalg.norm(axis))) @ trial.cam_from_model
    assert pose_error(trial, MICROSCOPE, turned)[0] == pytest.approx(angle_deg, abs=1e-6)
    flat = surface_trial(
        rng,
        4,
        0.0,
        camera=MICROSCOPE,
        cam_from_model=rigid(translation=np.array([0, 0, 300.0])),
        visible_points=np.concatenate([rng.uniform(-9, 9, (30, 2)), np.zeros((30, 1))], axis=1),
    )
    moved = rigid(translation=np.array([shift_px * 300 / MICROSCOPE.fx, 0, 0])) @ flat.cam_from_model
    assert pose_error(flat, MICROSCOPE, moved) == pytest.approx((0, abs(shift_px)), abs=1e-6)


@given(st.lists(st.tuples(st.floats(0, 100), st.booleans()), min_size=1, max_size=40))
def test_a_refused_trial_counts_in_all_only(rows):
    values = np.array([value for value, _ in rows])
    refusals = tuple(None if accepted else "coplanar" for _, accepted in rows)
    errors = PoseErrors(values, values, refusals, tuple(None if kind else True for kind in refusals))
    kept = values[[accepted for _, accepted in rows]]
    for accepted, chosen in ((False, values), (True, kept)):
        median, most = errors.quantiles(errors.mesh_px, accepted=accepted)
        if len(chosen) == 0:
            assert (median, most) == (np.inf, np.inf)
        else:
            assert chosen.min() <= median <= most <= chosen.max()
    assert errors.coverage == 1 if len(kept) else np.isnan(errors.coverage)


def test_every_trial_has_one_outcome():
    rows = [accuracy(np.random.default_rng(3), box_trial, MICROSCOPE, 30, 4, 4.0) for _ in range(2)]
    assert rows[0] == rows[1]
    assert set(rows[0].peers) == set(PEERS)
    rng = np.random.default_rng(3)
    ours, _ = run_trials(lambda: box_trial(rng, 4, 4.0), 30)
    accepted = sum(refusal is None for refusal in ours.refusals)
    assert accepted + sum(rows[0].refused.values()) == 30
    assert [refusal is None for refusal in ours.refusals] == [covered is not None for covered in ours.covered]
    for pairs, wrong in ((6, 0), (8, 2)):
        rejection = outlier_rejection(np.random.default_rng(5), pairs, wrong, 80.0, 25)
        assert sum(rejection.outcomes.values()) == 25
        assert rejection.outcomes["exact"] > 20
