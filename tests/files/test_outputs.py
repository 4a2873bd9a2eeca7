"""The one rule of what may be written, without a command around it."""

import os
from pathlib import Path

import pytest

from oneframe.errors import InputError, RunError
from oneframe.files.content import files_of_command
from oneframe.files.outputs import check_outputs, check_own_folder


def refused(outputs: list[Path], inputs: dict, message: str, error: type[Exception] = InputError) -> None:
    with pytest.raises(error, match=message):
        check_outputs(outputs, inputs)


def test_an_input_is_found_under_every_name_and_all_else_is_replaced(tmp_path):
    (tmp_path / "a").mkdir()
    frame = tmp_path / "a" / "frame.png"
    frame.write_bytes(b"\x89PNG\r\n\x1a\n")
    (tmp_path / "b").symlink_to(tmp_path / "a")
    (tmp_path / "soft.png").symlink_to(frame)
    os.link(frame, tmp_path / "hard.png")
    names = [frame, tmp_path / "b" / "frame.png", tmp_path / "soft.png", tmp_path / "hard.png"]
    for name in (*names, tmp_path / "a" / ".." / "a" / "frame.png"):
        refused([name], {"frame": frame}, "found the frame")
        # the input may be named by a link as well
        refused([frame], {"frame": name}, "found the frame")
        check_outputs([name], {})
    # an input that does not exist yet
    refused([tmp_path / "b" / "new.png"], {"frame": tmp_path / "a" / "new.png"}, "found the frame")


def test_outputs_of_one_command_differ(tmp_path):
    refused([tmp_path / "a.png", tmp_path / "A.PNG"], {}, "expected different names")


def test_what_is_no_file_is_refused(tmp_path):
    refused([tmp_path], {}, "Is a directory", RunError)
    (tmp_path / "file").touch()
    refused([tmp_path / "file" / "x.png"], {}, "Not a directory", RunError)


def test_a_folder_of_own_files_holds_nothing_else(tmp_path):
    names = r"view_\d+\.png|table\.csv"
    for name in ("view_1.png", "table.csv", ".hidden", "desktop.ini"):
        (tmp_path / name).touch()
        check_own_folder(tmp_path, names, {})
    check_own_folder(tmp_path / "none", names, {})
    with pytest.raises(RunError):
        check_own_folder(tmp_path / "table.csv", names, {})
    (tmp_path / "view_1.png.txt").mkdir()
    with pytest.raises(InputError, match=r"found view_1\.png\.txt in it"):
        check_own_folder(tmp_path, names, {})


@pytest.mark.skipif(os.name == "nt", reason="opens no folders")
def test_a_folder_belongs_to_one_command_until_that_ends(tmp_path):
    with files_of_command():
        check_own_folder(tmp_path / "new", "x", {})
        with files_of_command(), pytest.raises(RunError, match="new: another run writes into it"):
            check_own_folder(tmp_path / "new", "x", {})
    assert not (tmp_path / "new").exists()
