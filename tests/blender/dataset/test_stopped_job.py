"""Runs that are killed, stopped or refused lose nothing, and mix with no other dataset."""

import dataclasses
import json
import os
import shutil
import signal
import subprocess
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from oneframe.dataset.layout import ViewPaths
from oneframe.dataset.options import DatasetOptions
from oneframe.dataset.run import run_folder
from oneframe.errors import RunError
from oneframe.images.png import encode_png
from oneframe.progress import read_progress
from tests.blender.dataset.job_runs import (
    ARGUMENTS,
    OPTIONS,
    VIEWS,
    assert_same_dataset,
    finished_views,
    linux_only,
    run_here,
    times,
)
from tests.tree import tree
from tests.waiting import children, wait_until

pytestmark = pytest.mark.render


@pytest.fixture
def start() -> Iterator:
    """Starts a command in a new session, and ends its remaining processes after the test."""
    started: list[subprocess.Popen] = []

    def begin(command: list[str]) -> subprocess.Popen:
        process = subprocess.Popen(
            command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, start_new_session=True
        )
        started.append(process)
        return process

    yield begin
    for process in started:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()


@linux_only
def test_one_writer_at_a_time_and_no_need_of_workers(
    case, reference, tmp_path, render_command, run_oneframe, start, monkeypatch
):
    monkeypatch.setattr(run_folder, "SHARDS_SECONDS", 0.1)
    out = tmp_path / "out"
    command = render_command(case, "--out", out, *ARGUMENTS, "--workers", 2)
    process = start(command)
    wait_until(lambda: finished_views(out) > 0 and children(process.pid), process)
    # while it stands still, it cannot end too early for this test
    os.kill(process.pid, signal.SIGSTOP)
    assert process.poll() is None
    # a worker may go on, and rename the file that it is writing
    before = {name: content for name, content in tree(out).items() if "/.partial-" not in name}
    for more in ((), ("--shard", "0/2")):
        ended = run_oneframe("render", case, "--out", out, *ARGUMENTS, *more)
        assert ended.returncode == 3
        assert ended.stderr == (
            f"error: {out}: another process renders into this folder; wait for it, stop it, or choose another folder "
            "(--out)\n"
        )
    # what a worker finishes in the meantime may be new
    assert before.items() <= tree(out).items()
    (worker,) = children(process.pid)
    os.kill(worker, signal.SIGKILL)
    os.kill(process.pid, signal.SIGCONT)
    _, errors = process.communicate()
    assert process.returncode == 0
    assert errors == "worker 1 was killed by signal 9; the others continue\n"
    assert_same_dataset(out, reference)


STRUCTURE = '[[structures]]\nname = "nerve"\nmesh = "surface.ply"\n'
CHANGES = {
    "the camera": (
        lambda folder, _: edit(folder / "case.toml", "320.0", "321.0"),
        "fx of the camera was 320.0, is 321.0",
    ),
    "the pose": (lambda folder, _: edit(folder / "case.toml", "340", "341"), "the pose has changed"),
    "a structure": (
        lambda folder, _: edit(folder / "case.toml", "[pose]", STRUCTURE + "[pose]"),
        "the file of the structure nerve",
    ),
    "the frame": (
        lambda folder, _: (folder / "frame.png").write_bytes(encode_png(np.zeros((48, 64, 3), np.uint8))),
        "the file of the frame has changed",
    ),
    "the mesh": (lambda folder, _: edit(folder / "surface.ply", "end_header", "comment \nend_header"), "the surface"),
    "the seed": (lambda _, options: dataclasses.replace(options, seed=4), "options.seed was 3, is 4"),
}


def edit(path: Path, old: str, new: str) -> None:
    data = path.read_bytes()
    assert data.count(old.encode()) == 1
    path.write_bytes(data.replace(old.encode(), new.encode()))


@pytest.mark.parametrize("what", CHANGES)
def test_another_dataset_does_not_get_into_the_folder(case, reference, tmp_path, what):
    change, message = CHANGES[what]
    other = shutil.copytree(case.parent, tmp_path / "case")
    before = times(reference)
    options = change(other, OPTIONS)
    options = options if isinstance(options, DatasetOptions) else OPTIONS
    with pytest.raises(RunError, match="holds the dataset of another run") as refused:
        run_here(other / "case.toml", reference, options)
    assert message in str(refused.value)
    assert times(reference) == before


def test_a_case_saved_again_with_the_same_meaning_resumes(case, reference, tmp_path):
    other, out = shutil.copytree(case.parent, tmp_path / "case"), shutil.copytree(reference, tmp_path / "out")
    edit(other / "case.toml", "[pose]", "# aligned by eye\n[pose]")
    shutil.rmtree(ViewPaths(out, 7).file("frame").parent)
    run_here(other / "case.toml", out)
    assert_same_dataset(out, reference)


def test_workers_refuse_inputs_that_changed_after_the_run_began(case, reference, tmp_path, render_command):
    other, out = shutil.copytree(case.parent, tmp_path / "case"), shutil.copytree(reference, tmp_path / "out")
    edit(other / "case.toml", "340", "341")
    command = render_command(other / "case.toml", "--out", out, *ARGUMENTS, "--worker")
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as worker:
        # its input stays open: it ends by itself
        assert b"the pose has changed" in worker.stderr.read()
        assert worker.wait() == 3


def test_a_run_ends_with_its_input(case, tmp_path, render_command):
    out, views = tmp_path / "out", 200 * VIEWS
    running = subprocess.Popen(
        render_command(
            case, "--out", out, "--count", views, "--workers", 2, "--end-with-input", "--progress-seconds", "0.1"
        ),
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    messages = filter(None, map(read_progress, running.stdout))
    counts = [next(messages).count, next(messages).count]
    # what the system does when the program that started it dies
    running.stdin.close()
    assert running.wait() == 130
    assert "run the same command again to continue" in running.stderr.read()
    assert counts == sorted(counts)
    assert 0 < finished_views(out) < views


@pytest.fixture
def small_disk(tmp_path) -> Iterator[Path]:
    """A file system with room for a few views."""
    disk = tmp_path / "disk"
    disk.mkdir()
    try:
        mounted = subprocess.run(
            ["mount", "-t", "tmpfs", "-o", "size=400k", "tmpfs", disk], capture_output=True, text=True, check=False
        )
    except FileNotFoundError:
        pytest.skip("there is no mount command")
    if mounted.returncode != 0:
        pytest.skip(f"a small disk cannot be mounted here: {mounted.stderr.strip()}")
    yield disk
    subprocess.run(["umount", disk], check=True)


def test_a_full_disk_stops_the_run_and_more_space_lets_it_resume(
    case, reference, small_disk, render_command, run_command
):
    out = small_disk / "out"
    ended = run_command(render_command(case, "--out", out, *ARGUMENTS, "--workers", 2))
    assert ended.returncode == 3
    assert ended.stderr.startswith(f"error: {out}: cannot write ")
    assert "(No space left on device); the views finished so far are safe: correct this and run" in ended.stderr
    finished = {name: data for name, data in tree(out).items() if "/frame/" in name}
    assert 0 < len(finished) < VIEWS
    expected = tree(reference)
    for name, record in finished.items():
        assert record == expected[name]
        assert all((out / file).read_bytes() == expected[file] for file in json.loads(record)["files"])
    subprocess.run(["mount", "-o", "remount,size=20m", small_disk], check=True)
    before = times(out)
    run_here(case, out)
    assert_same_dataset(out, reference)
    assert all(times(out)[name] == before[name] for name in finished)
