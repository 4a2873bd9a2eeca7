"""Charts of an evaluation: nothing is cut off, and nothing lies over anything else."""

import numpy as np
import pytest

from oneframe.evaluation.record.evaluation_chart import evaluation_charts
from tests.report.synthetic_evaluation import evaluation

matplotlib = pytest.importorskip("matplotlib")


def test_texts_of_charts_are_within_and_apart(tmp_path, monkeypatch):
    from matplotlib.figure import Figure
    from matplotlib.text import Text

    figures, save = [], Figure.savefig
    found = evaluation({f"case {number}": ("view 0", "view 1") for number in range(5)}, np.random.default_rng(3))
    monkeypatch.setattr(
        Figure, "savefig", lambda self, *args, **options: (figures.append(self), save(self, *args, **options))
    )
    # as some user's own style
    with matplotlib.rc_context({"font.size": 40}):
        assert len(evaluation_charts(found, tmp_path / "chart.json")) == 2
        assert matplotlib.rcParams["font.size"] == 40
    for figure in figures:
        figure.draw_without_rendering()
        texts = [text for text in figure.findobj(Text) if text.get_visible() and text.get_text().strip()]
        boxes = [text.get_window_extent() for text in texts]
        assert len(boxes) > 10
        for number, (box, text) in enumerate(zip(boxes, texts, strict=True)):
            assert figure.bbox.x0 <= box.x0 < box.x1 <= figure.bbox.x1, text
            assert figure.bbox.y0 <= box.y0 < box.y1 <= figure.bbox.y1, text
            assert box.shrunk(0.9, 0.8).count_overlaps(boxes[:number]) == 0, text
