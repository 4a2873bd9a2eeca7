"""A dataset rendered by Dask workers: the bytes of a run on one machine, whatever dies; nothing stays behind."""

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import psutil
import pytest

distributed = pytest.importorskip("distributed", reason='needs Dask: pip install "oneframe[cluster]"')

from tests.tree import different_files
from tests.waiting import is_alive, wait_until

pytestmark = [
    pytest.mark.render,
    pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="needs Linux's /proc"),
]
VIEWS = 120


def records(root: Path) -> dict[str, tuple[int, int]]:
    """Each view's record, with what changes when it is written again."""
    found = {}
    for path in root.glob("*/*/frame/[0-9]*.json"):
        with suppress(OSError):  # it is being replaced
            state = path.stat()
            found[path.relative_to(root).as_posix()] = (state.st_ino, state.st_mtime_ns)
    return found


def descendants(parent: int) -> dict[int, tuple[int, str]]:
    """Living processes below one: number -> parent and command line."""
    found = {}
    with suppress(psutil.NoSuchProcess):
        for process in psutil.Process(parent).children(recursive=True):
            with suppress(psutil.NoSuchProcess, psutil.ZombieProcess):
                if is_alive(process.pid):
                    found[process.pid] = process.ppid(), " ".join(process.cmdline())
    return found


def render_processes(client: int) -> dict[int, int]:
    """Render processes of a run -> the Dask worker that has started each."""
    return {
        pid: ppid
        for pid, (ppid, command) in descendants(client).items()
        if "--shard=" in command and "--worker" not in command.split()
    }


@pytest.fixture(scope="module")
def case(tmp_path_factory, write_tiny_case) -> Path:
    return write_tiny_case(tmp_path_factory.mktemp("case"))


@pytest.fixture(scope="module")
def reference(case, tmp_path_factory, render_command, run_command) -> Path:
    out = tmp_path_factory.mktemp("one machine") / "dataset"
    ended = run_command(render_command(case, "--out", out, "--count", VIEWS, "--workers", 1))
    assert (ended.returncode, ended.stderr) == (0, "")
    return out


@pytest.fixture
def scheduler() -> Iterator[tuple[str, int]]:
    """A scheduler with two workers, which outlives runs: its address, and the process that has it and them."""
    text = "from distributed import LocalCluster; import sys\nif __name__ == '__main__':\n"
    text += " c = LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None)\n"
    text += " print(c.scheduler_address, flush=True); sys.stdin.read()\n"
    program = subprocess.Popen(
        [sys.executable, "-c", text],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    )
    try:
        yield program.stdout.readline().strip(), program.pid
    finally:
        program.kill()
        program.communicate()


def started(command: list[str]) -> subprocess.Popen:
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True)


def test_killed_workers_and_processes_change_no_byte(case, reference, tmp_path, scheduler, render_command, rng):
    out, (address, holder) = tmp_path / "out", scheduler
    process = started(render_command(case, "--out", out, "--count", VIEWS, "--cluster", address))
    kills = 0
    try:
        for least, victim in ((10, "process"), (VIEWS // 3, "worker")):
            wait_until(lambda least=least: len(records(out)) >= least and render_processes(holder), process)
            running = render_processes(holder)
            if running and process.poll() is None:
                pid = int(rng.choice([*(running if victim == "process" else running.values())]))
                os.kill(pid, signal.SIGKILL)
                kills += 1
        _, errors = process.communicate()
    finally:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
    assert (process.returncode, errors) == (0, "")
    assert kills == 2
    assert different_files(out, reference) == []
    assert not (out / ".work").exists()
    wait_until(lambda: not render_processes(holder))


def test_a_killed_run_goes_on_and_renders_next_to_nothing_twice(
    case, reference, tmp_path, scheduler, render_command, run_command
):
    out, (address, holder) = tmp_path / "out", scheduler
    command = render_command(case, "--out", out, "--count", VIEWS, "--cluster", address)
    run = started(command)
    try:
        wait_until(lambda: len(records(out)) >= VIEWS // 4, run)
    finally:
        run.kill()
        run.communicate()
    kept = records(out)
    ended = run_command(command)
    assert (ended.returncode, ended.stderr) == (0, "")
    last = records(out)
    # those in work are finished by its workers as well
    again = {name for name, state in kept.items() if last[name] != state}
    assert len(again) <= 4
    assert different_files(out, reference) == []
    wait_until(lambda: not render_processes(holder))


def test_ctrl_c_ends_what_workers_do(case, tmp_path, scheduler, render_command):
    address, holder = scheduler
    run = started(render_command(case, "--out", tmp_path / "out", "--count", 5000, "--cluster", address))
    wait_until(lambda: len(render_processes(holder)) == 2, run)
    run.send_signal(signal.SIGINT)
    _, errors = run.communicate()
    assert "stopped; run the same command again to continue" in errors
    wait_until(lambda: not render_processes(holder))
