"""What an evaluation's file keeps, what its tables show, how sure the means are, and what the limit is."""

import json

import numpy as np
import pytest

from oneframe.camera.pinhole import PinholeCamera
from oneframe.errors import InputError
from oneframe.evaluation.conditions import current_conditions
from oneframe.evaluation.record.evaluation_record import (
    Distribution,
    EvaluatedCase,
    EvaluatedMethod,
    Evaluation,
    Row,
    by_angle,
    evaluation_bytes,
    read_evaluation,
    summarised,
)
from oneframe.evaluation.record.evaluation_tables import evaluation_notes, latex_summary, markdown_summary
from oneframe.evaluation.scores.flow_alignment import aligned_by_flow
from oneframe.evaluation.scores.mean_intervals import Resampling
from oneframe.evaluation.scores.reachable_scores import jittered_pose, perfect_views
from oneframe.evaluation.scores.view_scores import SCORES, colour_gain
from oneframe.transforms import transform_points

OURS, PEER = "ours, projective, cycles", "paper's & 100 %"


def evaluation(ours: float, peer: float) -> Evaluation:
    methods = (EvaluatedMethod(OURS, peer=False), EvaluatedMethod(PEER, peer=True))
    cases = (EvaluatedCase("case", ("0",)),)
    values = dict.fromkeys(SCORES, 0.5) | {"surface_px": 200.0, "observed_px": 90.0, "psnr_whole": float("inf")}
    rows = tuple(
        Row(
            "case",
            f"{number}",
            name,
            values
            | {"ssim_surface": score, "sharpness": sharp, "ssim_aligned": np.nan}
            | {"angle_deg": 5.0 * number, "error_observed": 10 * score + number},
        )
        for number in range(5)
        for name, score, sharp in ((OURS, ours, 0.9), (PEER, peer, 0.4))
    )
    distribution = (Distribution("case", OURS, 12.3, True, 0.01, 0.002, 5),)
    return Evaluation(
        current_conditions({}), cases, methods, rows, summarised(rows, cases, np.random.default_rng(0)), distribution,
        (), angles=tuple(by_angle(rows, cases, np.random.default_rng(0))),
    )  # fmt: skip


def test_the_file_is_read_back_and_has_no_values_that_json_lacks(tmp_path):
    written = evaluation(0.6, 0.5)
    path = tmp_path / "evaluation.json"
    path.write_bytes(evaluation_bytes(written))
    table = json.loads(path.read_text(), parse_constant=pytest.fail)
    assert table["rows"][0]["ssim_aligned"] is None
    assert table["rows"][0]["psnr_whole"] is None
    again = read_evaluation(path)
    assert evaluation_bytes(again) == path.read_bytes()
    for broken in (b"[]", b'{"format": "oneframe evaluation 2"}', b'{"format": "oneframe evaluation 1"}'):
        path.write_bytes(broken)
        with pytest.raises(InputError, match="evaluate again"):
            read_evaluation(path)


def test_tables_have_every_method_and_no_undefined_number():
    found = evaluation(0.6, 0.5)
    markdown, latex = markdown_summary(found, evaluation_notes(found)).decode(), latex_summary(found).decode()
    assert "nan" not in markdown + latex
    assert "biased" in markdown
    assert "saw 45% of the surface" in markdown
    assert markdown.count(f"| {OURS} |") == 6
    # at 0 and 5, 10 and 15, and 20 degrees
    assert "| observed, 0 to 10° (2) | observed, 10 to 20° (2) | observed, 20 to 35° (1) |" in markdown
    means = [e.mean for e in found.angles if (e.case, e.method, e.score) == ("case", OURS, "error_observed")]
    assert means == pytest.approx([6.5, 8.5, 10.0])
    assert r"paper's \& 100 \%" in latex
    assert r"$\mathbf{0.600} \pm 0.000$" in latex
    assert r"$0.0100 \pm 0.0020$" in latex


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


def test_the_error_of_a_pose_displaces_as_far_as_it_should(rng):
    camera = PinholeCamera(640, 480, 3200.0, 3190.0, 322.5, 236.0)
    points = rng.uniform([-20, -15, 290], [20, 15, 310], size=(500, 3))
    for shift in (0.5, 2.0, 8.0):
        moved = transform_points(jittered_pose(points, camera, shift, rng), points)
        displacement = camera.project(moved) - camera.project(points)
        assert np.sqrt((displacement**2).sum(axis=1).mean()) == pytest.approx(shift, rel=0.05)


def test_a_perfect_view_differs_by_the_exposure_and_the_shift_alone(rng, sharp_image):
    camera = PinholeCamera(160, 120, 800.0, 800.0, 79.5, 59.5)
    real = np.clip(sharp_image(camera), 0.05, 0.9).astype(np.float32)
    depth = np.full(camera.shape_hw, 300.0, np.float32)
    depth[:, :30] = 0
    exact = next(perfect_views(real, depth, camera, np.ones(3), 0.0, [rng]))
    assert exact[:, 30:] == pytest.approx(real[:, 30:], abs=2e-3)
    assert not exact[:, :30].any()
    gain = np.array([1.2, 1.1, 1.05])
    view, surface = next(perfect_views(real, depth, camera, gain, 1.5, [rng])), depth > 0
    assert colour_gain(real, view, surface) == pytest.approx(gain, rel=0.03)
    assert aligned_by_flow(real, view, surface).median_px == pytest.approx(1.5, abs=0.6)
