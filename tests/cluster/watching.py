"""What a run on a cluster does while it is watched: its processes, the views that are finished, and those once more."""

from contextlib import suppress
from pathlib import Path

import psutil

from tests.waiting import is_alive


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
