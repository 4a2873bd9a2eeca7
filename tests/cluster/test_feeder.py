"""The feeder on a real Dask scheduler with workers in this process, whose orders are stand-ins that take no time."""

import socket
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import replace

import pytest

pytest.importorskip("distributed", reason='needs Dask: pip install "oneframe[cluster]"')

from distributed import Client, LocalCluster, get_worker

from pipeline.cluster.call import ANSWER, Call
from pipeline.cluster.feeder import Feeder, Pace
from pipeline.cluster.orders import Order, Outcome
from pipeline.cluster.sources import WorkerSource, open_source, quiet_dask
from pipeline.cluster.tally import Tally
from pipeline.errors import InputError, RunError

PACE = Pace(look=0.05, no_worker=0.3, silence=0.5, gone=5.0, order=0.05)
ITEMS = range(200)


@pytest.fixture
def cluster() -> Iterator[LocalCluster]:
    with quiet_dask():
        three = LocalCluster(
            n_workers=3, threads_per_worker=1, processes=False, dashboard_address=None, silence_logs=100
        )
        yield three
        with suppress(TimeoutError):  # its scheduler has gone, or a worker still sleeps
            three.close(timeout=1)


ORDERS: list[tuple[str, tuple[int, ...]]] = []
"""Who got what."""
DO: list[Callable[[Order, str], Outcome]] = []
"""What workers do. They are in this process, and Dask pickles :func:`task` by its name."""


def task(text: str) -> str:
    order, worker = Order.from_text(text), get_worker().address
    ORDERS.append((worker, order.items))
    return DO[0](order, worker).to_text()


def done(order: Order, worker: str, **changes) -> Outcome:
    outcome = Outcome(order.number, worker, "host", finished=order.items, seconds=0.001 * len(order.items))
    return replace(outcome, **changes)


def beat(order: Order, items: int) -> None:
    worker = get_worker()
    message = {"number": order.number, "worker": worker.address, "state": "rendering", "done": items}
    worker.log_event(f"oneframe-{order.run}", message)


class Run:
    """A feeder with all that it says."""

    def __init__(self, cluster: LocalCluster, do: Callable[[Order, str], Outcome], **source) -> None:
        ORDERS.clear()
        DO[:] = [do]
        self.client = Client(cluster, set_as_default=False)
        self.notes: list[str] = []
        self.shown: list[tuple[int, str]] = []
        workers = WorkerSource(self.client, "", cluster.scheduler_address, True, 3, False, "start one", 1)
        self.feeder = Feeder(
            replace(workers, **source),
            Call(task, lambda text: (text,)),
            run="0" * 16,
            task="stand-in",
            job={},
            items=ITEMS,
            pace=PACE,
            show=lambda done, state: self.shown.append((done, state)),
            note=self.notes.append,
        )

    def finish(self) -> Tally:
        try:
            return self.feeder.run()
        finally:
            self.client.close()


def handed_out() -> Counter:
    """How often each item was ordered."""
    return Counter(item for _, items in ORDERS for item in items)


def test_all_items_are_done_once_by_all_workers(cluster):
    def do(order: Order, worker: str) -> Outcome:
        time.sleep(0.002)
        return done(order, worker)

    run = Run(cluster, do)
    tally = run.finish()
    assert (tally.done, tally.found, tally.again, tally.twice) == (len(ITEMS), 0, 0, 0)
    assert handed_out() == Counter(ITEMS)
    assert len(tally.workers) == 3
    assert run.shown[-1][0] == len(ITEMS)
    assert run.shown[-1][1].startswith("3 workers")
    assert run.notes == []


def test_what_comes_back_undone_goes_out_again(cluster):
    tally = Run(
        cluster, lambda order, worker: done(order, worker, finished=order.items[:1], left=order.items[1:])
    ).finish()
    assert (tally.done, tally.twice) == (len(ITEMS), 0)


