"""The items of a run as futures of Dask, until all are done: who does which, and again, is Dask's business.

Each thread of an admitted worker has one order with the scheduler. It takes about :data:`ORDER_SECONDS`, and less as
the end comes near: no more than half of an even share of what is left, so that the last ones end together.
"""

import math
import queue
import threading
import time
from collections import deque
from collections.abc import Collection, Generator, Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from pkgutil import resolve_name
from typing import Any

from distributed import CancelledError, Client, Future
from distributed.scheduler import KilledWorker

from .. import __version__
from ..dataset.run.work_folder import run_token
from ..errors import InputError, RunError
from ..progress import Progress
from .on_worker import OnWorker, admit, do_order, leave
from .scheduler import losing_scheduler

ORDER_SECONDS = 20.0
FIRST_ITEMS, MOST_ITEMS = 2, 1000
"""Items of an order as long as none has been timed, and of the largest one."""
RETRIES = 2
"""Dask tries so often again what a dead process has left."""
LOOK_SECONDS = 1.0
"""How often to look who is there."""
NO_WORKER_SECONDS, GONE_SECONDS = 5.0, 30.0
"""Until it is said that there is no worker; until a scheduler, or a worker with a result, that is silent has gone."""
ENDING_SECONDS = 2.0
"""Longest time that workers may take to end a run: the command that is stopped ends soon."""
AGAIN = "what is finished is safe: run the same command again to continue"


@dataclass(frozen=True)
class _Order:
    """Items that are with the scheduler since a time, and the workers that may do them."""

    items: tuple[int, ...]
    future: Future
    allowed: frozenset[str]
    since: float


