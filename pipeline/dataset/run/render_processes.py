"""Processes that render views of one job: numbers go in, and come back as each view is on disk.

A process is the render command with ``--worker``. It reads one number a line, and answers "written: number" when that
view's files are, and it takes another one, and "finished: number" when the view is on disk, to stay; other lines of its
output come from Blender. When its input ends, which also happens if its parent dies in any way, it ends soon.
"""

import queue
import re
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import TextIO

from ...errors import InputError, RunError
from ...process.command_line import EXIT_INPUT, EXIT_RUN
from ...process.own_process import STOPPING_SECONDS, end_process

WRITTEN, FINISHED = "written", "finished"

AHEAD = 2
"""Number of unwritten views that a process holds: one being rendered and one waiting, so that it never idles."""


@dataclass(frozen=True)
class Ending:
    """How a process ended: its exit code, negative for a signal, and the last error or line that it printed."""

    code: int
    last: str

    @property
    def how(self) -> str:
        """A clause: "was killed by signal 9", "ended with code 1"."""
        return f"was killed by signal {-self.code}" if self.code < 0 else f"ended with code {self.code}"

    @property
    def error(self) -> InputError | RunError | None:
        """The error that it reported, if it ended by one."""
        kinds: dict[int, type[InputError | RunError]] = {EXIT_INPUT: InputError, EXIT_RUN: RunError}
        return kinds[self.code](self.last) if self.code in kinds else None


class RenderProcess:
    """The parent's side of one process; one thread uses it at a time."""

    def __init__(self, command: Sequence[str]) -> None:
        """Start the process.

        Raises
        ------
        OSError
            The program cannot be started.
        """
        self._process = subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            bufsize=1,
            encoding="utf-8",
            errors="replace",
        )
        self.assigned: deque[int] = deque()
        """Views that it has not finished, in its order."""
        self.free = AHEAD
        """Number of views that it may take."""
        self._answers: queue.SimpleQueue[tuple[str, int] | None] = queue.SimpleQueue()
        self._errors: deque[str] = deque(maxlen=20)
        self._readers = [threading.Thread(target=read, daemon=True) for read in (self._read, self._collect)]
        for reader in self._readers:
            reader.start()

    def assign(self, index: int) -> None:
        """Give it a view."""
        self.assigned.append(index)
        self.free -= 1
        stream = self._process.stdin
        try:
            if stream is not None:
                stream.write(f"{index}\n")
                stream.flush()
        except (BrokenPipeError, ValueError):
            # it died, and its exit code says more; or it no longer reads its input, so end it
            self.kill()

    def answers(self) -> Iterator[int | None]:
        """Each view that is on disk, and ``None`` for one that is only written, until the process has ended."""
        while answer := self._answers.get():
            word, index = answer
            if word == WRITTEN:
                self.free += 1
                yield None
                continue
            with suppress(ValueError):
                self.assigned.remove(index)
            yield index

    def close_input(self) -> None:
        """Let it end."""
        if self._process.stdin is not None:
            # numbers that a dead process has not taken; else Python reports them as it collects
            with suppress(OSError):
                self._process.stdin.close()

    def kill(self) -> None:
        """End it at once."""
        self._process.kill()

    def ending(self) -> Ending:
        """Wait for its end; how it ended."""
        code = self._process.wait()
        self.close_input()
        for reader in self._readers:
            reader.join()
        reported = [line for line in self._errors if line.startswith("error: ")] or [*self._errors]
        return Ending(code, reported[-1].strip().removeprefix("error: ") if reported else "")

    def _read(self) -> None:
        for line in self._process.stdout or ():
            if answer := re.fullmatch(rf"({WRITTEN}|{FINISHED}): ([0-9]+)\n", line):
                self._answers.put((answer[1], int(answer[2])))
        self._answers.put(None)

    def _collect(self) -> None:
        self._errors.extend(self._process.stderr or ())


def report(stream: TextIO, answer: str, index: int) -> None:
    """Tell the parent of a view; one that has gone needs no answer."""
    with suppress(BrokenPipeError):
        stream.write(f"{answer}: {index}\n")
        stream.flush()


def assigned_views(stream: TextIO = sys.stdin) -> Iterator[int | None]:
    """A process's views from its input, with ``None`` now and then while it waits, until the input ends.

    Then the parent has nothing left to do, or has died: what is written is finished, and the process exits soon.
    """
    lines: queue.SimpleQueue[str] = queue.SimpleQueue()
    ended = threading.Event()

    def read() -> None:
        for line in stream:
            lines.put(line)
        ended.set()
        time.sleep(STOPPING_SECONDS)
        end_process(0)

    threading.Thread(target=read, daemon=True).start()

    def views() -> Iterator[int | None]:
        while not ended.is_set():
            try:
                yield int(lines.get(timeout=0.1))
            except queue.Empty:
                yield None

    return views()


class WorkerPool:
    """Workers that take views from a common queue; the parent process takes views from it as well."""

    def __init__(self, views: Sequence[int], finished: Callable[[int], None]) -> None:
        """Prepare the queue, without starting workers; ``finished`` is called from any thread with a view's number."""
        self._views = deque(views)
        self._finished = finished
        self._threads: list[threading.Thread] = []
        self._processes: list[RenderProcess] = []
        self._failure: Exception | None = None
        self.messages: list[str] = []

    def start(self, command: Sequence[str], count: int) -> None:
        """Start ``count`` workers, each with the command."""
        for number in range(count):
            process = RenderProcess(command)
            thread = threading.Thread(target=self._feed, args=(process, number + 1), daemon=True)
            self._processes.append(process)
            self._threads.append(thread)
            thread.start()

    def views(self) -> Iterator[int | None]:
        """Views for the parent process, until none is left and no worker holds one; ``None`` now and then meanwhile."""
        while True:
            self._check()
            with suppress(IndexError):
                yield self._views.popleft()
                continue
            for thread in self._threads:
                while thread.is_alive():
                    yield None
                    thread.join(0.1)
            self._check()
            if not self._views:
                return

    def stop(self) -> None:
        """End all workers, which finish what they have written; those that take long at once."""
        self._views.clear()
        for process in self._processes:
            process.close_input()
        for thread, process in zip(self._threads, self._processes, strict=True):
            thread.join(STOPPING_SECONDS / 2)
            process.kill()
            thread.join()

    def _check(self) -> None:
        if self._failure is not None:
            raise self._failure

    def _feed(self, process: RenderProcess, number: int) -> None:
        self._assign(process)
        for index in process.answers():
            if index is not None:
                self._finished(index)
            self._assign(process)
        ending = process.ending()
        # its unfinished views go back to the queue
        self._views.extendleft(reversed(process.assigned))
        if ending.error is not None:
            self._failure = ending.error
        elif ending.code != 0:
            last = f"({ending.last})" if ending.last else ""
            self.messages.append(f"worker {number} {ending.how}; the others continue {last}".rstrip())

    def _assign(self, process: RenderProcess) -> None:
        while process.free:
            try:
                index = self._views.popleft()
            except IndexError:
                if not process.assigned:
                    process.close_input()
                return
            process.assign(index)
