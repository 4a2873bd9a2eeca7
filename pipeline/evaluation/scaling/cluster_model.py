"""A model of many workers that share the views of a run: events in time, no process and no pixel.

It hands views out by the very policy of the engine (:func:`pipeline.dataset.chunks.next_chunk`), with the measured cost
of scheduling, and beside it by two others: a fixed shard a worker, and one view an order. Workers differ in speed,
start late, fail and are preempted.
"""

import heapq
from collections import deque
from dataclasses import dataclass, field
from enum import Enum
from itertools import count

import numpy as np

from ...dataset.chunks import TARGET_SECONDS, next_chunk, time_budget

ORDERS_PER_SLOT = 2
"""Orders a worker that are handed out at any time: the one being done, and one waiting."""


class Policy(Enum):
    """How views get to workers."""

    CHUNKS = "chunks by measured time"
    SINGLE = "one view an order"
    SHARDS = "a fixed shard a worker"


@dataclass(frozen=True)
class Interruptions:
    """One way in which workers stop; what they were rendering is lost, what they have finished is not.

    Attributes
    ----------
    mean_seconds
        Mean time of a worker between two of them, s; they come at random (a Poisson process).
    away_seconds
        Mean time until the worker is back and starts anew, s; drawn from an exponential distribution.
    notice_seconds
        Time until its views go to others, s.
    """

    mean_seconds: float
    away_seconds: float
    notice_seconds: float


@dataclass(frozen=True)
class Cluster:
    """Workers, and what handing out costs.

    Attributes
    ----------
    workers
        Their number, each with one render process.
    start_seconds
        Time that a worker needs before its first view, each time it starts, s.
    order_seconds, view_seconds
        Time of scheduler and client for an order, and for each view in it, s. They do one order at a time.
    spread
        Standard deviation of the logarithm of the workers' speeds (lognormal).
    slow_share, slow_factor
        Part of the workers that is slower than that, and how many times.
    view_spread
        Standard deviation of the logarithm of the views' times (lognormal).
    interruptions
        Failures, preemptions.
    target_seconds
        Time that an order should take, s.
    orders_held
        Orders that a worker holds: 1, the one that it does, or 2 with one that waits for it, as Dask does by default.
    """

    workers: int
    start_seconds: float = 0.0
    order_seconds: float = 0.0
    view_seconds: float = 0.0
    spread: float = 0.0
    slow_share: float = 0.0
    slow_factor: float = 1.0
    view_spread: float = 0.0
    interruptions: tuple[Interruptions, ...] = ()
    target_seconds: float = TARGET_SECONDS
    orders_held: int = 1

    def durations(self, views: int, seconds_per_view: float, generator: np.random.Generator) -> np.ndarray:
        """``(views,)`` times of the views at speed 1, s, of this mean whatever their spread."""
        factors = np.exp(self.view_spread * generator.standard_normal(views) - self.view_spread**2 / 2)
        return seconds_per_view * factors

    def speeds(self, generator: np.random.Generator) -> np.ndarray:
        """``(workers,)`` speeds; 1 is a worker that needs a view's own time."""
        speeds = np.exp(self.spread * generator.standard_normal(self.workers))
        slow = round(self.slow_share * self.workers)
        speeds[generator.permutation(self.workers)[:slow]] /= self.slow_factor
        return speeds


@dataclass(frozen=True)
class ModelledRun:
    """A run of the model.

    Attributes
    ----------
    seconds
        From the start to the last view.
    efficiency
        The part of what the workers could have rendered in that time that is in finished views, 0..1.
    orders
        Number of orders.
    lost_seconds
        Work that interruptions have wasted, in s of a worker of speed 1.
    server_load
        The part of the time in which scheduler and client were busy, 0..1.
    times_finished
        ``(views,)`` how often each view was finished.
    """

    seconds: float
    efficiency: float
    orders: int
    lost_seconds: float
    server_load: float
    times_finished: np.ndarray


