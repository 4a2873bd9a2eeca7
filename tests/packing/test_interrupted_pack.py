"""A pack that is killed at any moment: shards are whole or not there, and the same command ends it, byte for byte."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import psutil
import pytest

from tests.tree import tree
from tests.waiting import wait_until

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
PROGRAM = Path(__file__).with_name("interrupted_pack.py")


def run(dataset: Path, out: Path, place: int, workers: int = 1) -> subprocess.CompletedProcess:
    command = [sys.executable, PROGRAM, "SIGKILL", place, dataset, "--out", out, "--views-per-shard", 2]
    command += ["--workers", workers]
    return subprocess.run([*map(str, command)], capture_output=True, text=True, check=False)


@pytest.fixture(scope="module")
def whole(dataset, tmp_path_factory) -> tuple[dict[str, bytes], int]:
    """The files of a pack that nothing disturbs, and the number of changes of the file system that make them."""
    out = tmp_path_factory.mktemp("whole") / "out"
    ended = run(dataset, out, -1)
    assert ended.returncode == 0, ended.stderr
    return tree(out), int(ended.stderr)


def test_a_killed_pack_is_finished_by_the_same_command(dataset, whole, tmp_path, long_form):
    expected, changes = whole
    assert changes > 20
    for place in range(changes) if long_form else range(1, changes, -(-changes // 3)):
        out = tmp_path / str(place)
        assert run(dataset, out, place).returncode == -signal.SIGKILL
        for shard in out.glob("shard-*.tar"):
            data = shard.read_bytes()
            assert data == expected[shard.name]
        ended = run(dataset, out, -1)
        assert ended.returncode == 0, f"change {place} of {changes}: {ended.stderr}"
        assert tree(out) == expected, f"change {place} of {changes}"


def test_ctrl_c_is_one_line(dataset, tmp_path):
    command = [
        sys.executable,
        PROGRAM,
        "SIGSTOP",
        8,
        dataset,
        "--out",
        tmp_path,
        "--views-per-shard",
        1,
        "--workers",
        2,
    ]
    process = subprocess.Popen(
        [*map(str, command)], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, start_new_session=True
    )
    wait_until(lambda: psutil.Process(process.pid).status() == psutil.STATUS_STOPPED, process)
    os.killpg(process.pid, signal.SIGINT)
    os.killpg(process.pid, signal.SIGCONT)
    _, told = process.communicate()
    assert (process.returncode, told) == (130, "error: stopped; run the same command again to continue\n")
