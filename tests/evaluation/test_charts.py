"""Charts: the same records give the same bytes; nothing is cut off; what is missing is said."""

import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.errors import InputError
from pipeline.evaluation.charts.evaluation_chart import evaluation_charts
from pipeline.evaluation.charts.landmark_chart import landmark_accuracy_charts
from pipeline.evaluation.charts.page import DPI, THEMES, round_ticks
from pipeline.evaluation.charts.refinement_chart import refinement_charts
from pipeline.evaluation.charts.render_speed_chart import render_speed_charts
from pipeline.evaluation.conditions import current_conditions
from pipeline.evaluation.record.evaluation_record import (
    Bound,
    EvaluatedCase,
    EvaluatedMethod,
    Evaluation,
    Row,
    summarised,
)
from pipeline.evaluation.scores.view_scores import SCORES
from pipeline.evaluation.trials.landmark_accuracy import ErrorQuantiles, LandmarkAccuracy, LandmarkFigures
from pipeline.evaluation.trials.landmark_trials import PEERS as SOLVERS
from pipeline.evaluation.trials.refinement_basin import RefinementTrial, trials_to_csv
from pipeline.evaluation.trials.render_times import PEERS, RenderTimes

matplotlib = pytest.importorskip("matplotlib")
ROOT = Path(__file__).resolve().parents[2]


def accuracy_row(pairs: int, sigma_px: float, factor: float = 1.0) -> LandmarkAccuracy:
    def errors(scale: float) -> ErrorQuantiles:
        size = scale * sigma_px / pairs
        return ErrorQuantiles((0.5 * size, 1.6 * size), (3 * size, 9 * size))

    peers = dict.fromkeys(SOLVERS, errors(factor))
    return LandmarkAccuracy(pairs, sigma_px, errors(1.0), errors(1.0), peers, {}, 0.95)


def landmark_figures(noises: tuple[float, ...], factor: float = 1.0) -> LandmarkFigures:
    rows = tuple(accuracy_row(pairs, sigma_px, factor) for sigma_px in noises for pairs in (4, 6, 8, 10))
    return LandmarkFigures(100, rows, (), (), ())


def refinement_trials(verdict=lambda angle, percent: (True, True)) -> list[RefinementTrial]:
    trials = []
    for number, (angle, percent) in enumerate([(a, p) for a in (1.0, 2.0, 5.0, 10.0, 15.0) for p in (1.0, 2.0, 5.0)]):
        right, accepted = verdict(angle, percent)
        error_px = 0.3 + 0.01 * number if right else 200.0
        trials.append(
            RefinementTrial(
                scene="hills",
                image="right",
                angle_deg=angle,
                percent=percent,
                start_px=20.0 * angle,
                error_deg=0.1,
                error_px=error_px,
                right=right,
                accepted=accepted,
                score_before=0.1,
                score_after=0.5,
                estimated_px_before=3.0,
                estimated_px_after=1.0,
                split_half_px=0.2,
                second_peak_ratio=0.1,
                seconds=1.0,
                message="",
            )
        )
    return trials


def render_times() -> RenderTimes:
    names = (*PEERS, "exact, projective", "anti-aliased (8 rays), projective")
    return RenderTimes({name: (0.1 * (1 + n / 3), 0.11 * (1 + n / 3), 0.09) for n, name in enumerate(names)})


def evaluation(cases: int) -> Evaluation:
    """Three methods whose names are as long as they get, on photographs of one or several cases."""
    rng = np.random.default_rng(3)
    names = [f"case {number}" for number in range(cases)]
    methods = (
        EvaluatedMethod("ours, projective, fill, cycles", peer=False),
        EvaluatedMethod("ours, vertex, workbench", peer=False),
        EvaluatedMethod("paper's colours (Cycles)", peer=True),
        EvaluatedMethod("paper (PyTorch3D)", peer=True, skipped="PyTorch3D is not installed"),
    )
    rows = tuple(
        Row(
            case, f"view {view}", method.name, {score: 0.5 + 0.2 * rng.random() + 0.2 * method.peer for score in SCORES}
        )
        for case in names
        for method in methods[:3]
        for view in range(4)
    )
    bound = tuple(Bound(case, score, 0.95, 0.94, 0.96, 1.5) for case in (*names, "all") for score in SCORES)
    return Evaluation(
        conditions=current_conditions({"seed": 0}, blender="5.2.0"),
        cases=tuple(EvaluatedCase(name, f"{name}.toml", ("view 0",)) for name in names),
        methods=methods,
        rows=rows,
        summary=summarised(rows, rng),
        distribution=(),
        bound=bound,
    )


