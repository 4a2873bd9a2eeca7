"""Outputs where they cannot or must not be: inputs and foreign files stay, and every failure is a sentence.

Most command lines run in one process, one after the other: only what concerns a whole process (streams, signals,
limits) starts its own.
"""

import contextlib
import csv
import hashlib
import itertools
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest

from oneframe.camera.pinhole import PinholeCamera
from oneframe.case.landmark_file import read_landmarks, write_landmarks
from oneframe.case.landmarks import Landmark
from oneframe.commands.__main__ import COMMANDS
from oneframe.images.png import encode_png

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
    """A case with every kind of input, in a folder of its own; one file of each output's kind that is no input."""
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
    np.save(folder / "poses.npy", np.array([POSE], float))
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


def writing_commands(case: Path, target: Path) -> Iterator[CommandLine]:
    """Every command that writes files, told to write ``target`` itself or beside another output."""
    folder = case.parent
    yield "colour", case, "--out", target
    yield "colour", case, "--out", target, "--colour", "vertex"
    for suffix in (".obj", ".ply"):
        yield "colour", case, "--out", target.with_suffix(suffix)
    for option in ("--json", "--picture", "--out"):
        yield "align", case, "--landmarks", folder / "landmarks.csv", option, target
    if "photo" not in target.name:
        # photographs are inputs of compare and evaluate only, and a picture may replace a picture
        yield "overlay", case, "--out", target
    yield "compare", case, folder / "held_out.json", "--out", target
    yield "evaluate", case, folder / "held_out.json", "--out", target, "--methods", "paper-cycles"
    yield "sample", "--out", target
    yield new_case(case, target)
    yield "render", case, "--out", target, "--count", "1"


def new_case(case: Path, out: Path) -> CommandLine:
    folder = case.parent
    return "case", "--surface", folder / "surface.ply", "--frame", folder / "frame.png", "--camera", case, "--out", out


def assert_sentence(code: int, errors: str, line: CommandLine) -> None:
    assert code in (2, 3), (line, errors)
    assert errors.startswith("error: "), (line, errors)
    assert errors.count("\n") == 1, (line, errors)


def spellings(path: Path, folder: Path) -> Iterator[Path]:
    """Other names of a file: through a folder and back, symbolic and hard links, a linked folder."""
    yield path
    yield path.parent / ".." / path.parent.name / path.name
    yield Path(os.path.relpath(path, ROOT))
    links = folder / "links"
    links.mkdir(exist_ok=True)
    for kind, link in (("soft", os.symlink), ("hard", os.link)):
        name = links / f"{kind}-{path.name}"
        if not name.exists():
            link(path, name)
        yield name
    if not (folder / "way").exists():
        (folder / "way").symlink_to(path.parent)
    yield folder / "way" / path.name


def makes_a_new_surface(line: CommandLine, pictures: set[str]) -> bool:
    """Whether a command colours a surface in a new file, beside no file that its texture would replace."""
    path = Path(str(line[3])) if line[0] == "colour" else Path()
    return path.suffix in (".obj", ".ply") and not path.exists() and path.stem not in pictures


@pytest.mark.render
def test_no_command_replaces_an_input(case, tmp_path, run_all, long_form):
    """Each input as the name of each output, of each file beside it, and in each folder."""
    folder, before = case.parent, hashes(case.parent)
    names = sorted(folder.iterdir())
    targets = [other for path in names for other in (spellings(path, tmp_path) if long_form else [path])]
    if not long_form:
        targets += [*spellings(folder / "frame.png", tmp_path), *spellings(case, tmp_path)][1:]
    lines = [line for target in targets for line in writing_commands(case, target)]
    # of landmarks.csv and poses.npy some commands may make landmarks.ply, but nothing may be lost
    taken = {path.stem for path in targets if path.suffix == ".png"}
    lines = [line for line in lines if not makes_a_new_surface(line, taken)]
    for place in (folder, tmp_path / "way"):
        lines += [("sample", "--out", place), new_case(case, place)]
        lines.append(("render", case, "--out", place, "--count", "1"))
    lines.append(("render", case, "--out", folder, "--poses", folder / "poses.npy"))
    lines.append(("render", case, "--out", tmp_path, "--count", "1"))
    for line, (code, errors) in zip(lines, run_all(lines), strict=True):
        assert_sentence(code, errors, line)
    assert hashes(folder) == before