def test_a_worker_that_refuses_is_told_once_and_not_asked_again(cluster):
    refusing = min(cluster.scheduler.workers)

    def do(order: Order, worker: str) -> Outcome:
        time.sleep(0.002)
        return (
            done(order, worker, finished=(), refused="it has no Blender") if worker == refusing else done(order, worker)
        )

    run = Run(cluster, do)
    tally = run.finish()
    assert (tally.done, tally.workers) == (len(ITEMS), {*cluster.scheduler.workers} - {refusing})
    assert run.notes == [f"worker {refusing} on host is refused: it has no Blender"]
    assert run.shown[-1][1].endswith("1 refused")
    # only those that were with the scheduler already
    assert 1 <= sum(worker == refusing for worker, _ in ORDERS) <= 6


@pytest.mark.parametrize("can_join", [True, False])
def test_if_all_refuse_the_run_says_why(cluster, can_join):
    run = Run(cluster, lambda order, worker: done(order, worker, finished=(), refused="no Blender"), can_join=can_join)
    with pytest.raises(RunError, match=r"all workers are refused: worker .* on host: no Blender"):
        run.finish()


def test_an_item_that_ends_every_process_stops_the_run_and_is_named(cluster):
    def do(order: Order, worker: str) -> Outcome:
        if 7 not in order.items:
            return done(order, worker)
        at = order.items.index(7)
        return done(
            order,
            worker,
            finished=order.items[:at],
            crashed=(7,),
            left=order.items[at + 1 :],
            lost=("a render process was killed by signal 11",),
        )

    run = Run(cluster, do)
    with pytest.raises(RunError, match=r"^view 7: 3 processes ended while they worked on it .*signal 11 on host"):
        run.finish()
    assert handed_out()[7] == 3
    # from the second time on alone, so that no other one is blamed
    assert [items for _, items in ORDERS if 7 in items][1:] == [(7,), (7,)]
    assert len(run.notes) == 3


def test_an_item_that_ends_one_process_is_done_by_another(cluster):
    hit: list[int] = []

    def do(order: Order, worker: str) -> Outcome:
        if 50 in order.items and not hit:
            hit.append(50)
            left = tuple(item for item in order.items if item != 50)
            return done(order, worker, finished=(), crashed=(50,), left=left, lost=("a render process hung",))
        return done(order, worker)

    run = Run(cluster, do)
    tally = run.finish()
    assert (tally.done, tally.again, tally.processes) == (len(ITEMS), 1, 1)
    assert handed_out()[50] == 2


def test_input_that_no_worker_can_use_is_an_input_error(cluster):
    run = Run(
        cluster, lambda order, worker: done(order, worker, finished=(), wrong_input="no pose meets the constraints")
    )
    with pytest.raises(InputError, match="no pose meets the constraints"):
        run.finish()


def test_a_defect_on_all_workers_stops_the_run(cluster):
    def do(order: Order, worker: str) -> Outcome:
        raise KeyError("a defect")

    run = Run(cluster, do)
    with pytest.raises(RunError, match=r"the workers cannot do orders \(KeyError: 'a defect'\)"):
        run.finish()


def test_workers_may_leave_and_join(cluster):
    first = {*cluster.scheduler.workers}

    leaving: list[str] = []

    def do(order: Order, worker: str) -> Outcome:
        beat(order, 0)
        time.sleep(0.01 * len(order.items))
        if len(ORDERS) >= 4 and not leaving:
            leaving.append(worker)
            # abruptly: what it has done is lost with it
            cluster.loop.add_callback(cluster.scheduler.remove_worker, address=worker, stimulus_id="test", close=False)
            cluster.scale(5)
        return done(order, worker, seconds=0.01 * len(order.items))

    run = Run(cluster, do)
    tally = run.finish()
    assert tally.done - tally.twice == len(ITEMS)
    assert any("has gone; its orders go to others" in note for note in run.notes)
    assert tally.workers - first