def run_model(
    cluster: Cluster, policy: Policy, views: int, seconds_per_view: float, generator: np.random.Generator
) -> ModelledRun:
    """Let the workers of a cluster render ``views`` views of a mean time, s, at speed 1."""
    durations = cluster.durations(views, seconds_per_view, generator)
    model = _Model(cluster, policy, durations, cluster.speeds(generator), generator)
    return model.shards() if policy is Policy.SHARDS else model.run()


@dataclass
class _Worker:
    speed: float
    stops: float = np.inf
    way: int = 0
    lives: int = 0
    has_room: bool = False
    waiting: deque[tuple[int, int]] = field(default_factory=deque)


@dataclass
class _Model:
    cluster: Cluster
    policy: Policy
    durations: np.ndarray
    speeds: np.ndarray
    generator: np.random.Generator
    now: float = 0.0
    lost: float = 0.0
    server_free: float = 0.0
    server_busy: float = 0.0
    orders: int = 0
    placed: int = 0
    timed: float = 0.0
    timed_seconds: float = 0.0
    events: list[tuple] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.todo: deque[tuple[int, int]] = deque([(0, len(self.durations))])
        self.left = self.unfinished = len(self.durations)
        self.finished = np.zeros(len(self.durations), np.int32)
        self.workers = [_Worker(float(speed)) for speed in self.speeds]
        self.idle: deque[int] = deque()
        self.room: deque[int] = deque()
        self.stock: deque[tuple[int, int]] = deque()
        self.serial = count()
        self.rates = np.array([1 / kind.mean_seconds for kind in self.cluster.interruptions])

    # --- orders

    def run(self) -> ModelledRun:
        """Hand out orders until every view is finished."""
        for number in range(self.cluster.workers):
            self._starts(number, 0.0)
        while self.unfinished:
            self.now, _, act, *details = heapq.heappop(self.events)
            act(*details)
        return self._result()

    def _at(self, when: float, act: object, *details: object) -> None:
        heapq.heappush(self.events, (when, next(self.serial), act, *details))

    def _starts(self, number: int, when: float) -> None:
        worker = self.workers[number]
        worker.lives += 1
        begin = when + self.cluster.start_seconds
        worker.stops, worker.way = self._interruption(when)
        if worker.stops < begin:
            self._at(worker.stops, self._goes, number, 0, 0)
        else:
            self._at(begin, self._is_ready, number, worker.lives)

    def _interruption(self, when: float) -> tuple[float, int]:
        if not len(self.rates):
            return np.inf, 0
        total = float(self.rates.sum())
        way = int(self.generator.choice(len(self.rates), p=self.rates / total))
        return when + float(self.generator.exponential(1 / total)), way

    def _is_ready(self, number: int, life: int) -> None:
        if self.workers[number].lives == life:
            if self.workers[number].stops < np.inf:
                self._at(self.workers[number].stops, self._stops_idle, number, life)
            self.idle.append(number)
            self._hand_out()

    def _stops_idle(self, number: int, life: int) -> None:
        if self.workers[number].lives == life and number in self.idle:
            self.idle.remove(number)
            self._goes(number, 0, 0)

    def _hand_out(self) -> None:
        """Give orders to idle workers, then to those with room; and make new ones: the client keeps some ahead."""
        while self.idle and self.stock:
            self._begin(self.idle.popleft(), *self.stock.popleft())
        while self.room and self.stock:
            worker = self.workers[self.room.popleft()]
            if worker.has_room:
                worker.has_room = False
                worker.waiting.append(self.stock.popleft())
        while self.left and self.placed < ORDERS_PER_SLOT * self.cluster.workers:
            self._order()

    def _order(self) -> None:
        wanted = 1
        if self.policy is Policy.CHUNKS:
            mean = self.timed_seconds / self.timed if self.timed else None
            wanted = next_chunk(self.left, self.cluster.workers, mean, target_seconds=self.cluster.target_seconds)
        first, stop = self.todo.popleft()
        if stop - first > wanted:
            self.todo.appendleft((first + wanted, stop))
            stop = first + wanted
        self.left -= stop - first
        self.placed += 1
        self.orders += 1
        cost = self.cluster.order_seconds + self.cluster.view_seconds * (stop - first)
        self.server_free = max(self.now, self.server_free) + cost
        self.server_busy += cost
        self._at(self.server_free, self._is_placed, first, stop)

    def _is_placed(self, first: int, stop: int) -> None:
        self.stock.append((first, stop))
        self._hand_out()

    def _begin(self, number: int, first: int, stop: int) -> None:
        worker = self.workers[number]
        if self.cluster.orders_held > 1 and not worker.has_room:
            worker.has_room = True
            self.room.append(number)
        ends = self.now + np.cumsum(self.durations[first:stop]) / worker.speed
        # no view is begun after the budget, nor the first one left out
        begins = ends[:-1] < self.now + time_budget(target_seconds=self.cluster.target_seconds)
        done = 1 + int(np.count_nonzero(begins))
        if worker.stops <= ends[done - 1]:
            done = int(np.searchsorted(ends[:done], worker.stops, side="left"))
            begun = float(ends[done - 1]) if done else self.now
            self.lost += (worker.stops - begun) * worker.speed
            self._at(worker.stops, self._is_interrupted, number, first, first + done, stop)
            return
        self._at(float(ends[done - 1]), self._ends, number, first, first + done, stop, self.now)

    def _ends(self, number: int, first: int, done: int, stop: int, begun: float) -> None:
        self._finish(first, done)
        self.timed = 0.98 * self.timed + (done - first)
        self.timed_seconds = 0.98 * self.timed_seconds + (self.now - begun)
        self._give_back(done, stop)
        worker = self.workers[number]
        if worker.waiting:
            self._begin(number, *worker.waiting.popleft())
        else:
            worker.has_room = False
            self.idle.append(number)
        self._hand_out()

    def _is_interrupted(self, number: int, first: int, done: int, stop: int) -> None:
        self._finish(first, done)
        self._goes(number, done, stop)

    def _goes(self, number: int, first: int, stop: int) -> None:
        worker = self.workers[number]
        kind = self.cluster.interruptions[worker.way]
        worker.has_room = False
        orders = [*worker.waiting, *([(first, stop)] * (stop > 0))]
        worker.waiting.clear()
        for order in orders:
            self._at(self.now + kind.notice_seconds, self._is_noticed, *order)
        self._at(self.now + float(self.generator.exponential(kind.away_seconds)), self._comes_back, number)

    def _is_noticed(self, first: int, stop: int) -> None:
        self._give_back(first, stop)
        self._hand_out()

    def _comes_back(self, number: int) -> None:
        self._starts(number, self.now)

    def _give_back(self, first: int, stop: int) -> None:
        self.placed -= 1
        if stop > first:
            self.todo.appendleft((first, stop))
            self.left += stop - first

    def _finish(self, first: int, stop: int) -> None:
        self.finished[first:stop] += 1
        self.unfinished -= stop - first

    # --- shards

    def shards(self) -> ModelledRun:
        """Let every worker render its own shard, which nobody else ever does."""
        limits = len(self.durations) * np.arange(self.cluster.workers + 1) // self.cluster.workers
        for worker, first, stop in zip(self.workers, limits[:-1], limits[1:], strict=True):
            self.now = max(self.now, self._shard(worker, int(first), int(stop)))
        self.orders = self.cluster.workers
        return self._result()

    def _shard(self, worker: _Worker, first: int, stop: int) -> float:
        now = 0.0
        while first < stop:
            stops, way = self._interruption(now)
            now += self.cluster.start_seconds
            ends = now + np.cumsum(self.durations[first:stop]) / worker.speed
            done = int(np.searchsorted(ends, stops, side="left"))
            self.finished[first : first + done] += 1
            self.unfinished -= done
            first += done
            if first == stop:
                return float(ends[-1])
            self.lost += max(0.0, stops - max(now, float(ends[done - 1]) if done else now)) * worker.speed
            now = stops + float(self.generator.exponential(self.cluster.interruptions[way].away_seconds))
        return now

    def _result(self) -> ModelledRun:
        useful = float(self.durations.sum())
        return ModelledRun(
            seconds=self.now,
            efficiency=useful / (self.now * float(self.speeds.sum())),
            orders=self.orders,
            lost_seconds=self.lost,
            server_load=self.server_busy / self.now,
            times_finished=self.finished,
        )