def foreign_files(folder: Path) -> Iterator[Path]:
    """Files of the user's that are no output of this program, by the names of its outputs."""
    folder.mkdir()
    contents = {
        "a.glb": b"not a model", "a.ply": b"solid stl", "b.ply": b"ply\nformat ascii 1.0\nend_header\n",
        "b.png": b"\xff\xd8 a JPEG", "c.obj": b"\x7fELF", "d.mtl": b"newmtl mine\n",
        "e.png": encode_png(np.zeros((2, 2), np.uint8)), "p.png": b"GIF89a",
        "pose.json": b'{"name": "package"}', "list.json": b"[1, 2]", "a.toml": b"[project]\nname = 'mine'\n",
    }  # fmt: skip
    for name, data in contents.items():
        (folder / name).write_bytes(data)
        yield folder / name


@pytest.mark.render
def test_no_command_replaces_a_file_of_another_kind(case, tmp_path, run_all):
    folder = tmp_path / "mine"
    lines: list[CommandLine] = []
    for path in foreign_files(folder):
        if path.suffix in (".glb", ".obj") or path.name == "a.ply":
            lines.append(("colour", case, "--out", path))
        elif path.suffix in (".png", ".mtl"):
            # a texture or a material beside the named file
            lines.append(("colour", case, "--out", path.with_suffix(".obj")))
        if path.name in ("b.png", "p.png", "a.glb"):
            lines.append(("overlay", case, "--out", path))
        options = {".json": "--json", ".toml": "--out", ".png": "--picture"}
        if path.suffix in options and path.name != "e.png":
            lines.append(("align", case, "--landmarks", case.parent / "landmarks.csv", options[path.suffix], path))
    sheet = tmp_path / "sheet"
    sheet.mkdir()
    for name in ("sheet.png", "photo.png"):
        (sheet / name).write_bytes(encode_png(np.ones((2, 2), np.uint8)))
    (sheet / "likeness.csv").write_text("name,value\n")
    lines.append(("compare", case, case.parent / "held_out.json", "--out", sheet))
    sample = tmp_path / "sample"
    sample.mkdir()
    (sample / "case.toml").write_bytes(case.read_bytes())
    lines += [("sample", "--out", sample), new_case(case, sample), ("render", case, "--out", sample, "--count", "1")]
    before = hashes(folder, sheet, sample)
    for line, (code, errors) in zip(lines, run_all(lines), strict=True):
        assert_sentence(code, errors, line)
        assert code == 2 or line[0] == "render", (line, errors)
    assert hashes(folder, sheet, sample) == before


