"""Every file that means harm ends in a value or in a sentence: no traceback, no crash, 5 s, 1 GB at most."""

import shutil
import zlib
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.outside.binary_bombs import binaries, pictures, png
from tests.outside.bombs import Bomb, content, texts, values
from tests.outside.victims import Victims, faults_of


def sample(bombs: Sequence[Bomb], number: int, long_form: bool) -> list[Bomb]:
    """All of them, or a number of them that is always the same."""
    if long_form:
        return list(bombs)
    return [bombs[index] for index in np.random.default_rng(16).permutation(len(bombs))[:number]]


def faults(bombs: Sequence[Bomb], folder: Path) -> list[str]:
    answers = []
    with Victims() as victims:
        for number, bomb in enumerate(bombs):
            place = folder / str(number)
            place.mkdir()
            try:
                bomb.write(place / bomb.file)
            except PermissionError:
                continue
            answers.append((bomb.name, bomb.file, victims.opened(bomb.reader, place / bomb.file)))
            shutil.rmtree(place)
    return faults_of(answers)


ALL: dict[str, tuple[Callable[[], list[Bomb]], int]] = {
    "texts": (lambda: list(texts()), 50),
    "values": (lambda: list(values()), 40),
    "binaries": (lambda: list(binaries()), 40),
    "headers of images": (lambda: list(pictures("image header")), 30),
}


@pytest.mark.parametrize("kind", ALL)
def test_bombs_end_in_a_value_or_a_sentence(tmp_path, long_form, kind):
    bombs, number = ALL[kind]
    assert faults(sample(bombs(), number, long_form), tmp_path) == []


@pytest.mark.render
def test_images_end_in_a_value_or_a_sentence_in_blender(tmp_path, long_form):
    assert faults(sample(list(pictures("image")), 25, long_form), tmp_path) == []


BUTTONS = {
    "camera": "button load_camera",
    "pose": "button load_pose",
    "mesh": "button load_surface",
    "case": "button open_case",
    "image": "button load_frame",
    "video": "button load_video_frame",
}


@pytest.mark.render
def test_buttons_report_one_sentence(tmp_path, long_form):
    bombs = [
        replace(bomb, reader=BUTTONS[bomb.reader])
        for bomb in (*texts(), *values(), *binaries(), *pictures("image"))
        if bomb.reader in BUTTONS
    ]
    assert faults(sample(bombs, 40, long_form)[:1000], tmp_path) == []


def deep(end: str) -> str:
    return "a = " + "[" * 40_000 + end


COMMANDS: dict[str, tuple[str, str | bytes, tuple[str, ...]]] = {
    "a frame that takes gigabytes": (
        "frame.png",
        png(20_000, 20_000, data=zlib.compress(bytes(9999))),
        ("render", "CASE", "--out", "OUT"),
    ),
    "a deep case": ("case.toml", deep(""), ("render", "CASE", "--out", "OUT")),
    "a frame of garbage": (
        "frame.png",
        b"\xff\xd8\xff\xe0\0\4ab\xff\xc0\0\x0b\x08\0\x30\0\x40\1\1\x11\0\xff\xda\0\x08\1\1\0\0\x3f\0"
        + b"garbage" * 99
        + b"\xff\xd9",
        ("colour", "CASE", "--out", "OUT.ply"),
    ),
    "deep landmarks": (
        "landmarks.json",
        "[" * 40_000,
        ("align", "CASE", "--landmarks", "FOLDER/landmarks.json", "--out", "OUT.toml"),
    ),
    "deep poses of a film": (
        "poses.json",
        "[" * 40_000,
        ("overlay", "CASE", "--video", "FOLDER/frame.png", "--poses", "FOLDER/poses.json", "--out", "OUT.mp4"),
    ),
    "photographs that are no names": (
        "photographs.json",
        '[{"image": 3, "cam_from_mesh": []}]',
        ("compare", "CASE", "FOLDER/photographs.json", "--out", "OUT"),
    ),
    "an endless list of poses": (
        "poses.npy",
        b"",
        ("render", "CASE", "--out", "OUT", "--poses", "/dev/zero"),
    ),
}


@pytest.mark.render
@pytest.mark.parametrize("name", COMMANDS)
def test_commands_end_with_one_line(tmp_path, write_tiny_case, run_oneframe, name):
    file, data, arguments = COMMANDS[name]
    case = write_tiny_case(tmp_path / "case")
    content(data)(case.parent / file)
    places = {"CASE": str(case), "FOLDER": str(case.parent), "OUT": str(tmp_path / "out")}
    for place, path in places.items():
        arguments = [argument.replace(place, path) for argument in arguments]
    ended = run_oneframe(*arguments)
    assert (ended.returncode, ended.stderr.count("\n")) == (2, 1), ended.stderr
    assert ended.stderr.startswith("error: ")
    assert not list(tmp_path.glob("out*"))
