"""Tables of measurements keep their rows and their conditions."""

import pytest

from pipeline.errors import InputError
from pipeline.evaluation.conditions import current_conditions
from pipeline.evaluation.measured_table import measured_table, read_table, write_table

COLUMNS = ("name", "time_ms")


def test_a_table_is_read_as_it_was_written(tmp_path):
    conditions = current_conditions({"seed": 3, "note": "two\nlines"}, blender="5.2.0")
    path = tmp_path / "table.csv"
    write_table(path, COLUMNS, [("a, b", 1.5), ("c", 1 / 3)], conditions)
    rows, comments = read_table(path, COLUMNS)
    assert rows == [{"name": "a, b", "time_ms": "1.5"}, {"name": "c", "time_ms": "0.333333"}]
    assert comments == conditions.lines()
    assert any("Blender 5.2.0" in line for line in comments)
    assert "configuration: seed 3, note two lines" in comments
    kind = measured_table("a table", COLUMNS)
    assert kind.is_of(path)
    assert not measured_table("another", ("name",)).is_of(path)


@pytest.mark.parametrize("text", ["", "# only: a comment\n", "other,columns\n1,2\n", "name,time_ms\nalone\n"])
def test_another_table_is_refused(tmp_path, text):
    path = tmp_path / "table.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=r"table\.csv: expected"):
        read_table(path, COLUMNS)
