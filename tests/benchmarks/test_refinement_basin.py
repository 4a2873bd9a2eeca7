"""Disturbed poses, trials and their counts; the refinement itself is tested with the alignment."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from oneframe.camera.pinhole import PinholeCamera
from oneframe.transforms import inverse_rigid, rotation_angle_deg, transform_points
from scripts.benchmarks.alignment.refinement_basin import (
    RIGHT_IMAGE,
    WRONG_IMAGES,
    Disturbance,
    RefinementTrial,
    Tally,
    displacement_px,
    disturbances,
    disturbed_pose,
    summary,
)
from scripts.benchmarks.alignment.refinement_scenes import (
    RefinementScene,
    visible_points,
)

CAMERA = PinholeCamera(160, 120, 800.0, 790.0, 82.0, 58.0)


@pytest.fixture
def scene(bumpy_mesh, oblique_pose) -> RefinementScene:
    """Without anything in the image: the refinement refuses at once, and leaves the pose where it is."""
    points = visible_points(bumpy_mesh, CAMERA, oblique_pose)
    image, valid = np.full((*CAMERA.shape_hw, 3), 0.5, np.float32), np.ones(CAMERA.shape_hw, bool)
    return RefinementScene("hills", image, valid, CAMERA, bumpy_mesh, None, oblique_pose, points, 2.0, 1.0)


@pytest.mark.parametrize(("angle_deg", "shift_mm"), [(0, 0), (5, 0), (0, 24), (10, 15)])
def test_a_disturbance_has_the_size_that_it_says(scene, rng, angle_deg, shift_mm):
    """The middle of the visible surface moves by the shift, and the rotation by the angle."""
    pose = disturbed_pose(scene, angle_deg, shift_mm, rng)
    change = pose @ inverse_rigid(scene.cam_from_model)
    assert rotation_angle_deg(change[:3, :3]) == pytest.approx(angle_deg, abs=1e-9)
    moved = transform_points(change, scene.middle_cam) - scene.middle_cam
    assert np.linalg.norm(moved) == pytest.approx(shift_mm, abs=1e-9)
    assert (displacement_px(scene, pose) > 1e-9) == (angle_deg + shift_mm > 0)


@given(st.lists(st.integers(1, 9), min_size=1, max_size=3, unique=True), st.integers(0, 4), st.integers(0, 4))
def test_the_plan_holds_every_cell_as_often_as_asked(sizes, trials, wrong):
    planned = disturbances(sizes, sizes, trials, wrong)
    for angle in sizes:
        for percent in sizes:
            assert planned.count(Disturbance(RIGHT_IMAGE, angle, percent)) == trials
    assert [sum(each.image == name for each in planned) for name in WRONG_IMAGES] == [wrong] * len(WRONG_IMAGES)
    assert len(planned) == trials * len(sizes) ** 2 + wrong * len(WRONG_IMAGES)


TRIAL = RefinementTrial("hills", RIGHT_IMAGE, 5, 5, 8.0, 0.1, 2.0, True, True, 0.1, 0.5, 0.2, 0.1, 16.0, 1.0, 1.0, "")
verdicts = st.tuples(st.sampled_from([RIGHT_IMAGE, *WRONG_IMAGES]), st.booleans(), st.booleans())


@given(st.lists(verdicts, min_size=1, max_size=30))
def test_counts_add_up(found):
    trials = [replace(TRIAL, image=image, right=right, accepted=accepted) for image, right, accepted in found]
    tally = Tally.of(trials)
    assert tally.trials + tally.wrong_images == len(trials)
    # inclusion and exclusion: what is neither right nor accepted is left
    neither = sum(not t.right and not t.accepted for t in trials if t.image == RIGHT_IMAGE)
    assert tally.right + tally.accepted - tally.right_and_accepted + neither == tally.trials
    assert tally.wrong_images_accepted <= tally.wrong_images
    assert any("wrong images accepted" in line for line in summary(trials)) == (tally.wrong_images > 0)


def test_estimates_are_compared_with_the_truth():
    """Of a trial that states twice, and half of, the true error."""
    lines = [line for line in summary([TRIAL]) if line.startswith("estimated / true")]
    assert "2.00 / 2.00 / 2.00" in lines[0]
    assert "0.50 / 0.50 / 0.50" in lines[1]
