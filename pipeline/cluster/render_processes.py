"""On a worker: render processes that live on between the orders of a run, so that a scene is built once.

A worker with k threads does k orders at a time, so it has up to k processes of a run. Each ends when it has waited for
an order for :data:`IDLE_SECONDS`, as when the run has ended without a word, and when the worker ends, which closes its
input.
"""

import threading
import time
from collections import defaultdict

from ..blender.dataset.render_process import RenderProcess

IDLE_SECONDS = 120.0

_lock = threading.Lock()
_free: dict[str, list[tuple[float, RenderProcess]]] = defaultdict(list)
_busy: dict[str, set[RenderProcess]] = defaultdict(set)
_ended: set[str] = set()
_folders: dict[str, str] = {}
_sweeper: list[threading.Thread] = []


def take(run: str, folder: str) -> RenderProcess | None:
    """A free process of a run, the last one used; ``None`` if there is none.

    One run at a time writes to a folder. So those that wrote there before have died, and their processes end.
    """
    with _lock:
        former = [other for other, its in _folders.items() if its == folder and other != run]
        _folders[run] = folder
    for other in former:
        end_run(other)
    with _lock:
        while _free[run]:
            _, process = _free[run].pop()
            if process.is_alive():
                _busy[run].add(process)
                return process
        return None


def started(run: str, process: RenderProcess) -> None:
    """Note a new process that an order of this run has started and uses."""
    with _lock:
        _busy[run].add(process)
        if run in _ended:
            process.kill()


def give_back(run: str, process: RenderProcess) -> None:
    """Note that an order no longer uses its process; it stays for the next one."""
    with _lock:
        _busy[run].discard(process)
        if process.has_ended or run in _ended:
            process.kill()
            return
        _free[run].append((time.monotonic(), process))
        if not _sweeper:
            _sweeper.append(threading.Thread(target=_sweep, daemon=True))
            _sweeper[0].start()


def end_run(run: str) -> None:
    """End all processes of a run, at once."""
    with _lock:
        _ended.add(run)
        _folders.pop(run, None)
        processes = [*_busy.pop(run, ()), *(process for _, process in _free.pop(run, ()))]
    for process in processes:
        process.kill()


def _sweep() -> None:
    while True:
        time.sleep(min(5.0, IDLE_SECONDS / 4))
        limit = time.monotonic() - IDLE_SECONDS
        with _lock:
            for run, processes in _free.items():
                for since, process in processes:
                    if since < limit:
                        process.kill()
                _free[run] = [(since, process) for since, process in processes if since >= limit]
