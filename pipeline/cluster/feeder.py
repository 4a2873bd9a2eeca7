"""Hands the items of a run out to workers as orders, and again what comes back undone, until all are done.

About :data:`ORDERS_PER_SLOT` orders a slot are with the scheduler at any time: one being done and one waiting. Which
worker does which order, and whose order goes to another because the worker has gone, is Dask's business. The feeder
keeps away from workers that refuse, and from those that have fallen silent.
"""

import queue
import threading
import time
from asyncio import CancelledError
from collections import Counter, deque
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any

from distributed.scheduler import KilledWorker

from .. import __version__
from ..dataset.chunks import next_chunk, time_budget
from ..errors import InputError, RunError
from .call import Call
from .case_sender import CaseSender
from .gathering import MOST_WAITING, Gatherer
from .orders import Beat, Order, Outcome, topic_of
from .placed_orders import PlacedOrder, PlacedOrders
from .sources import WorkerSource, is_connected, losing_scheduler
from .tally import Tally
from .workers_seen import WorkersSeen

ORDERS_PER_SLOT = 2
MOST_CRASHES = 3
"""An item at which this many processes have ended stops the run."""
MOST_UNREACHED = 3
"""A worker from which nothing could be gathered so often is refused."""
MOST_FAILURES = 3
"""Orders that may fail by a defect before the run stops."""
SHOW_SECONDS = 0.2
AGAIN = "what is finished is safe: run the same command again to continue"


@dataclass(frozen=True)
class Pace:
    """Times in s: between looks at the cluster; until it is said that there is no worker; of a silent worker; of a lost
    scheduler; and how long an order should take."""

    look: float = 2.0
    no_worker: float = 5.0
    silence: float = 120.0
    gone: float = 30.0
    order: float = 15.0


