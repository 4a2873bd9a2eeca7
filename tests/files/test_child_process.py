"""A function in a process of its own gives its answer, its sentence, or a reason why there is none."""

import os
import sys
import textwrap
import time

import pytest

from oneframe.camera.opencv_storage import json_from_opencv
from oneframe.errors import InputError
from oneframe.files import child_process
from oneframe.files.child_process import ChildError, called_apart, streamed_apart
from oneframe.files.machine import available_bytes

DEEP = b"%YAML:1.0\n---\nK: " + b"[" * 400_000


def test_answers_and_sentences_come_back():
    assert called_apart(json_from_opencv, b"%YAML:1.0\n---\nK: [1, 2.5, abc]\n") == b'{"K": [1.0, 2.5, "abc"]}'
    with pytest.raises(InputError, match=r"^.+$"):
        called_apart(json_from_opencv, b"%YAML:1.0\n---\nK: [1, 2\n")


def test_a_parser_that_crashes_crashes_its_own_process_only():
    """OpenCV's parser overflows its stack: a segmentation fault."""
    with pytest.raises(ChildError, match="crashes its parser"):
        called_apart(json_from_opencv, DEEP)


def test_a_process_that_takes_too_long_is_stopped():
    with pytest.raises(ChildError, match=r"longer than 0\.05 s"):
        called_apart(json_from_opencv, b"", seconds=0.05)


@pytest.mark.skipif(os.name == "nt", reason="Windows limits neither")
@pytest.mark.parametrize("script", ["x = bytearray(3 << 30)", "while True: pass"])
def test_memory_and_time_of_the_child_are_limited(monkeypatch, script):
    child = child_process._CHILD.replace(
        "answer(*call)", f"import oneframe.files.child_process as c; c._limit(1.0)\n{script}"
    )
    monkeypatch.setattr(child_process, "_CHILD", child)
    with pytest.raises(ChildError):
        called_apart(json_from_opencv, b"", seconds=600)


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux limits memory")
def test_the_limit_of_memory_can_be_chosen():
    document = b"%YAML:1.0\n---\nK: [1, 2.5, abc]\n"
    assert called_apart(json_from_opencv, document, megabytes=2000) == b'{"K": [1.0, 2.5, "abc"]}'
    # not even the library can be loaded
    with pytest.raises((ChildError, InputError)):
        called_apart(json_from_opencv, document, megabytes=1)
    assert available_bytes() > 100 << 20


PARTS = child_process._STREAMING_CHILD


def with_parts(monkeypatch, body: str) -> None:
    """Let the child's generator be this code, whatever is called."""
    answer = "import oneframe.files.child_process as c, types, sys\n"
    answer += f"def parts(*_):\n{textwrap.indent(body, '    ')}\n"
    answer += "sys.modules['made'] = types.SimpleNamespace(parts=parts)\nc.answer_in_parts('made', 'parts', [])"
    monkeypatch.setattr(child_process, "_STREAMING_CHILD", PARTS.replace("answer_in_parts(*call)", answer))


def test_parts_come_in_order_as_they_are(monkeypatch):
    with_parts(monkeypatch, "for n in range(50): yield bytes([n]) * n")
    parts = streamed_apart(json_from_opencv, most_bytes=100)
    assert list(parts) == [bytes([n]) * n for n in range(50)]


@pytest.mark.parametrize(
    ("body", "message"),
    [
        ("yield b'1'; import os; os.kill(os.getpid(), 9)", "crashes its parser"),
        ("yield b'1'; yield bytes(101)", "too much time or memory"),
        ("yield b'1'; import time; time.sleep(60)", r"longer than 0\.5 s"),
        pytest.param(
            "yield b'1'; yield bytearray(3 << 30)[:1]",
            "too much time or memory",
            marks=pytest.mark.skipif(not sys.platform.startswith("linux"), reason="only Linux limits memory"),
        ),
    ],
    ids=["crash", "length", "time", "memory"],
)
def test_a_stream_that_fails_says_why_after_its_good_parts(monkeypatch, body, message):
    with_parts(monkeypatch, body)
    parts = streamed_apart(json_from_opencv, most_bytes=100, seconds=0.5 if "sleep" in body else 600)
    assert next(parts) == b"1"
    with pytest.raises(ChildError, match=message):
        next(parts)


def test_the_time_of_the_reader_does_not_count(monkeypatch):
    with_parts(monkeypatch, "yield b'1'\nyield b'2'")
    parts = streamed_apart(json_from_opencv, most_bytes=100, seconds=1.0)
    assert next(parts) == b"1"
    time.sleep(1.5)
    assert next(parts) == b"2"


def test_a_stream_that_is_closed_ends_its_process(monkeypatch):
    with_parts(monkeypatch, "import os\nwhile True: yield str(os.getpid()).encode()")
    parts = streamed_apart(json_from_opencv, most_bytes=100)
    child = int(next(parts))
    parts.close()
    with pytest.raises(ProcessLookupError):
        os.kill(child, 0)
