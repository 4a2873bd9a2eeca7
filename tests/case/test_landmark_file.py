"""Landmark files: what is written is read back to the last bit; what is doubtful is refused with its line."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from oneframe.case.landmarks import Landmark, read_landmarks
from oneframe.errors import InputError
from tests.case.test_case_writer import landmarks
from tests.landmark_writer import write_landmarks


@given(landmarks=landmarks, suffix=st.sampled_from([".csv", ".json", ".JSON"]), mm_per_unit=st.sampled_from([1.0, 1e3]))
def test_what_is_written_is_read_back(tmp_path_factory, landmarks, suffix, mm_per_unit):
    path = tmp_path_factory.getbasetemp() / f"landmarks{suffix}"
    write_landmarks(path, landmarks, mm_per_unit=mm_per_unit)
    assert read_landmarks(path, mm_per_unit=mm_per_unit) == landmarks


def read(folder: Path, text: str) -> tuple[Landmark, ...]:
    path = folder / "pairs.csv"
    path.write_bytes(text.encode())
    return read_landmarks(path)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "cp1252"])
@pytest.mark.parametrize("separator", [",", ";", "\t"])
@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_encodings_separators_and_line_ends_of_spreadsheets(tmp_path, encoding, separator, end):
    text = "name|x|y|z|u|v\nSteigbügel – Fußplatte|1|2|3|4|5".replace("|", separator).replace("\n", end)
    (tmp_path / "l.csv").write_bytes(text.encode(encoding))
    expected = Landmark("Steigbügel – Fußplatte", (1.0, 2.0, 3.0), (4.0, 5.0))
    assert read_landmarks(tmp_path / "l.csv") == (expected,)


def test_spreadsheets_in_any_order_with_other_columns(tmp_path):
    text = (
        "\ufeffV;U;Name ;residual_px;z;y;x\r\n"
        '20.5;10; tip ;1.2;3;2;1\r\n\r\n;;"short; process";;-1e-3;0;0\r\n4;3;ridge\r\n;;to be placed;0.1;;;\r\n'
    )
    assert read(tmp_path, text) == (
        Landmark("tip", (1.0, 2.0, 3.0), (10.0, 20.5)),
        Landmark("short; process", (0.0, 0.0, -0.001), None),
        Landmark("ridge", None, (3.0, 4.0)),
        Landmark("to be placed", None, None),
    )
    assert [mark.enabled for mark in read(tmp_path, "name,x,y,z,u,v,enabled\na,,,,,,TRUE\nb,,,,,,0\nc")] == [1, 0, 1]


HEADER = "name,x,y,z,u,v,enabled\n"
BAD = {
    "no header": (
        "tip,1,2,3,10,20,true\n",
        r"line 1: expected a header name,x,y,z,u,v,enabled, found no column 'name'",
    ),
    "column misspelt": ("name,x,y,z,u,v,enable\n", "line 1: expected a column 'enabled', found 'enable'"),
    "word": (HEADER + "\ntip,1,2,three,,,\n", "line 3: z: expected a number, found 'three'"),
    "part of a point": (HEADER + "tip,1,,3,,,\n", "line 2: y: expected a number, found an empty cell"),
    "decimal commas": (HEADER.replace(",", ";") + "tip;1,5;2;3;;;\n", "x: expected a number, .*write a decimal point"),
    "markups of Slicer": (
        '{"@schema": "markups-schema", "markups": [{"label": "Doe"}]}',
        "found markups of 3D Slicer, which",
    ),
    "a table of other things": ('{"patient": "Doe"}', "name, surface and pixel, found a table"),
    "another separator than in the header": (
        HEADER.replace(",", ";") + "tip,1,2,3,10,20,true\n",
        "line 2: expected cells between ';' as in the header, found other signs",
    ),
    "too many cells": (
        HEADER + "tip,1,5,2,0,3,0,10,20\n",
        "line 2: expected at most 7 cells, .* found 9; write decimal",
    ),
    "truth": (HEADER + "tip,,,,,,maybe\n", "line 2: expected enabled = true or false, found 'maybe'"),
    "no name": (HEADER + ",1,2,3,,,\n", "landmark number 1: expected a name, found ''"),
    "name twice": (
        HEADER + "a,,,,,,\nb,,,,,,\na ,,,,,,\n",
        "landmark: expected a different name for each landmark, found 'a' twice",
    ),
    "quote without end": (HEADER + 'tip,1,2,3,"10,20,true\n', "line 2: expected CSV, found a mistake"),
    "broken JSON": ('[{"name": ', "expected JSON, found a mistake"),
    "JSON key": ('[{"name": "tip", "point": []}]', "landmark number 1: unknown key 'point'"),
    "nothing": ("", "found an empty file"),
    "zeros": ("\0\0\0", "found another kind of file"),
}


@pytest.mark.parametrize("name", BAD)
def test_what_is_doubtful_is_refused_with_its_line(tmp_path, name):
    text, message = BAD[name]
    with pytest.raises(InputError, match=rf"^pairs\.csv: .*{message}"):
        read(tmp_path, text)
    assert "Doe" not in message_of(tmp_path, text)


@given(text=st.text(st.sampled_from('name,xyzuv;\n"1.5-e[]{}: \r')), header=st.booleans())
def test_any_text_is_accepted_or_refused_with_a_message(tmp_path_factory, text, header):
    assert message_of(tmp_path_factory.getbasetemp(), HEADER * header + text).startswith("pairs.csv: ")


def message_of(folder: Path, text: str) -> str:
    try:
        read(folder, text)
    except InputError as error:
        return str(error)
    return "pairs.csv: taken"
