"""Every file is read by one ladder of errors, each of which says what was expected, what was found, where and why."""

import re
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from oneframe.errors import InputError
from oneframe.files.content import content_named, is_content_named, read_content
from oneframe.files.numbers import WrittenFloat
from oneframe.files.tables import parsed_json, parsed_toml
from oneframe.files.writing import remove_abandoned, write_bytes_atomically, written_file


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


KILLED = """
import os, sys
from pathlib import Path
from oneframe.files.writing import written_file
with written_file(Path(sys.argv[1])) as stream:
    stream.write(b"half")
    stream.flush()
    os.kill(os.getpid(), 9)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
def test_what_a_killed_process_left_goes_and_what_a_living_one_has_stays(tmp_path):
    target = tmp_path / "poses.json"
    subprocess.run([sys.executable, "-c", KILLED, str(target)], check=False)
    (left,) = tmp_path.iterdir()
    (tmp_path / ".partial-mine").touch()
    with written_file(target) as stream:
        stream.write(b"whole")
        remove_abandoned(tmp_path)
        assert not left.exists()
        assert Path(stream.name).exists()
    assert target.read_bytes() == b"whole"
    assert sorted(path.name for path in tmp_path.iterdir()) == [".partial-mine", "poses.json"]
    # others are written by the thousand while somebody cleans up
    cleaner = "import sys\nfrom pathlib import Path\nfrom oneframe.files.writing import remove_abandoned\n"
    cleaner += "print(flush=True)\nwhile True: remove_abandoned(Path(sys.argv[1]))"
    process = subprocess.Popen([sys.executable, "-c", cleaner, str(tmp_path)], stdout=subprocess.PIPE)
    process.stdout.readline()
    try:
        for number in range(100):
            write_bytes_atomically(target, str(number).encode())
    finally:
        process.kill()
        process.wait()
    assert target.read_bytes() == b"99"


def test_names_of_content(tmp_path):
    path = content_named(tmp_path / "frame_000001.png", b"pixels")
    path.write_bytes(b"pixels")
    assert path.parent == tmp_path
    assert is_content_named(path)
    for name in ("frame_000001.png", "scan-20240131.png", "missing-0123abcd.png"):
        if not name.startswith("missing"):
            (tmp_path / name).write_bytes(b"pixels")
        assert not is_content_named(tmp_path / name)


def test_messages_show_what_a_name_holds(tmp_path):
    with pytest.raises(InputError, match=re.escape(r"c\u202egpj\x1b[31m é面.png: expected a mask")):
        read_content(tmp_path / "c\u202egpj\x1b[31m é面.png", "a mask")
