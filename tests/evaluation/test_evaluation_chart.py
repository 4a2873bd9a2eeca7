"""Charts of an evaluation: the same record gives the same bytes; nothing is cut off; what is missing is said."""

import cv2
import numpy as np
import pytest

from oneframe.charts.page import PAPER
from oneframe.evaluation.record.evaluation_chart import evaluation_charts
from tests.report.synthetic_evaluation import evaluation

matplotlib = pytest.importorskip("matplotlib")


def test_charts_are_drawn_again_alike_and_their_text_is_within_and_apart(tmp_path, monkeypatch):
    from matplotlib.figure import Figure
    from matplotlib.text import Text

    figures, save = [], Figure.savefig
    found = evaluation({f"case {number}": ("view 0", "view 1") for number in range(7)}, np.random.default_rng(3))
    monkeypatch.setattr(
        Figure, "savefig", lambda self, *args, **options: (figures.append(self), save(self, *args, **options))
    )
    first = {path.name: path.read_bytes() for path in evaluation_charts(found, tmp_path / "chart.json")}
    assert len(first) == 2
    for figure in figures:
        figure.draw_without_rendering()
        texts = [text for text in figure.findobj(Text) if text.get_visible() and text.get_text().strip()]
        boxes = [text.get_window_extent() for text in texts]
        assert len(boxes) > 10
        for number, (box, text) in enumerate(zip(boxes, texts, strict=True)):
            assert figure.bbox.x0 <= box.x0 < box.x1 <= figure.bbox.x1, text
            assert figure.bbox.y0 <= box.y0 < box.y1 <= figure.bbox.y1, text
            assert box.shrunk(0.9, 0.8).count_overlaps(boxes[:number]) == 0, text
    with matplotlib.rc_context({"font.size": 40, "figure.facecolor": "red"}):
        again = evaluation_charts(found, tmp_path / "chart.json")
        assert {path.name: path.read_bytes() for path in again} == first
        assert matplotlib.rcParams["font.size"] == 40
    image = cv2.imdecode(np.frombuffer(first["chart.png"], np.uint8), cv2.IMREAD_COLOR)
    assert "#" + "".join(f"{value:02x}" for value in image[0, 0, ::-1]) == PAPER
