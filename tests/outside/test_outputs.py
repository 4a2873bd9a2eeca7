"""Outputs where they cannot or must not be: inputs and other folders stay, and every failure is a sentence.

Most command lines run in one process, one after the other: only what concerns a whole process (streams, signals,
limits) starts its own.
"""

import hashlib
import json
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from oneframe.camera.pinhole import PinholeCamera
from oneframe.case.landmarks import Landmark, read_landmarks
from oneframe.commands.__main__ import COMMANDS
from tests.landmark_writer import write_landmarks
from tests.light.test_find_lamp import LAMP, lit_by
from tests.scripts.test_light import written as registered_frames
from tests.waiting import children, is_alive, wait_until

ROOT = Path(__file__).resolve().parents[2]
PROGRAM = [sys.executable, "-m", "oneframe.commands"]
POSE = [[1, 0, 0, -12], [0, -1, 0, -7], [0, 0, -1, 340], [0, 0, 0, 1]]
RUN_ALL = """
import json, sys
from oneframe.process.command_line import exit_code
from oneframe.commands.__main__ import dispatch
for line in open(sys.argv[1]):
    sys.stderr.write(f"code {exit_code(dispatch, json.loads(line))}\\n")
    sys.stderr.flush()
"""

CommandLine = tuple[object, ...]


