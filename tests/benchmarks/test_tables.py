"""Tables of measurements: what is counted, that it comes back from its file, and that the documented ones say so."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from oneframe.evaluation.conditions import current_conditions
from oneframe.registration.verdict import ACCEPTED, REFUSED
from scripts.benchmarks.alignment.registration_trials import RegistrationTrial, share
from scripts.benchmarks.charts.stability_charts import CHARTS
from scripts.benchmarks.figures import conditions_note, read_rows, write_rows
from scripts.benchmarks.learning.pose_trials import PoseTrial, Training, median_errors
from scripts.benchmarks.sweeps.cells import ANSWERS, Cell, Outcome
from scripts.benchmarks.sweeps.landmarks import OURS, SWEEPS, Sweep, measure

IMG = Path(__file__).resolve().parents[2] / "docs" / "img"
CONDITIONS = current_conditions({"seed": 3, "note": "two\nlines"}, blender="5.2.0")
KNOWN_SILENT = {"pose error", "incidence", "calibration", "blurred"}
"""Sweeps in which a result is wrong without a word: nobody stated the error, or one photograph; see stability.md."""
TRIAL = RegistrationTrial("grid", "a", True, "0", "1", "clean", 0.0, 9.0, ACCEPTED, 0.99, 0.1, 0.1, 0.1, 0.1)

numbers = st.floats(allow_nan=False).map(lambda value: float(f"{value:.6g}"))
texts = st.text('abc ,;"é', max_size=9)
counts = [st.integers(0, 9)] * 7
cells = st.builds(
    Cell, texts, texts, numbers, numbers, *counts, numbers, numbers, st.just(math.inf), texts, numbers, texts
)
outcomes = st.builds(
    Outcome, answer=st.sampled_from(ANSWERS), error=st.floats(0, 1e6) | st.just(math.nan), wrong=st.booleans(),
    message=st.text(max_size=300), value=st.floats(-1e6, 1e6) | st.just(math.nan),
)  # fmt: skip


@settings(max_examples=30)
@given(st.lists(cells, min_size=1, max_size=5))
def test_rows_survive_their_table(tmp_path_factory, rows):
    path = tmp_path_factory.mktemp("rows") / "cells.csv"
    write_rows(path, rows, CONDITIONS, "answer")
    found, lines = read_rows(path, Cell)
    assert (found, lines) == (rows, CONDITIONS.lines())
    assert conditions_note(lines).startswith("seed 3, note two lines; OneFrame ")


@settings(max_examples=50)
@given(found=st.lists(outcomes, min_size=1, max_size=20))
def test_a_cell_counts_its_trials(found):
    cell = Cell.of("sweep", "series", 1, found)
    assert cell.works + cell.warns + cell.falls_back + cell.refuses == cell.trials == len(found)
    assert 0 <= cell.silent <= min(cell.wrong, cell.works)
    assert max(cell.works, cell.warns, cell.falls_back, cell.refuses) == sum(o.answer == cell.answer for o in found)
    assert not cell.error > cell.error_95


def test_a_cell_depends_on_its_seed_alone():
    sweep = Sweep("number", "count", (5, 8), SWEEPS[0].others)
    one, again, other = (measure(sweep, 0, 1600.0, seed, quick=True) for seed in (1, 1, 2))
    assert [repr(cell) for cell in one] == [repr(cell) for cell in again] != [repr(cell) for cell in other]
    assert {cell.series for cell in one} == {OURS, "EPnP", "SQPnP + LM"}


def test_trials_of_one_source_go_together():
    trials = [replace(TRIAL, source=str(number), error_px=9.0 * (number % 2)) for number in range(20)]
    middle, low, high = share(trials, lambda trial: trial.found)
    assert (middle, sum(trial.wrong for trial in trials)) == (0.5, 10)
    assert 0.2 < low < 0.4 < 0.6 < high < 0.8
    # ten times the same says nothing new
    assert share(trials * 10, lambda trial: trial.found) == (middle, low, high)
    assert not replace(TRIAL, state=REFUSED).wrong


@pytest.mark.parametrize("topic", CHARTS)
def test_the_documented_tables_say_what_the_page_says(topic):
    """No result is wrong without a word, but where the page says so."""
    rows, conditions = read_rows(IMG / f"stability_{topic}.csv", Cell)
    assert "quick False" in "".join(conditions)
    silent = {row.sweep for row in rows if row.silent > 0.05 * row.trials and row.series not in ("EPnP", "SQPnP + LM")}
    assert silent <= KNOWN_SILENT


def test_of_documented_poses_that_are_accepted_one_percent_is_wrong():
    rows, conditions = read_rows(IMG / "registration_grid.csv", RegistrationTrial)
    assert "quick False" in "".join(conditions)
    accepted = [row for row in rows if row.state == ACCEPTED]
    assert sum(row.wrong for row in accepted) <= 0.01 * len(accepted)


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
