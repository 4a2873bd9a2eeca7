"""Orders on a real Dask scheduler with workers in this process, whose plugin is a stand-in that takes no time."""

import os
import re
import subprocess
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import closing, suppress
from dataclasses import dataclass
from io import StringIO
from typing import Any

import pytest

pytest.importorskip("distributed", reason='needs Dask: pip install "oneframe[cluster]"')

from distributed import Client, LocalCluster, get_worker
from hypothesis import given
from hypothesis import strategies as st

from oneframe.cluster import orders
from oneframe.cluster.on_worker import LostError, OnWorker
from oneframe.cluster.orders import MOST_ITEMS, ORDER_SECONDS, Orders, order_size
from oneframe.errors import InputError, RunError
from oneframe.progress import Progress
from tests.waiting import wait_until

ITEMS = range(200)

OPEN: list[Callable[[str], None]] = []
DO: list[Callable[[tuple[int, ...], str], dict[int, Any]]] = []
"""What workers do as they begin, and at an order; they are in this process, and get these by the module's name."""
DONE: list[tuple[str, tuple[int, ...]]] = []
"""Who got what."""
CLOSED: list[str] = []


@dataclass
class StandIn(OnWorker):
    def open(self, own_folder, case):
        OPEN[0](get_worker().address)

    def do(self, items):
        worker = get_worker().address
        DONE.append((worker, items))
        return DO[0](items, worker)

    def teardown(self, worker):
        CLOSED.append(worker.address)


@pytest.fixture
def cluster(monkeypatch) -> Iterator[LocalCluster]:
    monkeypatch.setattr(orders, "LOOK_SECONDS", 0.05)
    monkeypatch.setattr(orders, "NO_WORKER_SECONDS", 0.3)
    monkeypatch.setattr(orders, "ORDER_SECONDS", 0.05)
    DONE.clear()
    CLOSED.clear()
    OPEN[:], DO[:] = [lambda _worker: None], [lambda items, _worker: done(items)]
    three = LocalCluster(
        n_workers=3, threads_per_worker=1, processes=False, protocol="tcp://", dashboard_address=None, silence_logs=100
    )
    yield three
    with suppress(TimeoutError):  # its scheduler has gone
        three.close(1)


def done(items) -> dict[int, Any]:
    time.sleep(0.002 * len(items))
    return dict.fromkeys(items)


class Run:
    """Orders, with all that they say."""

    def __init__(self, cluster: LocalCluster, plugin: OnWorker | None = None) -> None:
        self.client, self.text = Client(cluster, set_as_default=False), StringIO()
        progress = Progress(len(ITEMS), "views", stream=self.text)
        self.orders = Orders(self.client, plugin or StandIn("0" * 16, ""), ITEMS, progress)

    @property
    def notes(self) -> list[str]:
        return [line for line in self.text.getvalue().splitlines() if "views" not in line]

    def finish(self) -> Counter:
        """How often each item was done."""
        with self.client, closing(self.orders.outcomes()) as outcomes:
            return Counter(item for one in outcomes for item in one)


def test_all_items_are_done_once_by_all_workers_which_then_end(cluster):
    run = Run(cluster)
    assert run.finish() == Counter(ITEMS)
    assert len({worker for worker, _ in DONE}) == 3
    assert Counter(CLOSED) == Counter({*cluster.scheduler.workers})
    assert (run.notes, run.orders.state()) == ([], "3 workers")


def test_what_an_order_leaves_goes_out_again(cluster):
    DO[0] = lambda items, _worker: done(items[:1])
    assert Run(cluster).finish() == Counter(ITEMS)


@pytest.mark.parametrize("when", ["at first", "at an order"])
def test_a_worker_that_refuses_is_told_once_and_not_asked_again(cluster, when):
    refusing = min(cluster.scheduler.workers)

    def refuse(worker: str) -> None:
        if worker == refusing:
            raise RunError("it has no Blender")

    if when == "at first":
        OPEN[0] = refuse
    else:
        DO[0] = lambda items, worker: refuse(worker) or done(items)
    run = Run(cluster)
    assert run.finish() == Counter(ITEMS)
    assert run.notes == [f"worker {refusing} is refused: it has no Blender"]
    assert run.orders.state() == "2 workers; 1 refused"
    # orders that were out already, one for each worker, may still come to it
    assert sum(worker == refusing for worker, _ in DONE) in (range(1) if when == "at first" else range(1, 4))


def test_if_all_refuse_the_run_says_why(cluster):
    def refuse(worker: str) -> None:
        raise OSError(28, "No space left on device", "/tmp/case")

    OPEN[0] = refuse
    with pytest.raises(RunError, match=r"^all workers are refused: /tmp/case: No space left on device$"):
        Run(cluster).finish()


