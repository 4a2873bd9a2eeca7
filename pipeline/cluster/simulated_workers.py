"""Any number of simulated workers on one machine: scheduler, client, feeder and messages are the real ones.

Many Dask workers live in each of a few processes, and a stand-in does their orders: it sleeps as long as the views
would take, or only says so. What is left is what handing out views costs.
"""

import asyncio
import json
import os
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from ..dataset.chunks import TARGET_SECONDS
from ..errors import RunError
from ..evaluation.scaling.cluster_model import Cluster
from ..evaluation.scaling.dataset_times import peak_mb
from .call import ANSWER
from .feeder import Feeder, Pace
from .orders import Order, Outcome
from .render_task import Surroundings
from .sources import WorkerSource, connected_client, quiet_dask
from .tasks import BEAT_SECONDS, TASKS

TASK = "stand-in"
_ROOT = Path(__file__).resolve().parents[2]


@dataclass(frozen=True)
class StandIn:
    """What stands in for rendering.

    Attributes
    ----------
    views
        Number of views.
    seconds_per_view
        Mean time of a view, s.
    sleeps
        Whether an order takes as long as it says.
    spread, slow_share, slow_factor, view_spread
        As in :class:`.Cluster`.
    target_seconds
        Time that an order should take, s.
    seed
        Of the times and speeds.
    orders_held
        As in :class:`.Cluster`.
    """

    views: int
    seconds_per_view: float = 1.0
    sleeps: bool = False
    spread: float = 0.0
    slow_share: float = 0.0
    slow_factor: float = 1.0
    view_spread: float = 0.0
    target_seconds: float = TARGET_SECONDS
    seed: int = 0
    orders_held: int = 1

    def modelled(self, workers: int, *, order_seconds: float = 0.0) -> Cluster:
        """The same in the model, with what an order costs, s."""
        return Cluster(
            workers,
            order_seconds=order_seconds,
            spread=self.spread,
            slow_share=self.slow_share,
            slow_factor=self.slow_factor,
            view_spread=self.view_spread,
            target_seconds=self.target_seconds,
            orders_held=self.orders_held,
        )

    def times(self, workers: int) -> tuple[np.ndarray, np.ndarray]:
        """``(views,)`` times of the views at speed 1, s, and ``(workers,)`` speeds, as the model draws them."""
        cluster, generator = self.modelled(workers), np.random.default_rng(self.seed)
        return cluster.durations(self.views, self.seconds_per_view, generator), cluster.speeds(generator)


@dataclass(frozen=True)
class EngineRun:
    """What a run of the real engine took.

    Attributes
    ----------
    workers, views, orders
        Their numbers.
    seconds
        From the first order to the last outcome, s.
    client_seconds, scheduler_seconds
        Time of the processor in the process of the client and of the scheduler, s.
    client_mb, scheduler_mb
        Peak of their memory, MiB.
    """

    workers: int
    views: int
    orders: int
    seconds: float
    client_seconds: float
    scheduler_seconds: float
    client_mb: float
    scheduler_mb: float

    @property
    def order_seconds(self) -> float:
        """Time of client and scheduler for an order, s."""
        return (self.client_seconds + self.scheduler_seconds) / self.orders


def run_engine(workers: int, stand_in: StandIn, *, processes: int = 2) -> EngineRun:
    """Let simulated workers do all views.

    Raises
    ------
    RunError
        A view was not done, or was done twice; or the workers cannot be started.
    """
    with ExitStack() as stack:
        stack.enter_context(quiet_dask())
        scheduler = stack.enter_context(_child("scheduler", str(stand_in.orders_held)))
        address = _first_line(scheduler)
        shares = [[*range(first, workers, processes)] for first in range(min(processes, workers))]
        children = [stack.enter_context(_child("workers", address, json.dumps(share))) for share in shares]
        for child in children:
            _first_line(child)
        client = stack.enter_context(connected_client(address))
        client.wait_for_workers(workers, timeout=300)
        source = WorkerSource(client, "simulated", address, False, workers, True, "")
        feeder = Feeder(
            source,
            ANSWER,
            run="0" * 16,
            task=TASK,
            job={"workers": workers, "stand_in": asdict(stand_in)},
            items=range(stand_in.views),
            pace=Pace(order=stand_in.target_seconds),
        )
        begin, own, other = time.perf_counter(), time.process_time(), _processor_seconds(scheduler.pid)
        tally = feeder.run()
        run = EngineRun(
            workers,
            stand_in.views,
            tally.orders,
            time.perf_counter() - begin,
            time.process_time() - own,
            _processor_seconds(scheduler.pid) - other,
            peak_mb(),
            peak_mb(scheduler.pid),
        )
    if tally.done != stand_in.views:
        raise RunError(f"simulated workers: expected {stand_in.views} views done, found {tally.done}")
    return run


