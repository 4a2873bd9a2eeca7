"""Runs that are killed, stopped or refused lose nothing, and mix with no other dataset."""

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
from oneframe.errors import RunError
from oneframe.images.png import encode_png
from tests.blender.dataset.job_runs import (
    ARGUMENTS,
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


@linux_only
def test_a_killed_worker_is_told_of_and_changes_no_byte(case, reference, tmp_path, render_command):
    out = tmp_path / "out"
    command = render_command(case, "--out", out, *ARGUMENTS, "--workers", 2)
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) as process:
        wait_until(lambda: finished_views(out) > 0 and children(process.pid), process)
        # while it stands still, it cannot end too early for this test
        os.kill(process.pid, signal.SIGSTOP)
        (worker,) = children(process.pid)
        os.kill(worker, signal.SIGKILL)
        os.kill(process.pid, signal.SIGCONT)
        _, errors = process.communicate()
    assert (process.returncode, errors) == (0, "worker 1 was killed by signal 9; the others continue\n")
    assert_same_dataset(out, reference)


STRUCTURE = '[[structures]]\nname = "nerve"\nmesh = "surface.ply"\n'
CHANGES = {
    "fx of the camera was 320.0, is 321.0": lambda folder: edit(folder / "case.toml", "320.0", "321.0"),
    "the file of the structure nerve": lambda folder: edit(folder / "case.toml", "[pose]", STRUCTURE + "[pose]"),
    "the file of the frame has changed": lambda folder: (folder / "frame.png").write_bytes(
        encode_png(np.zeros((48, 64, 3), np.uint8))
    ),
    "the surface": lambda folder: edit(folder / "surface.ply", "end_header", "comment \nend_header"),
}
"""Message -> the change of a case's folder that it tells of; for the pose and the seed the add-on's runs are tried."""


def edit(path: Path, old: str, new: str) -> None:
    data = path.read_bytes()
    assert data.count(old.encode()) == 1
    path.write_bytes(data.replace(old.encode(), new.encode()))


@pytest.mark.parametrize("message", CHANGES)
def test_another_dataset_does_not_get_into_the_folder(case, reference, tmp_path, message):
    other, before = shutil.copytree(case.parent, tmp_path / "case"), times(reference)
    CHANGES[message](other)
    with pytest.raises(RunError, match=f"holds the dataset of another run.*{message}"):
        run_here(other / "case.toml", reference)
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