def hashes(*roots: Path) -> dict[str, str]:
    files = [path for root in roots for path in sorted(root.rglob("*")) if path.is_file()]
    return {str(path): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


@pytest.fixture
def case(tmp_path, write_tiny_case) -> Path:
    """A case with every kind of input, in a folder of its own."""
    path = write_tiny_case(tmp_path / "case")
    folder = path.parent
    (folder / "nerve.ply").write_bytes((folder / "surface.ply").read_bytes())
    text = path.read_text() + '[[structures]]\nname = "nerve"\nmesh = "nerve.ply"\n'
    rng = np.random.default_rng(1)
    camera = PinholeCamera(64, 48, 320.0, 318.0, 30.0, 25.5)
    points = rng.uniform([-25, -20, -3], [25, 20, 3], (8, 3)) + np.array([12, -7, 40])
    pixels = camera.project(points @ np.array(POSE)[:3, :3].T + np.array(POSE)[:3, 3])
    marks = [Landmark(f"p{i}", tuple(p), tuple(q)) for i, (p, q) in enumerate(zip(points, pixels, strict=True))]
    write_landmarks(folder / "landmarks.csv", marks)
    write_landmarks(folder / "landmarks.json", marks)
    (folder / "photo.png").write_bytes((folder / "frame.png").read_bytes())
    listed = [{"image": name, "cam_from_mesh": POSE} for name in ("photo.png", "frame.png")]
    (folder / "held_out.json").write_text(json.dumps(listed))
    path.write_text(text)
    return path


@pytest.fixture
def run_all(tmp_path, run_command) -> Callable[[list[CommandLine]], list[tuple[int, str]]]:
    """Runs command lines one after the other in one process; exit code and standard error of each."""

    def run(lines: list[CommandLine]) -> list[tuple[int, str]]:
        listed = tmp_path / "lines.txt"
        listed.write_text("".join(json.dumps(list(map(str, line))) + "\n" for line in lines))
        ended = run_command([sys.executable, "-c", RUN_ALL, str(listed)])
        listed.unlink()
        results, errors = [], ""
        for line in ended.stderr.splitlines(keepends=True):
            if line.startswith("code "):
                results.append((int(line.split()[1]), errors))
                errors = ""
            else:
                errors += line
        assert len(results) == len(lines), ended.stderr
        return results

    return run


def new_case(case: Path, out: Path) -> CommandLine:
    folder = case.parent
    return "case", "--surface", folder / "surface.ply", "--frame", folder / "frame.png", "--camera", case, "--out", out


def assert_sentence(code: int, errors: str, line: CommandLine) -> None:
    assert code in (2, 3), (line, errors)
    assert errors.startswith("error: "), (line, errors)
    assert errors.count("\n") == 1, (line, errors)


OWN_NAMES = {
    "register": "frame_000001-0123abcd.png", "evaluate": "figure.png",
    "surface": "surface.ply", "frames": "a_frame_000001.png",
}  # fmt: skip
"""A name that each command gives in a folder whose files it replaces."""


def lines_of(case: Path, lit: Path, dataset: Path) -> dict[str, tuple[CommandLine, list[Path]]]:
    """Of every command that writes a line without ``--out``, and what it reads."""
    own = [case, *(case.parent / name for name in ("frame.png", "surface.ply", "nerve.ply"))]
    landmarks, photographs, photograph, registered = (
        case.parent / name for name in ("landmarks.json", "held_out.json", "photo.png", "poses.toml")
    )
    # a list of registered frames called like what the command writes
    registered.write_bytes((lit / "registered" / "poses.json").read_bytes().replace(b"../frames", b"../lit/frames"))
    return {
        "sample": (("sample",), own[:1]),
        "surface": (("surface", photograph, "--labels", own[1]), [photograph, own[1]]),
        "frames": (("frames", photograph), [photograph]),
        "case": (new_case(case, case)[:-2], own[1:3]),
        "align": (("align", case, "--landmarks", landmarks), [*own, landmarks]),
        "overlay": (("overlay", case), own),
        "register": (("register", case, case.parent), [*own, photograph]),
        "light": (("light", lit / "case.toml", registered), [lit / "case.toml", lit / "surface.ply", registered]),
        "render": (("render", case, "--count", "1"), own),
        "colour": (("colour", case), own),
        "evaluate": (("evaluate", case, photographs), [*own, photographs, photograph]),
        "report": (("report", dataset, "--no-check"), [dataset / "dataset.json"]),
        "train": (("train", dataset), [dataset / "dataset.json"]),
        "pack": (("pack", dataset), [dataset / "dataset.json"]),
    }


@pytest.mark.render
def test_no_command_replaces_an_input(case, tmp_path, run_all, ray_cast_dataset):
    """Each file that a command reads as its output: by its name, by links, and as its folder; all files stay."""
    shutil.copytree(ray_cast_dataset, tmp_path / "dataset")
    (tmp_path / "lit").mkdir()
    registered_frames(tmp_path / "lit", lit_by(LAMP))
    commands, lines = lines_of(case, tmp_path / "lit", tmp_path / "dataset"), list[CommandLine]()
    assert commands.keys() | {"check"} == set(COMMANDS)
    for command, (line, inputs) in commands.items():
        for number, path in enumerate(inputs):
            place = tmp_path / f"{command} {number}"
            place.mkdir()
            (tmp_path / f"way to {place.name}").symlink_to(path.parent)
            os.link(path, hard := place / OWN_NAMES.get(command, path.name))
            link = tmp_path / f"way to {place.name}"
            lines += [(*line, "--out", out) for out in (path, path.parent, link / path.name, link, hard, place)]
    before = hashes(tmp_path)
    for line, (code, errors) in zip(lines, run_all(lines), strict=True):
        assert_sentence(code, errors, line)
        assert hashes(tmp_path) == before, line


@pytest.mark.render
def test_own_outputs_are_replaced_and_no_folder_with_something_else(case, tmp_path, run_all):
    out = tmp_path / "out"
    photographs = case.parent / "held_out.json"
    landmarks = ("--landmarks", case.parent / "landmarks.csv", "--click-sigma-px", "0.1")
    lines: list[CommandLine] = [
        *(("colour", case, "--out", out / name) for name in ("a.obj", "b.ply", "c.glb")),
        ("align", case, *landmarks, "--out", out / "aligned.toml"),
        new_case(case, out / "case"),
    ]
    folders: list[CommandLine] = [
        ("evaluate", case, photographs, "--out", out / "evaluation", "--methods", "paper-cycles"),
    ]
    results = run_all([*lines, *folders, *lines, *folders])
    assert [code for code, _ in results] == [0] * 2 * len([*lines, *folders]), results
    (out / "evaluation" / "mine.txt").touch()
    (out / "case" / "case.toml").write_text((out / "case" / "case.toml").read_text() + "# aligned by hand\n")
    before = hashes(out)
    refused = [*folders, ("sample", "--out", out / "evaluation"), ("sample", "--out", out / "case"), lines[-1]]
    for line, (code, errors) in zip(refused, run_all(refused), strict=True):
        assert_sentence(code, errors, line)
        assert "found mine.txt" in errors or line not in folders
    assert hashes(out) == before


# --- the process ----------------------------------------------------------------------------------------------------


FAILING = {
    "surface": "surface /no/ct.nii.gz --out /no/out", "sample": "sample --out /dev/null/x",
    "frames": "frames /no/video.mp4 --out /no/out",
    "case": "case --surface /no/surface --frame /no/frame.png --camera /no/k.json --out /no/out",
    "align": "align /no/case.toml",
    "overlay": "overlay /no/case.toml --out /no/overlay.png",
    "register": "register /no/case.toml /no/frames --out /no/out",
    "light": "light /no/case.toml /no/registered",
    "render": "render /no/case.toml --out /no/out", "check": "check /no/dataset",
    "pack": "pack /no/dataset --out /no/packed", "train": "train /no/dataset --out /no/network.onnx",
    "report": "report /no/dataset --out /no/report.html",
    "evaluate": "evaluate /no/case.toml /no/list.json --out /no/out",
    "colour": "colour /no/case.toml --out /no/surface.ply",
}  # fmt: skip
"""Command lines that fail soon."""


def test_every_command_fails_with_a_sentence(run_all):
    lines = [tuple(FAILING[name].split()) for name in COMMANDS]
    for line, (code, errors) in zip(lines, run_all(lines), strict=True):
        assert_sentence(code, errors, line)


@pytest.mark.render
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_signals_end_a_command_with_a_sentence_and_without_leavings(case, tmp_path, number):
    if signal.getsignal(number) == signal.SIG_IGN:
        pytest.skip(f"this run ignores {number.name}, as under nohup, and so do its commands")
    temporary, out = tmp_path / "tmp", tmp_path / "out"
    temporary.mkdir()
    line = ["render", case, "--out", out, "--count", "5000", "--workers", "2", "--progress-seconds", "0.1"]
    process = subprocess.Popen(
        [*PROGRAM, *map(str, line)], cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        env=os.environ | {"TMPDIR": str(temporary)}, start_new_session=True,
    )  # fmt: skip
    for _ in range(3):
        process.stdout.readline()
    assert process.poll() is None
    assert list(temporary.iterdir())
    workers = children(process.pid)
    process.send_signal(number)
    _, errors = process.communicate()
    assert process.returncode == 128 + number, errors
    assert errors.startswith("error: stopped" + ("" if number == signal.SIGINT else f" by {number.name}")), errors
    assert errors.count("\n") == 1
    # workers end when their input does
    wait_until(lambda: not any(map(is_alive, workers)))
    assert not list(temporary.iterdir())
    assert not list(out.rglob(".partial-*"))


@pytest.mark.render
def test_temporary_files_of_a_killed_command_go_with_the_next_one(case, tmp_path, run_command):
    temporary = tmp_path / "tmp"
    temporary.mkdir()
    line = [*PROGRAM, "render", str(case), "--out", str(tmp_path / "out"), "--count", "5000", "--workers", "1"]
    process = subprocess.Popen(
        line, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, env=os.environ | {"TMPDIR": str(temporary)}
    )
    process.stdout.readline()
    (left,) = temporary.iterdir()
    another = [*PROGRAM, "check", str(tmp_path)]
    run_command(another, TMPDIR=str(temporary))
    assert left.exists(), "of a command that still runs"
    process.kill()
    process.communicate()
    (temporary / "oneframe-mine").mkdir()
    (temporary / "oneframe-mine" / ".lock").touch()
    run_command(another, TMPDIR=str(temporary))
    assert [path.name for path in temporary.iterdir()] == ["oneframe-mine"]


# --- the add-on -----------------------------------------------------------------------------------------------------


@pytest.mark.render
def test_saving_a_case_replaces_no_other_input(addon, case):
    import bpy

    folder = case.parent
    bpy.ops.oneframe.open_case(filepath=str(case))
    bpy.ops.oneframe.import_landmarks(filepath=str(folder / "landmarks.csv"))
    before = hashes(folder)
    for name in ("frame.png", "surface.ply", "nerve.ply"):
        with pytest.raises(RuntimeError):
            bpy.ops.oneframe.save_case(filepath=str(folder / name))
        assert hashes(folder).items() >= before.items(), name
    bpy.ops.oneframe.save_case(filepath=str(case))
    assert len(read_landmarks(folder / "landmarks.csv")) == 8