@pytest.mark.parametrize(
    ("content", "why"),
    [
        ("raise ModuleNotFoundError('No module named it')", r"its Python has no OneFrame \(No module named it\)"),
        ("__version__ = '0.0'", r"it has OneFrame 0\.0, the run has \S+"),
    ],
)
def test_a_worker_without_oneframe_or_with_another_one_is_refused(cluster, tmp_path, content, why):
    (tmp_path / "oneframe").mkdir()
    (tmp_path / "oneframe/__init__.py").write_text(content)
    command = [sys.executable, "-m", "distributed.cli.dask_worker", cluster.scheduler_address, "--no-nanny"]
    lacking = subprocess.Popen(
        [*command, "--no-dashboard"],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": str(tmp_path)},
        stderr=subprocess.DEVNULL,
    )
    try:
        wait_until(lambda: len(cluster.scheduler.workers) == 4, lacking)
        run = Run(cluster)
        DO[0] = lambda items, _worker: wait_until(lambda: run.notes, lacking) or done(items)
        assert run.finish() == Counter(ITEMS)
        # it serves others
        assert lacking.poll() is None
    finally:
        lacking.kill()
        lacking.wait()
    (note,) = run.notes
    assert re.fullmatch(rf"worker \S+ is refused: {why}; install OneFrame .*", note)


def test_a_dead_process_is_tried_again_and_at_last_named(cluster):
    def do(items, worker):
        if 7 in items and len([one for one in DONE if 7 in one[1]]) <= deaths:
            raise LostError("view 7: a render process was killed by signal 11")
        return done(items)

    DO[0], deaths = do, 2
    assert Run(cluster).finish() == Counter(ITEMS)
    DONE.clear()
    deaths = 99
    with pytest.raises(RunError, match=r"^view 7: a render process was killed by signal 11 \(3 times at one order"):
        Run(cluster).finish()
    assert len([one for one in DONE if 7 in one[1]]) == 3


@pytest.mark.parametrize(
    ("error", "message"), [(InputError, "no pose"), (KeyError, "'a defect' .3 times at one order")]
)
def test_what_no_worker_can_do_ends_the_run(cluster, error, message):
    def do(items, worker):
        raise error("no pose" if error is InputError else "a defect")

    DO[0] = do
    with pytest.raises(InputError if error is InputError else RunError, match=message):
        Run(cluster).finish()


def test_workers_may_leave_and_join(cluster):
    first, leaving = {*cluster.scheduler.workers}, []

    def do(items, worker):
        if len(DONE) >= 4 and not leaving:
            leaving.append(worker)
            # abruptly: what it has done is lost with it
            cluster.loop.add_callback(cluster.scheduler.remove_worker, address=worker, stimulus_id="test", close=False)
            cluster.scale(5)
        time.sleep(0.02)
        return done(items)

    DO[0] = do
    run = Run(cluster)
    assert {*run.finish()} == {*ITEMS}
    assert any("has gone; its orders go to others" in note for note in run.notes)
    assert {worker for worker, _ in DONE} - first


def test_orders_outlive_all_workers_that_could_do_them(cluster):
    cluster.scale(0)
    wait_until(lambda: not cluster.scheduler.workers)
    run = Run(cluster)
    thread = threading.Thread(target=lambda: (wait_until(lambda: run.notes), cluster.scale(2)))
    thread.start()

    def do(items, worker):
        if len({worker for worker, _ in DONE}) < 2:
            # all of them, whose orders nobody else may do
            for address in [*cluster.scheduler.workers]:
                remove = cluster.scheduler.remove_worker
                cluster.loop.add_callback(remove, address=address, stimulus_id="test", close=False)
            cluster.scale(len(DONE) + 3)
            time.sleep(0.5)
        return done(items)

    DO[0] = do
    assert {*run.finish()} == {*ITEMS}
    thread.join()
    start = f"start one on any machine: dask worker {cluster.scheduler_address}"
    assert run.notes[0] == f"no worker is connected to {cluster.scheduler_address}: waiting; {start}"


def test_a_scheduler_that_goes_ends_the_run(cluster, monkeypatch):
    monkeypatch.setattr(orders, "GONE_SECONDS", 0.5)

    def do(items, worker):
        if len(DONE) >= 5:
            cluster.loop.add_callback(cluster.scheduler.close)
        return done(items)

    DO[0], run = do, Run(cluster)
    run.client._timeout = 0.5
    with pytest.raises(RunError, match=r"the scheduler .* no longer answers; start it, what is finished is safe"):
        run.finish()


def test_a_stopped_run_leaves_nothing_with_the_scheduler(cluster):
    run = Run(cluster)
    with run.client, closing(run.orders.outcomes()) as outcomes:
        next(outcomes)
        outcomes.close()
        wait_until(lambda: not cluster.scheduler.tasks)
    assert {*CLOSED} == {*cluster.scheduler.workers}


@given(st.integers(1, 10**6), st.integers(1, 5000), st.none() | st.floats(1e-4, 300))
def test_an_order_is_no_more_than_its_time_and_half_of_its_share(left, slots, each):
    count = order_size(left, slots, each)
    assert 1 <= count <= min(left, MOST_ITEMS)
    assert count <= max(1, -(-left // (2 * slots)))
    assert each is None or count <= max(1, ORDER_SECONDS / each)