class Orders:
    """Gives out the items of a run; :meth:`outcomes` once."""

    def __init__(
        self,
        client: Client,
        plugin: OnWorker,
        items: Iterable[int],
        progress: Progress,
        case: Mapping[str, bytes] | None = None,
    ) -> None:
        """Prepare to do items by a plugin on workers, which get the files of a case if there are any."""
        self._address, self._client = client.scheduler.address, client
        self._plugin, self._todo, self._progress = plugin, deque(items), progress
        self._case = case
        self._scattered: Future | None = None
        self._news: queue.SimpleQueue[Future] = queue.SimpleQueue()
        self._placed: dict[str, _Order] = {}
        self._asked: dict[str, Future] = {}
        self._threads: dict[str, int] = {}
        self._refused: dict[str, str] = {}
        self._timed, self._seconds, self._number, self._lost = 0, 0.0, 0, 0
        self._heard = self._useful = time.monotonic()

    def outcomes(self) -> Generator[dict[int, Any]]:
        """What :meth:`.OnWorker.do` gives, until all items are done; closing the iterator ends all that workers do.

        Raises
        ------
        InputError
            A worker found that no worker can use the input.
        RunError
            All workers refuse, the scheduler has gone, or an order ends every process that does it.
        """
        token, next_look = run_token(Path(self._plugin.folder), self._plugin.run), 0.0
        if self._plugin.folder:
            token.touch()
        try:
            while self._todo or self._placed:
                if time.monotonic() >= next_look:
                    self._look()
                    next_look = time.monotonic() + LOOK_SECONDS
                self._place()
                with suppress(queue.Empty):
                    yield from self._take(self._news.get(timeout=LOOK_SECONDS))
        finally:
            self._end()
            token.unlink(missing_ok=True)

    def state(self) -> str:
        """The workers, in a few words: "6 workers; 1 refused; 1 lost"."""
        others = {"refused": len(self._refused), "lost": self._lost}
        shown = [f"{count} {what}" for what, count in others.items() if count]
        return "; ".join([f"{len(self._threads)} worker{'s' * (len(self._threads) != 1)}", *shown])

    def _look(self) -> None:
        """Who has joined or left; orders that nobody can do any more go out again."""
        there, now = None, time.monotonic()
        with losing_scheduler(self._client):
            there = self._client.nthreads() if self._client.status == "running" else None
        if there is None:
            if self._client.status == "closed" or now - self._heard > GONE_SECONDS:
                raise RunError(f"the scheduler {self._address} no longer answers; start it, {AGAIN}")
            return
        self._heard = now
        for worker in self._threads.keys() - there.keys():
            self._progress.note(f"worker {worker} has gone; its orders go to others")
            self._lost += 1
        known: tuple[dict[str, Any], ...] = (self._asked, self._threads, self._refused)
        for workers in known:
            for worker in workers.keys() - there.keys():
                del workers[worker]
        for worker in there.keys() - {worker for workers in known for worker in workers}:
            # nothing of OneFrame, for its connection would break where that is missing
            self._asked[worker] = self._submit([worker], resolve_name, "oneframe:__version__")
        for key, order in [*self._placed.items()]:
            if not order.allowed & self._threads.keys():
                del self._placed[key]
                self._give_back(order)
                with losing_scheduler(self._client):
                    order.future.cancel(force=True)
        if self._threads or self._asked:
            self._useful = now
        elif now - self._useful > NO_WORKER_SECONDS:
            if there:
                raise RunError(f"all workers are refused: {'; '.join(dict.fromkeys(self._refused.values()))}")
            start = f"start one on any machine: dask worker {self._address}"
            self._progress.note(f"no worker is connected to {self._address}: waiting; {start}")
            self._useful = math.inf
        self._progress.update(self._progress.count, self.state())

    def _submit(self, workers: Collection[str], function: Any, *arguments: object) -> Future:
        self._number += 1
        key = f"oneframe-{function.__name__}-{self._plugin.run}-{self._number}"
        future = self._client.submit(
            function, *arguments, key=key, workers=sorted(workers), retries=RETRIES, pure=False
        )
        future.add_done_callback(self._news.put)
        return future

    def _place(self) -> None:
        slots = sum(self._threads.values())
        while self._todo and len(self._placed) < slots and self._client.status == "running":
            count = order_size(len(self._todo), slots, self._seconds / self._timed if self._timed else None)
            items = tuple(self._todo.popleft() for _ in range(count))
            future = self._submit(self._threads, do_order, self._plugin.run, items)
            self._placed[future.key] = _Order(items, future, frozenset(self._threads), time.monotonic())

    def _give_back(self, order: _Order, done: Collection[int] = ()) -> None:
        self._todo.extendleft(item for item in reversed(order.items) if item not in done)

    def _take(self, future: Future) -> Iterator[dict[int, Any]]:
        order = self._placed.pop(future.key, None)
        worker = next((worker for worker, asked in self._asked.items() if asked.key == future.key), None)
        if worker is not None:
            del self._asked[worker]
            self._take_admission(worker, _result(future))
        elif order is not None:
            yield from self._take_order(order, _result(future))

    def _take_admission(self, worker: str, answer: object) -> None:
        install = f'install OneFrame {__version__} there, with its extra "cluster", and start the worker again'
        if answer == __version__:
            if self._case is not None and (self._scattered is None or self._scattered.status != "finished"):
                # at first, and if all that had it have died; the others have it from each other
                (self._scattered,) = self._client.scatter([self._case], hash=False)
            self._asked[worker] = self._submit([worker], admit, self._plugin, self._scattered)
        elif isinstance(answer, int):
            self._threads[worker] = answer
        elif isinstance(answer, str):
            self._refuse(worker, f"it has OneFrame {answer}, the run has {__version__}; {install}")
        elif isinstance(answer, ImportError | AttributeError):
            self._refuse(worker, f"its Python has no OneFrame ({answer}); {install}")
        elif isinstance(answer, Exception) and not isinstance(answer, KilledWorker):
            self._refuse(worker, str(answer) or type(answer).__name__)

    def _take_order(self, order: _Order, answer: object) -> Iterator[dict[int, Any]]:
        worker, answer = answer if isinstance(answer, tuple) else ("", answer)
        if isinstance(answer, InputError):
            raise answer
        if isinstance(answer, Exception) and not worker:
            what = str(answer) or type(answer).__name__
            if isinstance(answer, KilledWorker):
                what = "the workers died, one after the other"
            span = f"{order.items[0]} to {order.items[-1]}"
            raise RunError(f"{what} ({RETRIES + 1} times at one order, {span}); {AGAIN}") from None
        self._give_back(order, answer if isinstance(answer, dict) else ())
        if isinstance(answer, dict):
            self._timed, self._seconds = self._timed + len(answer), self._seconds + time.monotonic() - order.since
            yield answer
        else:
            # refused, or begun anew
            self._threads.pop(worker, None)
            if answer is not None:
                self._refuse(worker, str(answer))

    def _refuse(self, worker: str, why: str) -> None:
        if why not in self._refused.values():
            self._progress.note(f"worker {worker} is refused: {why}")
        self._refused[worker] = why

    def _end(self) -> None:
        """End all that workers still do, at once."""

        def end() -> None:
            # those that have gone in the meantime have ended theirs
            with losing_scheduler(self._client):
                futures = [*self._asked.values(), *(order.future for order in self._placed.values())]
                self._client.cancel(futures, force=True)
                workers = [*self._threads, *self._asked]
                self._client.run(leave, self._plugin.run, workers=workers, on_error="ignore")

        if self._client.status == "running":
            ending = threading.Thread(target=end, daemon=True)
            ending.start()
            ending.join(ENDING_SECONDS)


def order_size(left: int, slots: int, seconds_each: float | None) -> int:
    """Number of items of the next order, of those left; ``None`` if no item has been timed."""
    share = math.ceil(left / (2 * slots))
    by_time = FIRST_ITEMS if seconds_each is None else int(ORDER_SECONDS / max(seconds_each, 1e-3))
    return max(1, min(share, by_time, MOST_ITEMS))


def _result(future: Future) -> object:
    """What a future gives or raises; ``None`` if nothing: its scheduler or its worker has just gone."""
    try:
        return future.result(timeout=GONE_SECONDS)
    except (TimeoutError, CancelledError, OSError):
        return None
    except Exception as error:  # whatever the worker or Dask raises: told by whoever takes it
        return error