class Feeder:
    """The client's side of a run; :meth:`run` once."""

    def __init__(
        self,
        source: WorkerSource,
        call: Call,
        *,
        run: str,
        task: str,
        job: Mapping[str, Any],
        items: Iterable[int],
        anew: Collection[int] = (),
        noun: str = "view",
        pace: Pace | None = None,
        show: Callable[[int, str], None] = lambda _done, _state: None,
        note: Callable[[str], None] = lambda _text: None,
        gatherer: Gatherer | None = None,
        sender: CaseSender | None = None,
        on_outcome: Callable[[Outcome], None] = lambda _outcome: None,
    ) -> None:
        """Prepare a run.

        Parameters
        ----------
        source, call
            The workers, and the function that they call.
        run
            16 hex digits that name the run.
        task, job
            As in :class:`.Order`.
        items
            Numbers of what is to do.
        anew
            Those that are done whatever workers find.
        noun
            What an item is called.
        pace
            Times.
        show
            Gets the number of items done and the state of the workers, often.
        note
            Gets a line for the user, when something happens that matters.
        gatherer
            Brings here what is done; until then it does not count as done.
        sender
            Sends the case to workers that ask for it.
        on_outcome
            Gets every outcome.
        """
        self._source, self._client = source, source.client
        self._scheduler = PlacedOrders(source.client, call)
        self._task, self._job, self._noun = task, dict(job), noun
        self._todo, self._anew = deque(items), frozenset(anew)
        self._pace = pace or Pace()
        self._on_outcome = on_outcome
        self._show, self._note, self._gatherer, self._sender = show, note, gatherer, sender
        self._placed: dict[int, PlacedOrder] = {}
        self._number = 0
        self._suspects: deque[int] = deque()
        self._crashes: Counter[int] = Counter()
        self._failures = 0
        self._timed, self._timed_seconds = 0.0, 0.0
        self._news: queue.SimpleQueue[int | Beat | None] = queue.SimpleQueue()
        self._is_heard = False
        self._stopped = threading.Event()
        self._finished: set[int] = set()
        self.name = run
        """The run's name."""
        self.workers = WorkersSeen(source, self._pace.silence)
        self.tally = Tally()

    def stop(self) -> None:
        """Let :meth:`run` return soon; from any thread."""
        self._stopped.set()
        self._news.put(None)

    def run(self) -> Tally:
        """Hand out items until all are done, or :meth:`stop` is called.

        Raises
        ------
        InputError
            A worker found that the input cannot be used by any worker.
        RunError
            All workers refuse, the scheduler has gone, or an item ends every process.
        """
        try:
            next_look = next_show = since = time.monotonic()
            while self._is_unfinished() and not self._stopped.is_set():
                now = time.monotonic()
                if now >= next_look:
                    self._look(now, since)
                    next_look = time.monotonic() + self._pace.look
                self._place()
                self._take_news(min(0.5, self._pace.look))
                self._take_back()
                if time.monotonic() >= next_show or not self._placed:
                    self._show(self._shown(), self.state())
                    next_show = time.monotonic() + SHOW_SECONDS
            return self.tally
        finally:
            self._abandon()
            if self._is_heard:
                with losing_scheduler(self._client):
                    self._client.unsubscribe_topic(topic_of(self.name))

    def state(self) -> str:
        """The state of the workers, in a few words."""
        again = f"; {self.tally.again} {self._noun}s again" if self.tally.again else ""
        return self.workers.state(time.monotonic()) + again

    def found_before(self, outcomes: Iterable[Outcome]) -> None:
        """Take over, before :meth:`run`, what workers have from an earlier run."""
        wanted = {*self._todo}
        for outcome in outcomes:
            held = wanted.intersection(outcome.found)
            wanted -= held
            self._take_done(replace(outcome, found=tuple(sorted(held))))
        self._todo = deque(item for item in self._todo if item in wanted)

    def _is_unfinished(self) -> bool:
        return bool(self._todo or self._suspects or self._placed or (self._gatherer and self._gatherer.waiting))

    def _shown(self) -> int:
        if self._gatherer:
            return len(self._finished) - self._gatherer.waiting
        return len(self._finished) + sum(p.done for p in self._placed.values())

    # --- out

    def _place(self) -> None:
        if self._gatherer and self._gatherer.waiting > MOST_WAITING:
            return
        allowed = self.workers.allowed()
        slots = max(self.workers.slots, self._source.expected)
        if not is_connected(self._client) or (allowed is not None and not allowed):
            return
        orders: list[Order] = []
        while len(self._placed) + len(orders) < ORDERS_PER_SLOT * slots and (self._todo or self._suspects):
            orders.append(self._next_order(slots))
        if not orders:
            return
        placed = self._scheduler.place(orders, allowed, self._news.put)
        if not placed:
            self._todo.extendleft(item for order in reversed(orders) for item in reversed(order.items))
        self._placed.update({p.order.number: p for p in placed})

    def _next_order(self, slots: int) -> Order:
        self._number += 1
        alone = bool(self._suspects)
        if alone:
            items: tuple[int, ...] = (self._suspects.popleft(),)
        else:
            mean = self._timed_seconds / self._timed if self._timed else None
            count = next_chunk(len(self._todo), slots, mean, target_seconds=self._pace.order)
            items = tuple(self._todo.popleft() for _ in range(count))
        budget, anew = time_budget(target_seconds=self._pace.order), tuple(self._anew.intersection(items))
        return Order(self._number, self.name, self._task, __version__, self._job, items, budget, alone, anew)

    # --- back

    def _take_news(self, seconds: float) -> None:
        arrived: list[int] = []
        try:
            news = self._news.get(timeout=seconds)
            while True:
                if isinstance(news, Beat):
                    self._take_beat(news)
                elif news is not None:
                    arrived.append(news)
                news = self._news.get_nowait()
        except queue.Empty:
            pass
        done: list[PlacedOrder] = []
        for number in arrived:
            p = self._placed.pop(number, None)
            if p is None:
                continue
            if p.future.status == "finished":
                done.append(p)
            else:
                self._take_failure(p, p.future.exception() if p.future.status == "error" else None)
        for p, result in zip(done, self._scheduler.results(done), strict=True):
            if isinstance(result, str):
                self._take(Outcome.from_text(result), p.order)
            else:
                self._take_failure(p, result)

    def _take(self, outcome: Outcome, order: Order) -> None:
        self.workers.answered(outcome.worker, outcome.host)
        self.tally.orders += 1
        if outcome.wrong_input:
            raise InputError(outcome.wrong_input)
        self.tally.twice += len(self._finished.intersection(outcome.finished))
        self._take_done(outcome)
        self._on_outcome(outcome)
        if outcome.finished:
            # recent orders count more
            self._timed = 0.98 * self._timed + len(outcome.finished)
            self._timed_seconds = 0.98 * self._timed_seconds + outcome.seconds
        if outcome.refused:
            left = [item for item in order.items if item not in self._finished]
            if text := self.workers.refuse(outcome.worker, outcome.host, outcome.refused):
                self._note(text)
            self._todo.extendleft(reversed(left))
            return
        for lost in outcome.lost:
            self.tally.processes += 1
            self._note(f"worker {outcome.worker} on {outcome.host}: {lost}; its {self._noun}s are done again")
        if outcome.lost:
            self.tally.again += len(outcome.crashed)
        for item in outcome.crashed:
            self._crashed(item, f"{outcome.lost[-1] if outcome.lost else 'a process'} on {outcome.host}")
        self._todo.extendleft(reversed(outcome.left))

    def _take_done(self, outcome: Outcome) -> None:
        self._finished.update(outcome.finished, outcome.found)
        self.tally.add(outcome)
        if self._gatherer:
            self._gatherer.take(outcome)

    def _take_back(self) -> None:
        """What could not be brought here goes out again."""
        if self._gatherer is None:
            return
        for ungathered in self._gatherer.given_back():
            if not self.tally.not_gathered:
                self._note(f"{self._noun} {ungathered.view} is not gathered and is done again: {ungathered.why}")
            self.tally.not_gathered += 1
            self._finished.discard(ungathered.view)
            self._todo.appendleft(ungathered.view)
            if self._gatherer.failures[ungathered.worker] >= MOST_UNREACHED:
                text = self.workers.refuse(
                    ungathered.worker,
                    ungathered.worker,
                    "this machine cannot connect to it, though the scheduler can; open the worker's port (dask worker "
                    "--worker-port), or let the views stay there (--out-on-workers without --gather)",
                )
                if text:
                    self._note(text)

    def _crashed(self, item: int, how: str) -> None:
        self._crashes[item] += 1
        if self._crashes[item] >= MOST_CRASHES:
            raise RunError(
                f"{self._noun} {item}: {MOST_CRASHES} processes ended while they worked on it (the last time: {how}); "
                f"{AGAIN}, or look for the cause by rendering it alone"
            )
        self._suspects.append(item)

    def _take_failure(self, placed: PlacedOrder, error: BaseException | None) -> None:
        """An order without an outcome: its workers died, the scheduler forgot it, or there is a defect."""
        left = [item for item in placed.order.items if item not in self._finished]
        self._count_again(placed, len(left))
        if isinstance(error, KilledWorker):
            if len(left) == 1:
                self._crashed(left[0], "the workers died")
            else:
                # one of them may be the cause
                self._suspects.extend(left)
            return
        self._todo.extendleft(reversed(left))
        known = isinstance(error, OSError | TimeoutError | CancelledError)
        if error is None or known or not is_connected(self._client):
            return
        self._failures += 1
        text = f"{type(error).__name__}: {' '.join(str(error).split())}"
        if self._failures >= MOST_FAILURES:
            raise RunError(f"the workers cannot do orders ({text}); {AGAIN}")
        self._note(f"an order failed and is done again ({text})")

    def _count_again(self, placed: PlacedOrder, items: int) -> None:
        # an order that nobody has begun has cost nothing
        if placed.begun_on:
            self.tally.again += max(0, items - placed.done)

    def _hear(self, event: tuple[float, Mapping[str, Any]]) -> None:
        """Take an event of the run's topic, in Dask's loop."""
        content = event[1]
        if "folder" not in content:
            self._news.put(Beat(**content))
        elif self._sender is not None:
            self._sender.send(**content)

    def _take_beat(self, beat: Beat) -> None:
        now = time.monotonic()
        self.workers.heard(beat.worker, beat.state, now)
        placed = self._placed.get(beat.number)
        if placed is not None:
            placed.begun_on, placed.heard, placed.done = beat.worker, now, beat.done

    # --- the cluster

    def _look(self, now: float, since: float) -> None:
        """Who has joined, left or fallen silent; orders that nobody can do any more go out again."""
        if not is_connected(self._client):
            self._is_heard = False
        elif not self._is_heard:
            # at first, and if another scheduler has taken the place of the lost one
            self._client.subscribe_topic(topic_of(self.name), self._hear)
            self._is_heard = True
        for text in self.workers.look(now):
            self._note(text)
        self.workers.check(now, since, self._pace.no_worker, self._pace.gone, self._note)
        silent = self.workers.silent(
            now, {p.begun_on: p.heard for p in sorted(self._placed.values(), key=lambda p: p.heard) if p.begun_on}
        )
        allowed, waiting = self.workers.allowed(), self._scheduler.keys_at(silent)
        stuck = [
            p
            for p in self._placed.values()
            if p.begun_on in silent
            or p.future.key in waiting
            or (p.allowed is not None and allowed is not None and not p.allowed & allowed)
        ]
        self._scheduler.cancel(stuck)
        for p in stuck:
            del self._placed[p.order.number]
            self._count_again(p, len(p.order.items))
            self._todo.extendleft(reversed(p.order.items))

    def _abandon(self) -> None:
        placed = [*self._placed.values()]
        self._placed.clear()
        self._scheduler.cancel(placed)
