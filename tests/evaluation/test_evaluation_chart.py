"""Charts of an evaluation: the same record gives the same bytes; nothing is cut off; what is missing is said."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from oneframe.charts.page import THEMES
from oneframe.evaluation.conditions import current_conditions
from oneframe.evaluation.record.evaluation_chart import evaluation_charts
from oneframe.evaluation.record.evaluation_record import (
    Bound,
    EvaluatedCase,
    EvaluatedMethod,
    Evaluation,
    Row,
    summarised,
)
from oneframe.evaluation.scores.view_scores import SCORES

matplotlib = pytest.importorskip("matplotlib")
ROOT = Path(__file__).resolve().parents[2]


def evaluation(cases: int) -> Evaluation:
    """Three methods whose names are as long as they get, on photographs of one or several cases."""
    rng = np.random.default_rng(3)
    names = [f"case {number}" for number in range(cases)]
    methods = (
        EvaluatedMethod("ours, projective, fill, cycles", peer=False),
        EvaluatedMethod("ours, vertex, eevee", peer=False),
        EvaluatedMethod("paper's colours (Cycles)", peer=True),
        EvaluatedMethod("paper (PyVista)", peer=True, skipped="PyVista is not installed"),
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
        cases=tuple(EvaluatedCase(name, ("view 0",)) for name in names),
        methods=methods,
        rows=rows,
        summary=summarised(rows, [EvaluatedCase(name, ()) for name in names], rng),
        distribution=(),
        bound=bound,
    )


def test_charts_are_drawn_again_alike_and_their_text_is_within_and_apart(tmp_path, monkeypatch):
    from matplotlib.figure import Figure
    from matplotlib.text import Text

    figures, save = [], Figure.savefig
    monkeypatch.setattr(
        Figure, "savefig", lambda self, *args, **options: (figures.append(self), save(self, *args, **options))
    )
    first = {path.name: path.read_bytes() for path in evaluation_charts(evaluation(7), tmp_path / "chart.json")}
    assert len(first) == 8
    for figure in figures:
        # the last to be saved is the PNG, whose coordinates these are
        figure.draw_without_rendering()
        texts = [text for text in figure.findobj(Text) if text.get_visible() and text.get_text().strip()]
        boxes = [text.get_window_extent() for text in texts]
        assert len(boxes) > 10
        for number, (box, text) in enumerate(zip(boxes, texts, strict=True)):
            assert figure.bbox.x0 <= box.x0 < box.x1 <= figure.bbox.x1, text
            assert figure.bbox.y0 <= box.y0 < box.y1 <= figure.bbox.y1, text
            assert box.shrunk(0.9, 0.8).count_overlaps(boxes[:number]) == 0, text
    with matplotlib.rc_context({"font.size": 40, "figure.facecolor": "red", "svg.hashsalt": None}):
        again = evaluation_charts(evaluation(7), tmp_path / "chart.json")
        assert {path.name: path.read_bytes() for path in again} == first
        assert matplotlib.rcParams["font.size"] == 40
    for theme in THEMES:
        image = cv2.imdecode(np.frombuffer(first[f"chart{theme.suffix}.png"], np.uint8), cv2.IMREAD_COLOR)
        assert "#" + "".join(f"{value:02x}" for value in image[0, 0, ::-1]) == theme.background
