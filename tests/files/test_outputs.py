"""The one rule of what may be written, without a command around it."""

import os

import pytest

from oneframe.errors import InputError, RunError
from oneframe.files.kinds import MTL, OBJ, PLY, PNG, Kind, json_object
from oneframe.files.outputs import Output, check_folder, check_outputs, companion
from oneframe.files.signature import signed

MATERIAL = b"newmtl surface\n"


def refused(outputs: list[Output], inputs: dict, message: str, error: type[Exception] = InputError) -> None:
    with pytest.raises(error, match=message):
        check_outputs(outputs, inputs)


def test_an_input_is_found_under_every_name(tmp_path):
    (tmp_path / "a").mkdir()
    frame = tmp_path / "a" / "frame.png"
    frame.write_bytes(b"\x89PNG\r\n\x1a\n")
    (tmp_path / "b").symlink_to(tmp_path / "a")
    (tmp_path / "soft.png").symlink_to(frame)
    os.link(frame, tmp_path / "hard.png")
    names = [frame, tmp_path / "b" / "frame.png", tmp_path / "soft.png", tmp_path / "hard.png"]
    for name in (*names, tmp_path / "a" / ".." / "a" / "frame.png"):
        refused([Output(name, PNG)], {"frame": frame}, "found the frame")
        # the input may be named by a link as well
        refused([Output(frame, PNG)], {"frame": name}, "found the frame")
    # an input that does not exist yet
    refused([Output(tmp_path / "b" / "new.png", PNG)], {"frame": tmp_path / "a" / "new.png"}, "found the frame")


def test_a_named_file_replaces_its_own_kind_and_a_companion_only_what_was_written_here(tmp_path):
    path = tmp_path / "a.mtl"
    for content, named, beside in (
        (signed(MATERIAL), True, True),
        (MATERIAL, True, False),
        (b"v 0 0 0\n", False, False),
    ):
        path.write_bytes(content)
        for output, allowed in ((Output(path, MTL), named), (companion(path, MTL), beside)):
            if allowed:
                check_outputs([output], {})
            else:
                refused([output], {}, "expected no")
    assert [file.name for file in tmp_path.iterdir()] == ["a.mtl"]


def test_outputs_of_one_command_differ(tmp_path):
    one, other = Output(tmp_path / "a.png", PNG), Output(tmp_path / "A.PNG", PNG)
    refused([one, other], {}, "expected different names")


def test_what_is_no_file_is_refused(tmp_path):
    refused([Output(tmp_path, PNG)], {}, "Is a directory", RunError)
    os.mkfifo(tmp_path / "pipe")
    refused([Output(tmp_path / "pipe", PNG)], {}, "a device or a pipe")
    refused([Output(tmp_path / "pipe" / "x.png", PNG)], {}, "Not a directory", RunError)


def test_a_folder_with_an_input_in_it_is_refused(tmp_path):
    (tmp_path / "out" / "deep").mkdir(parents=True)
    (tmp_path / "link").symlink_to(tmp_path / "out")
    (tmp_path / "other").symlink_to(tmp_path / "out" / "deep" / "poses.npy")
    (tmp_path / "out" / "deep" / "poses.npy").touch()
    for path in (tmp_path / "out" / "deep" / "poses.npy", tmp_path / "link" / "x", tmp_path / "other"):
        for folder in (tmp_path / "out", tmp_path / "link"):
            with pytest.raises(InputError, match="found the poses in it"):
                check_folder(folder, {"poses": path})
    check_folder(tmp_path / "out" / "deep", {"frame": tmp_path / "out" / "frame.png"})


@pytest.mark.parametrize(
    ("kind", "content", "expected"),
    [
        (PNG, b"\x89PNG\r\n\x1a\nrest", True),
        (PNG, b"", True),
        (PNG, b"\xff\xd8", False),
        (PLY, b"ply\r\nformat", True),
        (PLY, b"plywood", False),
        (OBJ, b"# a comment\n\n  # another\nmtllib a.mtl\nv 0 0 0\n", True),
        (OBJ, b"# only a comment\n", False),
        (OBJ, b"version = 1\n", False),
        (MTL, b"newmtl a\n", True),
        (MTL, b"newmtla\n", False),
        (Kind("", json_object("a")), b'{"a": 1}', True),
        (Kind("", json_object("a")), b'{"b": 1}', False),
        (Kind("", json_object("a")), b"[" * 100_000, False),
    ],
    ids=lambda value: getattr(value, "name", None),
)
def test_kinds_are_told_by_content(tmp_path, kind, content, expected):
    (tmp_path / "file").write_bytes(content)
    assert kind.is_of(tmp_path / "file") is expected