@pytest.mark.render
def test_own_outputs_are_replaced_until_somebody_changes_them(case, tmp_path, run_all):
    out = tmp_path / "out"
    landmarks = ("--landmarks", case.parent / "landmarks.csv", "--click-sigma-px", "0.1", "--json", out / "pose.json")
    lines: list[CommandLine] = [
        *(("colour", case, "--out", out / name) for name in ("a.obj", "b.ply", "c.glb")),
        ("align", case, *landmarks, "--out", out / "aligned.toml", "--picture", out / "picture.png"),
        ("compare", case, case.parent / "held_out.json", "--out", out / "comparison"),
        new_case(case, out / "case"),
    ]
    results = run_all([*lines, *lines])
    assert [code for code, _ in results] == [0] * 2 * len(lines), results
    for name in ("a.png", "a.mtl", "b.png", "comparison/sheet.png", "comparison/photograph_1.png", "case/frame.png"):
        path = out / name
        data = bytearray(path.read_bytes())
        data[len(data) // 3] ^= 1
        path.write_bytes(data)
    before = hashes(out)
    for line, (code, errors) in zip(lines, run_all(lines), strict=True):
        if line[0] == "align" or "c.glb" in str(line[-1]):
            assert code == 0
        else:
            assert_sentence(code, errors, line)
            assert "changed" in errors
    unchanged = {path: digest for path, digest in before.items() if "c.glb" not in path}
    assert {path: hashes(out)[path] for path in unchanged} == unchanged


@pytest.mark.render
def test_photographs_of_one_name_get_pictures_of_their_own(case, tmp_path, run_all):
    """And names that a spreadsheet, a shell or a terminal would misread stay one cell and one line."""
    folder, out = case.parent, tmp_path / "out"
    names = ["a/x.png", "b/x.png", "b/X.png", "sheet.png", "likeness.csv.png", "=1+1.png", "ä.png"]
    names.append('new\nline, "quoted".png')
    for name in names:
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_bytes((folder / "frame.png").read_bytes())
    listed = folder / "many.json"
    listed.write_text(json.dumps([{"image": name, "cam_from_mesh": POSE} for name in names]))
    before = hashes(folder)
    ((code, errors),) = run_all([("compare", case, listed, "--out", out)])
    assert (code, errors) == (0, "")
    assert hashes(folder) == before
    text = (out / "likeness.csv").read_text()
    assert len(text.splitlines()) == 1 + len(names)
    rows = list(csv.DictReader(text.splitlines()))
    assert len({row["picture"].casefold() for row in rows}) == len(names)
    pictures = {row["picture"].removeprefix("./") for row in rows}
    assert pictures | {"likeness.csv", "sheet.png"} == {path.name for path in out.iterdir()}
    assert len(list(out.iterdir())) == len(names) + 2
    assert not [row for row in rows if row["image"][0] in "=+-@"]


UNWRITABLE = {
    "a file as a folder": lambda folder: folder / "frame.png" / "x",
    "a name that is too long": lambda folder: folder / ("n" * 252),
    "a folder that is too long": lambda folder: folder / ("n" * 300) / "x",
    "no permission": lambda folder: Path("/proc/x"),
    "nobody's permission": lambda folder: Path("/sys/kernel/x"),
    "a full device": lambda folder: Path("/dev/full"),
    "a folder": lambda folder: folder / "folder",
}


@pytest.fixture
def recordings(tmp_path) -> dict[str, Path]:
    """A CT with labels and a plan of a drill, and a film: in one folder, by names of outputs as far as can be."""
    nibabel = pytest.importorskip("nibabel")
    folder = tmp_path / "recordings"
    (folder / "structures").mkdir(parents=True)
    z, y, x = np.indices((24, 24, 24)) - 11.5
    bone = np.clip(1000 * (9 - np.sqrt(x * x + y * y + z * z)), -1000, 1500)
    inside = (x - 3) ** 2 + y * y + z * z < 6
    made = {"ct": folder / "ct.nii", "labels": folder / "labels.nii", "plan": folder / "surface.json"}
    for name, values in (("ct", bone.astype(np.int16)), ("labels", inside.astype(np.uint8))):
        nibabel.save(nibabel.Nifti1Image(values.T, np.diag([-1, -1, 1, 1.0])), made[name])
    made["plan"].write_text("[[strokes]]\nradius_mm = 2.0\npoints_mm = [[-1, 0, 10], [1, 0, 12]]\n")
    made["film"] = folder / "scores.csv"
    writer = cv2.VideoWriter(str(folder / "film.avi"), cv2.VideoWriter_fourcc(*"MJPG"), 25.0, (64, 48))
    picture = np.random.default_rng(2).integers(0, 256, (48, 64, 3)).astype(np.uint8)
    for _ in range(40):
        writer.write(picture)
    writer.release()
    (folder / "film.avi").rename(made["film"])
    return made


def recording_commands(made: dict[str, Path], out: Path) -> list[CommandLine]:
    return [
        ("surface", made["ct"], "--labels", made["labels"], "--drill", made["plan"], "--out", out),
        ("surface", made["ct"], "--remove", made["labels"], "--out", out),
        ("frames", made["film"], "--out", out),
    ]


def test_recordings_are_not_replaced_and_own_outputs_are(recordings, tmp_path, run_all):
    folder, out = recordings["ct"].parent, tmp_path / "out"
    good = recording_commands(recordings, out)
    results = run_all([*good, *good])
    assert [code for code, _ in results] == [0] * len(results), results
    assert {"surface.ply", "surface.json", "slices.png", "scores.csv"} <= {path.name for path in out.iterdir()}
    before, (drilled, removed, film) = hashes(folder), recording_commands(recordings, folder)
    bad: list[CommandLine] = [drilled, film, *recording_commands(recordings, Path("/dev/full"))]
    bad += [line for path in recordings.values() for line in recording_commands(recordings, path)]
    bad += recording_commands(recordings, folder / ("n" * 300)) + recording_commands(recordings, Path("/proc/x"))
    # the plan, which is no input of this one, is no report of ours either
    bad.append(removed)
    for line, (code, errors) in zip(bad, run_all(bad), strict=True):
        assert_sentence(code, errors, line)
    assert hashes(folder) == before
    for name in ("surface.ply", "surface.json", "slices.png", "scores.csv", "contact_sheet.png"):
        (out / name).write_bytes(b"mine")
    before = hashes(out)
    for line, (code, errors) in zip(good, run_all(good), strict=True):
        assert_sentence(code, errors, line)
    assert hashes(out) == before


@pytest.mark.render
@pytest.mark.skipif(sys.platform != "linux", reason="folders of Linux in which nobody can write")
def test_what_cannot_be_written_is_one_sentence(case, run_all):
    folder, lines = case.parent, []
    for kind, place in UNWRITABLE.items():
        path = place(folder)
        device = kind == "a full device"
        for command, option, suffix in (
            ("colour", "--out", ".obj"), ("colour", "--out", ".glb"), ("align", "--json", ".json"),
            ("align", "--picture", ".png"), ("align", "--out", ".toml"), ("overlay", "--out", ".png"),
        ):  # fmt: skip
            name = path if device else path.with_name(path.name + suffix)
            if kind == "a folder":
                name.mkdir(exist_ok=True)
            given = ("--landmarks", folder / "landmarks.csv") if command == "align" else ()
            lines.append((command, case, *given, option, name))
        if kind not in ("a folder", "a name that is too long"):
            lines += [
                ("sample", "--out", path),
                new_case(case, path),
                ("compare", case, folder / "held_out.json", "--out", path),
            ]
            lines.append(("render", case, "--out", path, "--count", "1"))
    before = hashes(folder)
    for line, (code, errors) in zip(lines, run_all(lines), strict=True):
        assert_sentence(code, errors, line)
    assert hashes(folder) == before
    assert Path("/dev/full").is_char_device()


# --- the process ----------------------------------------------------------------------------------------------------


def shell(text: str, **environment: str) -> subprocess.CompletedProcess:
    """Run a line of shell, in which ``$RUN`` is the program."""
    plain = {name: value for name, value in os.environ.items() if name != "PYTHONUNBUFFERED"}
    return subprocess.run(
        ["bash", "-c", text], capture_output=True, text=True, check=False, cwd=ROOT,
        env=plain | {"RUN": " ".join(PROGRAM), "PYTHONPATH": str(ROOT)} | environment,
    )  # fmt: skip


FAILING = {
    "surface": "surface /no/ct.nii.gz --out /no/out", "sample": "sample --out /dev/null/x",
    "frames": "frames /no/video.mp4 --out /no/out",
    "case": "case --surface /no/surface --frame /no/frame.png --camera /no/k.json --out /no/out",
    "align": "align /no/case.toml",
    "overlay": "overlay /no/case.toml --out /no/overlay.png",
    "render": "render /no/case.toml --out /no/out", "check": "check /no/dataset",
    "pack": "pack /no/dataset --out /no/packed",
    "report": "report /no/dataset --out /no/report.html",
    "compare": "compare /no/case.toml /no/list.json --out /no/out",
    "evaluate": "evaluate /no/case.toml /no/list.json --out /no/out",
    "colour": "colour /no/case.toml --out /no/surface.ply",
}  # fmt: skip
"""Command lines that fail soon."""


def test_every_command_fails_here():
    assert FAILING.keys() == set(COMMANDS)


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_fails_with_a_sentence(name, tmp_path):
    ended = shell(f"$RUN {FAILING[name]} >&-", TMPDIR=str(tmp_path))
    assert_sentence(ended.returncode, ended.stderr, (name,))
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("streams", [">/dev/full", "<&- >&- 2>&-"])
def test_help_in_closed_and_full_streams(streams, tmp_path):
    ended = shell(f"set -o pipefail; $RUN --help {streams}", TMPDIR=str(tmp_path))
    assert ended.returncode == (3 if "full" in streams else 0)
    assert ended.stderr == (
        "error: the standard output: cannot write to it (No space left on device); choose another place\n"
        if "full" in streams
        else ""
    )


@pytest.mark.render
@pytest.mark.parametrize("streams", [">&-", ">/dev/full", "| true"])
def test_a_command_whose_messages_nobody_gets(case, tmp_path, streams):
    out = tmp_path / "out.ply"
    ended = shell(f"set -o pipefail; $RUN colour {case} --out {out} {streams}")
    if streams == ">&-":
        assert (ended.returncode, ended.stderr) == (0, "")
    else:
        assert_sentence(ended.returncode, ended.stderr, (streams,))
        assert "the standard output: cannot write to it" in ended.stderr
    # a file that Blender opened has not got the messages
    assert out.read_bytes().startswith(b"ply\n")


@pytest.mark.parametrize("arguments", ["--help", "render --help"])
def test_without_docstrings(arguments):
    plain, bare = shell(f"$RUN {arguments}"), shell(f"{sys.executable} -OO -m oneframe.commands {arguments}")
    assert (bare.returncode, bare.stderr) == (0, "")
    assert bare.stdout == plain.stdout


@pytest.mark.render
def test_temporary_folders_with_strange_names(case, tmp_path, run_command):
    """Braces are a template to Blender, and two slashes the folder of its file."""
    strange = tmp_path / "a {x} # <T>"
    strange.mkdir()
    for number, folder in enumerate((strange, f"/{strange}", tmp_path / "none")):
        out = tmp_path / f"out {{{number}}}"
        arguments = ["render", case, "--out", out, "--count", "1", "--workers", "1", "--video", "--video-frames", "2"]
        ended = run_command([sys.executable, "-OO", *PROGRAM[1:], *map(str, arguments)], TMPDIR=str(folder))
        assert (ended.returncode, ended.stderr) == (0, "")
        glb = out / "surface.glb"
        ended = run_command([*PROGRAM, "colour", str(case), "--out", str(glb)], TMPDIR=str(folder))
        assert (ended.returncode, ended.stderr) == (0, "")
        assert (out / "video" / "trajectory.mp4").stat().st_size > 1000
    assert not list(strange.iterdir())
    assert not (tmp_path / "none").exists()


def mounted(folder: Path, size: str, command: str) -> str:
    """A line of shell that runs a command with a small disk on ``folder``."""
    fill = "head -c {} /dev/zero > {}/filler"
    inner = f"mount -t tmpfs -o size={size} none {folder} && {fill.format('64k', folder)} && {command}"
    root = "" if os.geteuid() == 0 else "--map-root-user "
    return f"unshare {root}--mount bash -c '{inner}'"


def small_disks_work(folder: Path) -> bool:
    return sys.platform == "linux" and shell(mounted(folder, "100k", "true")).returncode == 0


@pytest.mark.render
@pytest.mark.parametrize("what", ["colour --out {out}/a.glb", "colour --out {out}/a.obj", "compare {list} --out {out}"])
@pytest.mark.parametrize("full", ["out", "tmp"])
def test_full_disks_are_told_apart(case, tmp_path, what, full):
    folders = {"out": tmp_path / "out", "tmp": tmp_path / "tmp"}
    for folder in folders.values():
        folder.mkdir()
    if not small_disks_work(folders["out"]):
        pytest.skip("this machine mounts no file systems for tests")
    command, *rest = what.format(out=folders["out"], list=case.parent / "held_out.json").split()
    line = f"TMPDIR={folders['tmp']} $RUN {command} {case} {' '.join(rest)}"
    # room for the folders of Blender and of the program, but not for their files
    ended = shell(mounted(folders[full], "76k", line))
    if full == "tmp" and not rest[-1].endswith(".glb"):
        assert (ended.returncode, ended.stderr) == (0, "")
        return
    assert_sentence(ended.returncode, ended.stderr, (what, full))
    assert str(folders[full]) in ended.stderr
    assert ("TMPDIR" in ended.stderr) == (full == "tmp")


@pytest.mark.render
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP, signal.SIGINT])
@pytest.mark.parametrize("command", ["render", "compare", "sample"])
def test_signals_end_a_command_with_a_sentence_and_without_leavings(case, tmp_path, number, command, long_form):
    if not long_form and (command, number) not in {("render", signal.SIGTERM), ("compare", signal.SIGHUP)}:
        pytest.skip("in the long form")
    if signal.getsignal(number) == signal.SIG_IGN:
        pytest.skip(f"this run ignores {number.name}, as under nohup, and so do its commands")
    folder, temporary = case.parent, tmp_path / "tmp"
    temporary.mkdir()
    listed = [{"image": "frame.png", "cam_from_mesh": POSE}] * 2000
    (folder / "long.json").write_text(json.dumps(listed))
    out = tmp_path / "out"
    lines = {
        "render": ["render", case, "--out", out, "--count", "5000", "--workers", "2", "--progress-seconds", "0.1"],
        "compare": ["compare", case, folder / "long.json", "--out", out],
        "sample": ["sample", "--out", out],
    }
    process = subprocess.Popen(
        [*PROGRAM, *map(str, lines[command])], cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        env=os.environ | {"TMPDIR": str(temporary)}, start_new_session=True,
    )  # fmt: skip
    for _ in range(3):
        process.stdout.readline()
    assert process.poll() is None
    assert list(temporary.iterdir())
    process.send_signal(number)
    _, errors = process.communicate()
    assert process.returncode == 128 + number, errors
    assert errors.startswith("error: stopped" + ("" if number == signal.SIGINT else f" by {number.name}")), errors
    assert errors.count("\n") == 1
    # workers end when their input does
    for _ in range(50):
        if not process_group(process.pid):
            break
        time.sleep(0.1)
    assert not process_group(process.pid)
    assert not list(temporary.iterdir())
    assert not list(out.rglob(".partial-*"))


