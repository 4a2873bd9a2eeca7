"""Names of a comparison's pictures: unique wherever the folder is, and safe in messages and tables."""

import csv
import io
from pathlib import Path

from hypothesis import given
from hypothesis import strategies as st

from pipeline.evaluation.picture_names import picture_names, shown_path

NAMES = st.text(st.characters(blacklist_characters="/\0"), min_size=1).filter(lambda name: name not in (".", ".."))


@given(st.lists(NAMES | st.sampled_from(["a.png", "A.jpg", "a_2.png", "a_3.tif", "sheet.png", "Sheet.bmp", "n" * 255])))
def test_names_differ_and_are_short_enough(names):
    found = picture_names([Path("x") / name for name in names], ("likeness.csv", "sheet.png"))
    folded = [name.casefold() for name in (*found, "likeness.csv", "sheet.png")]
    assert len(found) == len(names)
    assert len(set(folded)) == len(folded)
    assert all(len(name.encode(errors="surrogateescape")) <= 255 for name in found)
    assert all(map(str.isprintable, found))
    assert all(name.endswith(".png") and Path(name).name == name for name in found)


def test_a_photograph_keeps_its_name_where_it_can():
    paths = [Path(name) for name in ("a/view.png", "b/view.jpg", "sheet.png", "other.png")]
    assert picture_names(paths, ("sheet.png",)) == ["view.png", "view_2.png", "sheet_2.png", "other.png"]


@given(NAMES)
def test_a_shown_name_is_one_cell_of_one_line(name):
    shown = shown_path(Path("x") / name)
    assert len(shown.splitlines()) == 1
    assert not shown.startswith(("=", "+", "-", "@", "\t", "\r"))
    line = io.StringIO()
    csv.writer(line).writerow([shown, 1])
    assert next(csv.reader([line.getvalue()])) == [shown, "1"]


def test_a_formula_stays_the_name_of_its_file(tmp_path):
    (tmp_path / "=1+1.png").touch()
    assert shown_path(tmp_path / "=1+1.png") == "./=1+1.png"
    assert (tmp_path / shown_path(tmp_path / "=1+1.png")).exists()
    assert shown_path(Path("a\nb.png")) == "a\\nb.png"
    assert shown_path(Path('ä "x", y.png')) == 'ä "x", y.png'