CHARTS = {
    "landmarks": lambda path: landmark_accuracy_charts(landmark_figures((2.0,), 30.0), path),
    "landmarks, two noises": lambda path: landmark_accuracy_charts(landmark_figures((1.0, 4.0)), path),
    "landmarks, a solver without an answer": lambda path: landmark_accuracy_charts(
        landmark_figures((2.0,), np.inf), path
    ),
    "refinement": lambda path: refinement_charts(refinement_trials(), path),
    "refinement, all verdicts": lambda path: refinement_charts(
        refinement_trials(lambda angle, percent: (angle < 5, percent < 5)), path
    ),
    "render speed": lambda path: render_speed_charts(render_times(), path),
    "evaluation": lambda path: evaluation_charts(evaluation(1), path),
    "evaluation, several cases": lambda path: evaluation_charts(evaluation(7), path),
}


@pytest.mark.parametrize("name", ["landmarks", "refinement", "render speed"])
def test_every_chart_is_written_for_both_pages_and_again_alike(name, tmp_path):
    draw = CHARTS[name]
    first = {path.name: path.read_bytes() for path in draw(tmp_path / "chart.json")}
    assert set(first) == {"chart.svg", "chart.png", "chart-dark.svg", "chart-dark.png"}
    with matplotlib.rc_context({"font.size": 40, "figure.facecolor": "red", "svg.hashsalt": None}):
        assert {path.name: path.read_bytes() for path in draw(tmp_path / "chart.json")} == first
        assert matplotlib.rcParams["font.size"] == 40
    for theme in THEMES:
        image = cv2.imdecode(np.frombuffer(first[f"chart{theme.suffix}.png"], np.uint8), cv2.IMREAD_COLOR)
        assert "#" + "".join(f"{value:02x}" for value in image[0, 0, ::-1]) == theme.background
        assert image.shape[1] == round(10.2 * DPI)
        # nothing touches the border
        for edge in (image[:3], image[-3:], image[:, :3], image[:, -3:]):
            assert (edge == image[0, 0]).all()


@pytest.mark.parametrize("draw", CHARTS.values(), ids=CHARTS)
def test_text_is_within_the_picture_and_apart(draw, tmp_path, monkeypatch):
    from matplotlib.figure import Figure
    from matplotlib.text import Text

    figures, save = [], Figure.savefig
    monkeypatch.setattr(
        Figure, "savefig", lambda self, *args, **options: (figures.append(self), save(self, *args, **options))
    )
    draw(tmp_path / "chart.json")
    for figure in figures:
        # the last to be saved is the PNG, whose coordinates these are
        figure.draw_without_rendering()
        texts = [text for text in figure.findobj(Text) if text.get_visible() and text.get_text().strip()]
        boxes = [text.get_window_extent() for text in texts]
        assert len(boxes) > 10
        for text, box in zip(texts, boxes, strict=True):
            assert figure.bbox.x0 <= box.x0, text
            assert box.x1 <= figure.bbox.x1, text
            assert figure.bbox.y0 <= box.y0, text
            assert box.y1 <= figure.bbox.y1, text
        for number, box in enumerate(boxes):
            for other, text in zip(boxes[:number], texts, strict=False):
                assert box.shrunk(0.9, 0.8).count_overlaps([other]) == 0, (texts[number], text)


def test_trials_of_wrong_images_alone_are_no_basin(tmp_path):
    with pytest.raises(InputError, match="expected trials of the right image"):
        refinement_charts([], tmp_path / "refinement.csv")


@settings(max_examples=300)
@given(st.floats(-4, 4), st.floats(0.05, 7))
def test_ticks_are_few_and_within_the_axis(low, decades):
    ends = 10**low, 10 ** (low + decades)
    ticks = round_ticks(*ends)
    assert 2 <= len(ticks) <= 9
    assert ticks == sorted(set(ticks))
    assert ends[0] <= ticks[0]
    assert ticks[-1] <= ends[1]


def test_the_script_redraws_from_its_table(tmp_path):
    (tmp_path / "refinement.csv").write_bytes(trials_to_csv(refinement_trials()))
    command = [sys.executable, ROOT / "scripts" / "benchmark_refinement.py", "--redraw", "--out", tmp_path]
    ended = subprocess.run(command, capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stderr
    assert "right 15 of 15" in ended.stdout
    found = {path.name: path.read_bytes() for path in tmp_path.glob("refinement*.[sp]*g")}
    expected = refinement_charts(refinement_trials(), tmp_path / "refinement.csv")
    assert found == {path.name: path.read_bytes() for path in expected}


def test_what_is_missing_is_said_before_anything_is_measured(tmp_path):
    code = (
        "import sys, runpy; sys.modules['matplotlib'] = None\n"
        f"sys.argv = ['benchmark_refinement.py', 'case.toml', '--out', {str(tmp_path)!r}]\n"
        "runpy.run_path('scripts/benchmark_refinement.py', run_name='__main__')"
    )
    ended = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False)
    assert ended.returncode == 3, ended.stderr
    assert ended.stderr.count("\n") == 1
    assert "pip install 'oneframe[charts]'" in ended.stderr
    assert list(tmp_path.iterdir()) == []
