"""Figures come back from their files as they were measured, and other files are refused."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from oneframe.errors import InputError
from oneframe.evaluation.conditions import current_conditions
from scripts.benchmarks.figures import conditions_note, read_rows, write_rows
from scripts.benchmarks.sweeps.cells import Cell

CONDITIONS = current_conditions({"seed": 3, "note": "two\nlines"}, blender="5.2.0")

numbers = st.floats(allow_nan=False).map(lambda value: float(f"{value:.6g}"))
texts = st.text('abc ,;"é', max_size=9)
counts = [st.integers(0, 9)] * 7
cells = st.builds(
    Cell, texts, texts, numbers, numbers, *counts, numbers, numbers, st.just(math.inf), texts, numbers, texts
)


@given(st.lists(cells, min_size=1, max_size=5))
def test_rows_survive_their_table(tmp_path_factory, rows):
    path = tmp_path_factory.mktemp("rows") / "cells.csv"
    write_rows(path, rows, CONDITIONS, "answer")
    found, lines = read_rows(path, Cell)
    assert found == rows
    assert lines == CONDITIONS.lines()
    assert conditions_note(lines).startswith("seed 3, note two lines; OneFrame ")


@pytest.mark.parametrize("text", ["", "# only: a comment\n", "other,columns\n1,2\n", "sweep,series\nalone\n"])
def test_another_table_is_refused(tmp_path, text):
    (tmp_path / "table.csv").write_text(text)
    with pytest.raises(InputError, match=r"table\.csv: expected"):
        read_rows(tmp_path / "table.csv", Cell)
