"""Plans of a virtual drill: what is written is read back, and what cannot be drilled is refused in words."""

from pathlib import Path

import numpy as np
import pytest

from oneframe.errors import InputError
from oneframe.volume.drill.drill_plan import (
    MOST_POINTS,
    DrillPlan,
    Stroke,
    check_strokes,
    read_drill_plan,
)
from oneframe.volume.volume import VoxelGrid

EXAMPLES = Path(__file__).resolve().parents[3] / "docs" / "examples"

STROKE = "[[strokes]]\nradius_mm = 2\npoints_mm = [[1, 2, 3]]\n"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[margins_mm]\nnerve = 1\n", "key 'strokes', it is missing"),
        (STROKE + "[margin_mm]\n", "did you mean 'margins_mm'"),
        (STROKE + "[margins_mm]\nnerve = -1\n", "'nerve': .*found -1"),
        (STROKE.replace("2\n", "0\n"), "stroke 1: radius_mm: .*found 0"),
        (STROKE.replace("[[1, 2, 3]]", "[[1, 2]]"), r"expected points .*found \[1, 2\]"),
        (STROKE.replace("[[1, 2, 3]]", "[[1, 2, nan]]"), "expected points"),
        (STROKE.replace("[[1, 2, 3]]", f"[{'[1, 2, 3],' * (MOST_POINTS + 1)}]"), "up to 10,000 points"),
    ],
)
def test_mistakes_are_named(tmp_path, text, message):
    (tmp_path / "drill.toml").write_text(text)
    with pytest.raises(InputError, match=rf"^drill.toml: .*{message}"):
        read_drill_plan(tmp_path / "drill.toml")


def test_strokes_outside_are_refused_and_partly_outside_counted():
    turned = np.eye(4)
    turned[:3, :3] = np.array([[1, -1, 0], [1, 1, 0], [0, 0, np.sqrt(2)]]) / np.sqrt(2) * 0.5
    grid = VoxelGrid((40, 40, 40), turned)
    inside, leaving = Stroke(1.0, np.array([[0.0, 14.0, 10.0]])), Stroke(1.0, np.array([[0, 14, 10], [0, 14, 30.0]]))
    # in the box around the turned volume, but not in the volume; and on both sides of it
    corner, around = (
        Stroke(1.0, np.array([[13.0, 2.0, 10.0]])),
        Stroke(1.0, np.array([[0, 14, 25.0], [0, 50, 25], [0, 50, 10]])),
    )
    assert check_strokes(DrillPlan((inside, inside)), grid, "plan") == []
    (message,) = check_strokes(DrillPlan((inside, leaving, leaving)), grid, "plan")
    assert message.startswith("plan: 2 of 3 strokes ")
    for stroke in (corner, around):
        with pytest.raises(InputError, match=r"^plan: stroke 2: .*\[-13.8, 0.0, 0.0\] to \[13.8, 27.6, 19.5\]"):
            check_strokes(DrillPlan((inside, stroke)), grid, "plan")


def test_examples_are_plans():
    paths = sorted(EXAMPLES.glob("drill_*.toml"))
    assert len(paths) == 3
    for path in paths:
        plan = read_drill_plan(path)
        assert len(plan.strokes) > 5
        # that of the head has no labels
        assert path.stem == "drill_head" or plan.margins_mm["facial_nerve"] >= 1