def perform(order: Order, worker: Surroundings) -> Outcome:
    """Stand in for rendering: see :class:`StandIn`."""
    from distributed import get_worker

    stand_in, workers = StandIn(**order.job["stand_in"]), int(order.job["workers"])
    durations, speeds = _times(stand_in, workers)
    begin, taken, done, beats = time.monotonic(), 0.0, 0, 0
    speed = float(speeds[int(get_worker().name)])
    for item in order.items:
        if taken >= order.budget_seconds:
            break
        taken += float(durations[item]) / speed
        done += 1
        if stand_in.sleeps:
            time.sleep(max(0.0, begin + taken - time.monotonic()))
            worker.beat("rendering", done)
        else:
            # as many signs of life as in that time; a change of state is reported at once
            while taken >= beats * BEAT_SECONDS:
                worker.beat(("rendering", "starting")[beats % 2], done)
                beats += 1
    return Outcome(
        order.number, worker.address, worker.host, finished=order.items[:done], left=order.items[done:], seconds=taken
    )


@lru_cache(maxsize=4)
def _times(stand_in: StandIn, workers: int) -> tuple[np.ndarray, np.ndarray]:
    return stand_in.times(workers)


def _processor_seconds(process: int) -> float:
    fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


@contextmanager
def _child(*arguments: str) -> Iterator[subprocess.Popen[str]]:
    """A process that runs :func:`main` until the context ends."""
    process = subprocess.Popen(
        [sys.executable, "-m", "pipeline.cluster.simulated_workers", *arguments],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        env=os.environ | {"PYTHONPATH": os.pathsep.join([str(_ROOT), *filter(None, sys.path)])},
    )
    try:
        yield process
    finally:
        process.kill()
        process.wait()


def _first_line(child: subprocess.Popen[str]) -> str:
    """What a child process says when it is ready."""
    line = child.stdout.readline().strip() if child.stdout else ""
    if not line:
        raise RunError(f"simulated workers: a process ended with code {child.wait()} before it was ready")
    return line


def main(kind: str, *arguments: str) -> None:
    """Act as a child process, until its input ends."""
    import dask

    # thousands of workers in a few busy processes are late, but not dead
    dask.config.set({"distributed.scheduler.worker-ttl": None, "distributed.admin.tick.limit": "600s"})
    if kind == "scheduler":
        dask.config.set({"distributed.scheduler.worker-saturation": float(arguments[0])})
    else:
        # each would look at all threads of its process a hundred times a second
        dask.config.set(
            {
                "distributed.worker.profile.enabled": False,
                "distributed.worker.profile.interval": "1h",
                "distributed.worker.profile.cycle": "1h",
                "distributed.admin.system-monitor.interval": "1h",
            }
        )
    threading.Thread(target=lambda: (sys.stdin.read(), os._exit(0)), daemon=True).start()
    TASKS[TASK] = perform
    asyncio.run(_scheduler() if kind == "scheduler" else _workers(arguments[0], json.loads(arguments[1])))


def _announce(text: str) -> None:
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


async def _scheduler() -> None:
    from distributed import Scheduler

    async with Scheduler(host="127.0.0.1", port=0, dashboard=False) as scheduler:
        _announce(scheduler.address)
        await scheduler.finished()


async def _workers(address: str, numbers: list[int]) -> None:
    from distributed import Worker

    workers: list[Any] = []
    for number in numbers:
        workers.append(
            await Worker(address, name=number, nthreads=1, memory_limit=0, dashboard=False, host="127.0.0.1")
        )
    _announce(f"{len(workers)} workers")
    await asyncio.gather(*(worker.finished() for worker in workers))


if __name__ == "__main__":
    main(*sys.argv[1:])
