"""Trials of the registration: how they are counted, and the documented tables."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from oneframe.registration.verdict import ACCEPTED, REFUSED
from scripts.benchmarks.alignment.registration_trials import RegistrationTrial, share
from scripts.benchmarks.figures import read_rows
from scripts.benchmarks.sweeps.degradations import DEGRADATIONS
from scripts.benchmarks.sweeps.registration import rough

IMG = Path(__file__).resolve().parents[2] / "docs" / "img"
TRIAL = RegistrationTrial("grid", "a", True, "0", "1", "clean", 0.0, 9.0, ACCEPTED, 0.99, 0.1, 0.1, 0.1, 0.1)


@pytest.mark.parametrize("name", DEGRADATIONS)
def test_frames_get_worse_with_the_amount(name, rng):
    how, image = DEGRADATIONS[name], cv2.GaussianBlur(rng.random((120, 160, 3)).astype(np.float32), (0, 0), 2)
    changes = [np.abs(how.spoil(image, each, np.random.default_rng(1)) - image).mean() for each in how.amounts]
    clean = how.amounts.index(how.clean)
    assert changes[clean] < 0.02
    assert np.all(np.diff(changes[clean:]) > 0)
    assert np.all(np.diff(changes[: clean + 1]) < 0)


def test_trials_of_one_source_go_together():
    trials = [replace(TRIAL, source=str(number), error_px=9.0 * (number % 2)) for number in range(20)]
    middle, low, high = share(trials, lambda trial: trial.found)
    assert (middle, sum(trial.wrong for trial in trials)) == (0.5, 10)
    assert 0.2 < low < 0.4 < 0.6 < high < 0.8
    # ten times the same says nothing new
    assert share(trials * 10, lambda trial: trial.found) == (middle, low, high)
    assert not replace(TRIAL, state=REFUSED).wrong


def test_a_rough_surface_is_as_far_off_as_asked(bumpy_mesh, rng):
    mesh = bumpy_mesh.scaled(3.0)
    moved = np.linalg.norm(rough(mesh, 0.5, rng).vertices - mesh.vertices, axis=1)
    assert 0.35 < np.sqrt((moved**2).mean()) < 0.65


def test_the_documented_verdicts_hold():
    """Of the poses that are accepted, at most 1 % are wrong; no image of something else is."""
    rows, conditions = read_rows(IMG / "registration_grid.csv", RegistrationTrial)
    assert "quick False" in "".join(conditions)
    accepted = [row for row in rows if row.state == ACCEPTED]
    assert sum(row.wrong for row in accepted) <= 0.01 * len(accepted)
