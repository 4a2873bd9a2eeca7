"""Worker processes for one job on this machine: each runs the same command again and gets view numbers."""

import threading
from collections import deque
from collections.abc import Callable, Iterator, Sequence

from .render_process import AHEAD, RenderProcess


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

    def _feed(self, process: RenderProcess, number: int) -> None:
        self._assign(process)
        while not process.has_ended:
            index = process.wait_for_view()
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
        while len(process.assigned) < AHEAD:
            try:
                index = self._views.popleft()
            except IndexError:
                if not process.assigned:
                    process.close_input()
                return
            process.assign(index)
