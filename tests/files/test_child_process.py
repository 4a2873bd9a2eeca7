"""A function in a process of its own gives its answer, its sentence, or a reason why there is none."""

import os
import sys
import time

import pytest

from pipeline.camera.opencv_storage import json_from_opencv
from pipeline.errors import InputError
from pipeline.files import child_process
from pipeline.files.child_process import ChildError, called_apart
from pipeline.files.memory import available_bytes

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
    begin = time.monotonic()
    with pytest.raises(ChildError, match=r"longer than 0\.05 s"):
        called_apart(json_from_opencv, b"", seconds=0.05)
    assert time.monotonic() - begin < 5


@pytest.mark.skipif(os.name == "nt", reason="Windows limits neither")
@pytest.mark.parametrize("script", ["x = bytearray(3 << 30)", "while True: pass"])
def test_memory_and_time_of_the_child_are_limited(monkeypatch, script):
    child = child_process._CHILD.replace(
        "answer(*call)", f"import pipeline.files.child_process as c; c._limit(1.0)\n{script}"
    )
    monkeypatch.setattr(child_process, "_CHILD", child)
    with pytest.raises(ChildError):
        called_apart(json_from_opencv, b"", seconds=30)


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux limits memory")
def test_the_limit_of_memory_can_be_chosen():
    document = b"%YAML:1.0\n---\nK: [1, 2.5, abc]\n"
    assert called_apart(json_from_opencv, document, megabytes=2000) == b'{"K": [1.0, 2.5, "abc"]}'
    # not even the library can be loaded
    with pytest.raises((ChildError, InputError)):
        called_apart(json_from_opencv, document, megabytes=1)
    assert available_bytes() > 100 << 20
