"""On a worker: the kinds of orders, and what a task may report and ask while it does one."""

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from . import pack_task, render_task
from .file_streams import WorkerFolder
from .orders import Order, Outcome, topic_of

BEAT_SECONDS = 2.0
"""Shortest time between signs of life of an order whose state stays the same."""


class DaskSurroundings:
    """The worker that does an order."""

    def __init__(self, order: Order, worker: Any, host: str) -> None:
        """Stand between an order and its :class:`distributed.Worker`."""
        self.address: str = worker.address
        self.host = host
        self._order, self._worker = order, worker
        self._last = ("", 0.0)

    def beat(self, state: str, done: int) -> None:
        """Tell the client that the order goes on: its state, such as "rendering", and the number of items done."""
        now = time.monotonic()
        if self._last[0] == state and now - self._last[1] < BEAT_SECONDS:
            return
        self._last = (state, now)
        message = {"number": self._order.number, "worker": self.address, "state": state, "done": done}
        self._worker.log_event(topic_of(self._order.run), message)

    @property
    def local_folder(self) -> Path:
        """Its folder for temporary files."""
        return Path(self._worker.local_directory)

    def open_folder(self, name: str, root: Path) -> WorkerFolder:
        """Let the run's machine read or fill a folder."""
        return WorkerFolder.open(self._worker, name, root)

    def ask_for_case(self, folder: str) -> None:
        """Ask the run's machine to fill an opened folder with the case."""
        self._worker.log_event(topic_of(self._order.run), {"worker": self.address, "folder": folder})

    def is_closing(self) -> bool:
        """Whether the worker is about to end."""
        return self._worker.status.name in ("closing", "closed", "closing_gracefully", "stopping")


TASKS: dict[str, Callable[[Order, render_task.Surroundings], Outcome]] = {
    "render": render_task.perform,
    "held": render_task.held,
    "pack": pack_task.perform,
}
"""What can be ordered."""


def perform(text: str, worker: Any, host: str) -> str:
    """Do an order, given as JSON; the outcome as JSON."""
    order = Order.from_text(text)
    return TASKS[order.task](order, DaskSurroundings(order, worker, host)).to_text()


def end_run(run: str) -> None:
    """End what a run still does on this worker."""
    render_task.end_run(run)
