"""Speed against accuracy: the Pareto front, the table, the chart, and the command."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.errors import InputError
from pipeline.evaluation.charts.speed_accuracy_chart import speed_accuracy_charts
from pipeline.evaluation.conditions import Conditions
from pipeline.evaluation.measured_table import write_table
from pipeline.evaluation.trials.speed_accuracy import COLUMNS, FLOOR, OURS, PEER, SpeedPoint, pareto_front, read_points

SCRIPT = Path(__file__).parents[2] / "scripts" / "benchmark_chart.py"

# few different values, so that ties are frequent
values = st.one_of(st.sampled_from([1.0, 2.0, 3.0, np.nan]), st.floats(1e-3, 1e3))


@given(points=st.lists(st.tuples(values, values), max_size=30))
def test_no_kept_point_is_beaten_and_every_dropped_one_is(points):
    kept = pareto_front([cost for cost, _ in points], [error for _, error in points])

    def beats(one, other):
        return one[0] <= other[0] and one[1] <= other[1] and one != other

    for point, keep in zip(points, kept, strict=True):
        measured = np.isfinite(point).all()
        assert keep == (measured and not any(beats(other, point) for other in points if np.isfinite(other).all()))
    assert kept.any() == any(np.isfinite(point).all() for point in points)


def some_points() -> list[SpeedPoint]:
    def ours(name: str, ms: float, error: float) -> SpeedPoint:
        scores = {"error": error, "ssim": 0.99, "photograph_error": 9.0, "photograph_ssim": 0.9 - error / 50}
        return SpeedPoint("a", OURS, name, "Cycles", 1, "projective", "", 100, 2, ms, ms - 1, ms + 2, **scores)

    return [
        ours("Cycles, projective, 1 sample", 100.0, 0.5),
        ours("Cycles, projective, 8 samples", 200.0, 0.25),
        ours("Cycles, projective, 1 sample, 1 process", 150.0, 0.5),
        SpeedPoint("a", PEER, "PyVista", "PyVista", 8, "vertex", "", 100, 1, 90.0, 80.0, 99.0, 4.0, 0.8, 9.0, 0.7, 0.7),
        SpeedPoint("a", FLOOR, "Cycles alone", "Cycles", 1, "none", "", 100, 1, 70.0, 60.0, 80.0),
    ]


def test_points_come_back_from_the_table_and_the_chart_has_the_same_bytes(tmp_path):
    pytest.importorskip("matplotlib")
    data = tmp_path / "chart.csv"
    conditions = Conditions("a machine", {"OneFrame": "1"}, {"seed": 0}, "2026-01-01")
    write_table(data, COLUMNS, [point.row() for point in some_points()], conditions)
    points, lines = read_points(data)
    np.testing.assert_equal([point.row() for point in points], [point.row() for point in some_points()])
    assert lines == conditions.lines()
    drawn = [{path.name: path.read_bytes() for path in speed_accuracy_charts(points, "x", data)} for _ in range(2)]
    assert drawn[0] == drawn[1]
    assert sorted(drawn[0]) == ["chart-dark.png", "chart-dark.svg", "chart.png", "chart.svg"]


def test_labels_of_the_chart_cover_neither_each_other_nor_the_frame(tmp_path, monkeypatch):
    pytest.importorskip("matplotlib")
    from pipeline.evaluation.charts import speed_accuracy_chart

    boxes = []
    place = speed_accuracy_chart._place

    def watched(figure, theme, labels, markers):
        place(figure, theme, labels, markers)
        for axes in figure.axes:
            boxes.append(
                (axes.get_window_extent(), [text.get_window_extent() for text in axes.texts if text.get_text()])
            )

    monkeypatch.setattr(speed_accuracy_chart, "_place", watched)
    speed_accuracy_charts(some_points(), "x", tmp_path / "chart.csv")
    assert sum(len(texts) for _, texts in boxes) >= 12
    for frame, texts in boxes:
        assert all(frame.x0 <= box.x0 and box.x1 <= frame.x1 for box in texts)
        assert not any(a.overlaps(b) for i, a in enumerate(texts) for b in texts[:i])


def test_a_table_of_something_else_is_refused(tmp_path):
    data = tmp_path / "chart.csv"
    wrong = [[*point.row()[:9], "soon", *point.row()[10:]] for point in some_points()]
    write_table(data, COLUMNS, wrong, Conditions("a machine", {}))
    with pytest.raises(InputError, match="expected numbers"):
        read_points(data)
    write_table(data, COLUMNS, [], Conditions("a machine", {}))
    with pytest.raises(InputError, match="measure it again"):
        read_points(data)


@pytest.mark.render
def test_the_command_measures_and_draws(tmp_path, write_tiny_case):
    """On a tiny case instead of the sample, with the fewest views and configurations."""
    pytest.importorskip("matplotlib")
    case, out = write_tiny_case(tmp_path / "case"), tmp_path / "chart.csv"
    command = [sys.executable, str(SCRIPT), "--quick", "--without-sample", "--case", str(case), "--out", str(out)]
    ended = subprocess.run(command, capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stderr
    points, conditions = read_points(out)
    exact = next(point for point in points if point.name == "Cycles, projective, 1 sample")
    coarse = next(point for point in points if point.name == "Cycles, vertex, 1 sample")
    assert 0 < 1.5 * exact.error < coarse.error < 5
    assert exact.ms_least <= exact.ms <= exact.ms_most
    assert any(line.startswith("configuration: seed 0") for line in conditions)
    first = (tmp_path / "chart.svg").read_bytes()
    ended = subprocess.run([*command, "--redraw"], capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stderr
    assert (tmp_path / "chart.svg").read_bytes() == first
