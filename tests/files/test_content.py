"""Every file is read by one ladder of errors, each of which says what was expected, what was found, where and why."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from oneframe.errors import InputError
from oneframe.files.content import read_content, reading, write_bytes_atomically
from oneframe.files.numbers import WrittenFloat
from oneframe.files.tables import parsed_json, parsed_toml


def missing(path: Path) -> str:
    return "does not exist; correct the path"


def folder(path: Path) -> str:
    path.mkdir()
    return "(a folder); give the path of a file in it"


def empty(path: Path) -> str:
    path.touch()
    return "found an empty file; copy or export it again"


def film(path: Path) -> str:
    with path.open("wb") as file:
        file.truncate(9 << 20)
    return "found one of 9 MB; choose another"


@pytest.mark.parametrize("where", [None, "case.toml: [frame] image"])
@pytest.mark.parametrize("make", [missing, folder, empty, film])
def test_what_cannot_be_read_is_one_message(tmp_path, make, where):
    path = tmp_path / "frame.png"
    expected = make(path)
    with pytest.raises(InputError) as caught:
        read_content(path, "an image file", where, most=1 << 20)
    message = str(caught.value)
    assert message.endswith(expected)
    place = message.split(": expected an image file, ")[0]
    assert place == where if where else place in (str(path), path.name)
    # the file is named whatever stands first, unless the file is there and its name does
    assert path.name in message or where


def test_only_errors_of_the_file_are_turned(tmp_path):
    path = tmp_path / "a"
    path.write_bytes(b"x")
    with pytest.raises(KeyError), reading(path, "a file"):
        raise KeyError
    with (
        pytest.raises(InputError, match=r"expected a video, cannot read it \(Input/output error\)"),
        reading(path, "a video"),
    ):
        raise OSError(5, "Input/output error")


@given(st.binary(min_size=1, max_size=300))
def test_what_is_written_is_read(tmp_path_factory, data):
    path = tmp_path_factory.mktemp("content") / "file"
    write_bytes_atomically(path, data)
    assert read_content(path, "a file", most=len(data)) == data
    assert [entry.name for entry in path.parent.iterdir()] == ["file"]


@pytest.mark.parametrize("parse", [parsed_json, parsed_toml])
@given(content=st.binary(max_size=40) | st.text(max_size=40))
def test_tables_are_parsed_or_refused_with_their_place(parse, content):
    try:
        parse(content, "table 7")
    except InputError as error:
        assert str(error).startswith("table 7: expected ")  # noqa: PT017


def test_numbers_remember_their_digits():
    assert parsed_json("[0.10]", "a", parse_float=WrittenFloat)[0].digits == "0.10"
    assert parsed_toml("a = 0.10", "a")["a"].digits == "0.10"


def test_integers_are_those_that_toml_holds():
    assert parsed_toml("a = -9223372036854775807", "a") == {"a": -(2**63) + 1}
    with pytest.raises(InputError, match="an integer of more than 64 bits"):
        parsed_toml("a = [{b = 9223372036854775808}]", "a")