def test_a_worker_that_falls_silent_holds_nothing_back(cluster):
    """Dask still has it, as it has one whose program was stopped or whose folder hangs."""
    silent: list[str] = []
    begin = time.monotonic()

    def do(order: Order, worker: str) -> Outcome:
        beat(order, 0)
        if not silent:
            silent.append(worker)
        if worker == silent[0]:
            time.sleep(4)
        return done(order, worker)

    run = Run(cluster, do)
    tally = run.finish()
    assert tally.done == len(ITEMS)
    assert time.monotonic() - begin < 3.5
    assert silent[0] not in tally.workers


def test_without_workers_the_run_waits_and_says_so(cluster):
    cluster.scale(0)
    while cluster.scheduler.workers:
        time.sleep(0.01)
    run = Run(cluster, done)
    run.feeder._note = lambda text: (run.notes.append(text), cluster.scale(2))
    tally = run.finish()
    assert tally.done == len(ITEMS)
    assert run.notes == [f"no worker is connected to {cluster.scheduler_address}: waiting; start one"]


def test_a_scheduler_that_goes_ends_the_run(cluster):
    def do(order: Order, worker: str) -> Outcome:
        if len(ORDERS) >= 10:
            cluster.loop.add_callback(cluster.scheduler.close)
        time.sleep(0.02)
        return done(order, worker)

    run = Run(cluster, do)
    run.client._timeout = 0.5
    with pytest.raises(RunError, match=r"the scheduler .* no longer answers; what is finished is safe"):
        run.finish()


def test_a_stopped_feeder_leaves_nothing_with_the_scheduler(cluster):
    run: Run

    def do(order: Order, worker: str) -> Outcome:
        run.feeder.stop()
        time.sleep(0.05)
        return done(order, worker)

    run = Run(cluster, do)
    begin = time.monotonic()
    assert run.finish().done < len(ITEMS)
    assert time.monotonic() - begin < 2
    while cluster.scheduler.tasks:
        assert time.monotonic() - begin < 10
        time.sleep(0.01)


def test_a_worker_of_another_version_refuses_by_the_text_that_it_gets(cluster):
    """As sent: through ``eval``, without anything of OneFrame on the way."""
    with Client(cluster, set_as_default=False) as client:
        order = Order(4, "1" * 16, "render", "99.0", {}, (1,), 1.0)
        outcome = Outcome.from_text(client.submit(ANSWER.function, *ANSWER.arguments(order.to_text())).result())
    assert outcome.number == 4
    assert outcome.worker in cluster.scheduler.workers
    assert "the run has 99.0" in outcome.refused


@pytest.mark.parametrize(
    ("where", "error", "message"),
    [
        (
            "somewhere",
            InputError,
            "expected the address of a Dask scheduler, .*, local:N or slurm",
        ),
        ("local:none", InputError, "expected local:N with N from 1 to 1024"),
        (
            "tcp://127.0.0.1:9",
            RunError,
            r"at tcp://127.0.0.1:9, found none .*dask scheduler --port 9.*dask worker tcp://",
        ),
    ],
)
def test_no_scheduler(where, error, message, monkeypatch):
    monkeypatch.setattr("pipeline.cluster.sources.CONNECT_SECONDS", 0.5)
    with pytest.raises(error, match=message), open_source(where):
        pass


def test_what_listens_but_is_no_scheduler(monkeypatch):
    monkeypatch.setattr("pipeline.cluster.sources.CONNECT_SECONDS", 0.2)
    with socket.create_server(("127.0.0.1", 0)) as server:
        server.listen()
        where = f"tcp://127.0.0.1:{server.getsockname()[1]}"

        def greet() -> None:
            with server.accept()[0] as connection:
                connection.sendall(b"HTTP/1.0 400 Bad request, and then nothing")
                time.sleep(3)

        threading.Thread(target=greet, daemon=True).start()
        with pytest.raises(RunError, match=f"expected a Dask scheduler at {where}, found none"), open_source(where):
            pass