def process_group(number: int) -> list[int]:
    """Processes of a group that still run."""
    found = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = stat.read_text().rpartition(")")[2].split()
        except OSError:
            continue
        if int(fields[2]) == number and fields[0] != "Z":
            found.append(int(stat.parent.name))
    return found


# --- the add-on -----------------------------------------------------------------------------------------------------


@pytest.mark.render
def test_no_operator_replaces_an_input(addon, case, tmp_path):
    """Each input as the file of each operator that writes; only Save Case may replace its own case file."""
    import bpy

    folder = case.parent
    bpy.ops.oneframe.open_case(filepath=str(case))
    bpy.ops.oneframe.import_landmarks(filepath=str(folder / "landmarks.csv"))
    operators = {
        "save_case": {}, "export_landmarks": {}, "save_edited_surface": {}, "export_surface": {"mode": "texture"},
        "load_video_frame": {"frame_index": 0},
    }  # fmt: skip
    inputs = [path for path in folder.iterdir() if not path.name.startswith("landmarks")]
    before = hashes(folder)
    for (name, arguments), path in itertools.product(operators.items(), inputs):
        targets = [path, *(path.with_suffix(suffix) for suffix in (".obj", ".ply") if path.suffix == ".png")]
        for target in targets if name == "export_surface" else [path]:
            if (name, target) == ("save_case", case):
                continue
            # a picture may be opened as a video of one frame, which is then saved under another name
            with contextlib.suppress(RuntimeError):
                assert getattr(bpy.ops.oneframe, name)(filepath=str(target), **arguments) == {"FINISHED"}
                assert name == "load_video_frame"
            assert hashes(folder).items() >= before.items(), (name, target)
    bpy.ops.oneframe.save_case(filepath=str(case))
    assert len(read_landmarks(folder / "landmarks.csv")) == 8
