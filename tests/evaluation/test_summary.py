"""What tables show of an evaluation, who leads, and how sure the means are."""

import numpy as np
import pytest

from oneframe.evaluation.conditions import current_conditions
from oneframe.evaluation.summary import Resampling, Row, Summary, markdown_table, summary_notes, summary_of
from oneframe.evaluation.view_scores import SCORES

OURS, PEER = "ours, projective, cycles", "paper (PyVista)"


def summary(ours: float, peer: float, features: int = 0) -> Summary:
    values = dict.fromkeys(SCORES, 0.5) | {"surface_px": 200.0, "observed_px": 90.0, "psnr_whole": float("inf")}
    rows = [
        Row("case", f"{number}", name, values | {"ssim_surface": score + 0.01 * number, "ssim_observed": np.nan})
        for number in range(5)
        for name, score in ((OURS, ours), (PEER, peer))
    ]
    rng = np.random.default_rng(0)
    pairs = {("case", OURS): [(rng.normal(size=8), rng.normal(size=8)) for _ in range(features)]}
    return summary_of(rows, {"case": "mesh"}, {OURS: False, PEER: True}, current_conditions({}), pairs, rng)


def test_the_table_has_every_method_and_no_undefined_number():
    found = summary(0.6, 0.5, features=40)
    text = markdown_table(found, summary_notes(found)).decode()
    assert "nan" not in text
    assert "FID is biased" in text
    assert "is ahead" not in text
    rows = [line for line in text.splitlines() if line.startswith(f"| {OURS} |")]
    assert len(rows) == 1
    assert "| 0.620 [" in rows[0]
    assert found.mean("case", OURS, "ssim_surface").mean == pytest.approx(0.62)


def test_a_peer_that_leads_is_named_with_the_interval_of_the_difference():
    (sentence,) = (note for note in summary_notes(summary(0.5, 0.6)) if "is ahead" in note)
    assert "0.620 against 0.520" in sentence
    assert "by 0.100 to 0.100 on the same photographs" in sentence


def test_intervals_cover_the_true_mean_as_often_as_they_say(rng):
    """Also where photographs of one surface resemble each other, as intervals over photographs would not."""
    paths = [(surface, photograph) for surface in range(6) for photograph in range(20)]
    flat, nested = Resampling([(path,) for path in paths], rng), Resampling(paths, rng)
    hits = np.zeros(2)
    for _ in range(400):
        values = np.repeat(rng.normal(size=6), 20) + 0.3 * rng.normal(size=120)
        hits += [found.low <= 0 <= found.high for found in (each.interval(values) for each in (flat, nested))]
    assert hits[0] / 400 < 0.6
    assert 0.9 < hits[1] / 400 < 0.99
    assert Resampling([("a",), ("b",)], rng).interval(np.array([1.0, np.nan])).n == 1
    same = [Resampling(paths, np.random.default_rng(4)).interval(values) for _ in range(2)]
    assert same[0] == same[1]
