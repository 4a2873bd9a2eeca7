"""Worker processes for one job: each runs the same command again and gets view numbers on standard input.

A worker reads one number per line and answers "finished: number" when that view is on disk; other lines of its output
come from Blender. When its input ends, which also happens if the parent dies in any way, the worker ends at once.
"""

import queue
import subprocess
import sys
import threading
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from typing import TextIO

from ...errors import InputError, RunError
from ..command_line import EXIT_INPUT, EXIT_RUN
from ..process import end_process

_FINISHED = "finished: "

AHEAD = 2
"""Number of unfinished views that a worker holds: one being rendered and one waiting, so that it never idles."""


class WorkerPool:
    """Workers that take views from a common queue; the parent process takes views from it as well."""

    def __init__(self, views: Sequence[int], finished: Callable[[int], None]) -> None:
        """Prepare the queue, without starting workers; ``finished`` is called from any thread with a view's number."""
        self._views = deque(views)
        self._finished = finished
        self._threads: list[threading.Thread] = []
        self._processes: list[subprocess.Popen[str]] = []
        self._failure: Exception | None = None
        self.messages: list[str] = []

    def start(self, command: Sequence[str], count: int) -> None:
        """Start ``count`` workers, each with the command."""
        for number in range(count):
            process = subprocess.Popen(
                command,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                bufsize=1,
                encoding="utf-8",
                errors="replace",
            )
            thread = threading.Thread(target=self._feed, args=(process, number + 1), daemon=True)
            self._processes.append(process)
            self._threads.append(thread)
            thread.start()

    def views(self) -> Iterator[int]:
        """Views for the parent process, until none is left and no worker holds one."""
        while True:
            self._check()
            try:
                yield self._views.popleft()
                continue
            except IndexError:
                pass
            for thread in self._threads:
                thread.join()
            self._check()
            if not self._views:
                return

    def stop(self) -> None:
        """End all workers at once."""
        self._views.clear()
        for process in self._processes:
            process.kill()
        for thread in self._threads:
            thread.join()

    def _check(self) -> None:
        if self._failure is not None:
            raise self._failure

    def _feed(self, process: subprocess.Popen[str], number: int) -> None:
        assigned: set[int] = set()
        errors: deque[str] = deque(maxlen=20)
        reader = threading.Thread(target=lambda: errors.extend(process.stderr or ()), daemon=True)
        reader.start()
        try:
            self._assign(process, assigned)
            for line in process.stdout or ():
                if line.startswith(_FINISHED):
                    index = int(line.removeprefix(_FINISHED))
                    assigned.discard(index)
                    self._finished(index)
                    self._assign(process, assigned)
        except BrokenPipeError:
            # the worker died, and its exit code says more; or it no longer reads its input, so end it
            process.kill()
        code = process.wait()
        if process.stdin is not None:
            with suppress(OSError):  # numbers that a dead worker has not taken; else Python reports them as it collects
                process.stdin.close()
        reader.join()
        # its unfinished views go back to the queue
        self._views.extendleft(sorted(assigned, reverse=True))
        reported = [line for line in errors if line.startswith("error: ")] or [*errors]
        last = reported[-1].strip().removeprefix("error: ") if reported else ""
        if code == EXIT_INPUT:
            self._failure = InputError(last)
        elif code == EXIT_RUN:
            self._failure = RunError(last)
        elif code != 0:
            how = f"was killed by signal {-code}" if code < 0 else f"ended with code {code}"
            self.messages.append(f"worker {number} {how}; the others continue {f'({last})' if last else ''}".rstrip())

    def _assign(self, process: subprocess.Popen[str], assigned: set[int]) -> None:
        stream = process.stdin
        if stream is None or stream.closed:
            return
        while len(assigned) < AHEAD:
            try:
                index = self._views.popleft()
            except IndexError:
                if not assigned:
                    stream.close()
                return
            assigned.add(index)
            stream.write(f"{index}\n")
        stream.flush()


def report_finished(index: int, stream: TextIO) -> None:
    """Answer the parent that a view is on disk."""
    stream.write(f"{_FINISHED}{index}\n")
    stream.flush()


def assigned_views(stream: TextIO = sys.stdin) -> Iterator[int | None]:
    """A worker's views from its input, with ``None`` now and then while it waits; the iterator never ends.

    When the input ends, the process exits at once: the parent has nothing left to do, or has died.
    """
    lines: queue.SimpleQueue[str] = queue.SimpleQueue()

    def read() -> None:
        for line in stream:
            lines.put(line)
        end_process(0)

    threading.Thread(target=read, daemon=True).start()

    def views() -> Iterator[int | None]:
        while True:
            try:
                yield int(lines.get(timeout=0.1))
            except queue.Empty:
                yield None

    return views()
