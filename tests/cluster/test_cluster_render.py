"""A dataset rendered by Dask workers: the bytes of a run on one machine, whatever dies during it."""

import os
import signal
import subprocess
import threading
from contextlib import suppress
from pathlib import Path

import psutil
import pytest

pytest.importorskip("distributed", reason='needs Dask: pip install "oneframe[cluster]"')

from tests.cluster.written_records import records
from tests.tree import different_files
from tests.waiting import is_alive, wait_until

pytestmark = [
    pytest.mark.render,
    pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="needs Linux's /proc"),
]

VIEWS = 160
AHEAD = 2
"""Views that a render process has in work."""


@pytest.fixture(scope="module")
def case(tmp_path_factory, write_tiny_case) -> Path:
    return write_tiny_case(tmp_path_factory.mktemp("case"))


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
    return {pid: ppid for pid, (ppid, command) in descendants(client).items() if "--worker" in command}


def test_killed_workers_and_processes_change_no_byte(case, tmp_path, render_command, run_command, rng):
    out, reference = tmp_path / "out", tmp_path / "reference"
    ended = run_command(render_command(case, "--out", reference, "--count", VIEWS, "--float-depth"))
    assert (ended.returncode, ended.stderr) == (0, "")
    process = subprocess.Popen(
        render_command(case, "--out", out, "--count", VIEWS, "--float-depth", "--cluster", "local:2"),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    first_seen: dict[str, tuple[int, int]] = {}
    watching = threading.Event()

    def watch() -> None:
        while not watching.wait(0.01):
            for name, state in records(out).items():
                first_seen.setdefault(name, state)

    watcher = threading.Thread(target=watch)
    watcher.start()
    kills = 0
    try:
        for least, victim in ((10, "process"), (VIEWS // 3, "worker")):
            wait_until(lambda least=least: len(records(out)) >= least and render_processes(process.pid), process)
            running = render_processes(process.pid)
            if running and process.poll() is None:
                pid = int(rng.choice([*(running if victim == "process" else running.values())]))
                os.kill(pid, signal.SIGKILL)
                kills += 1
        output, errors = process.communicate()
    finally:
        watching.set()
        watcher.join()
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
    assert (process.returncode, errors) == (0, "")
    assert kills == 2
    assert "1 lost" in output
    assert different_files(out, reference) == []
    assert not (out / ".work").exists()
    # what the killed worker's process had in work may be finished by it and by another
    again = [name for name, state in records(out).items() if first_seen.get(name, state) != state]
    assert len(again) <= AHEAD
    assert descendants(process.pid) == {}
