"""An order on a worker: its process lives on, fails in every way, and is never waited for in vain."""

import dataclasses
import sys
import time
from collections import Counter
from pathlib import Path

import pytest

pytest.importorskip("distributed", reason='needs Dask: pip install "oneframe[cluster]"')

from pipeline.cluster import render_processes
from pipeline.cluster.orders import Order, Outcome
from pipeline.cluster.render_task import Limits, RenderJob, perform
from pipeline.dataset.folder import run_token

STAND_IN = Path(__file__).with_name("stand_in_process.py")


@dataclasses.dataclass
class Worker:
    address: str = "tcp://a:1"
    host: str = "a"
    closing: bool = False
    states: list[str] = dataclasses.field(default_factory=list)

    def beat(self, state: str, done: int) -> None:
        self.states.append(state)

    def is_closing(self) -> bool:
        return self.closing


@pytest.fixture
def order(tmp_path, request):
    """Makes orders of one run on a stand-in that fails in a certain way."""
    runs = set()

    def make(*views: int, fails: str = "none", budget: float = 60.0, alone: bool = False, **changes) -> Order:
        run = f"{abs(hash((request.node.name, fails))):016x}"[-16:]
        runs.add(run)
        run_token(tmp_path, run).parent.mkdir(exist_ok=True)
        run_token(tmp_path, run).touch()
        job = RenderJob(
            case="case.toml",
            out=str(tmp_path),
            arguments=(),
            identity="ab" * 32,
            kinds=("rgb",),
            threads=1,
            client="home",
            # "--out" and what follows it is ignored
            command=(sys.executable, str(STAND_IN), fails, str(tmp_path)),
            limits=Limits(look=0.3, start=30.0, view=1.0),
        )
        job = dataclasses.replace(job, **changes)
        return Order(1, run, "render", "0", job.to_json(), views, budget, alone)

    yield make
    for run in runs:
        render_processes.end_run(run)


def rendered(folder: Path) -> Counter:
    """How often each view was rendered."""
    return Counter(int(path.name.partition("-")[0]) for path in folder.glob("*-*") if path.name[0].isdigit())


def processes(folder: Path) -> set[int]:
    return {int(path.name.partition("-")[2]) for path in folder.glob("*-*") if path.name[0].isdigit()}


def test_an_order_travels_as_text(order):
    sent = order(1, 2, 5)
    received = Order.from_text(sent.to_text())
    assert received.items == (1, 2, 5)
    assert RenderJob.from_json(received.job) == RenderJob.from_json(sent.job)
    outcome = Outcome(3, "tcp://a:1", "a", finished=(1, 2), left=(5,), lost=("x",), seconds=0.25)
    assert Outcome.from_text(outcome.to_text()) == outcome


def test_one_process_does_order_after_order(order, tmp_path):
    worker = Worker()
    for views in ((0, 1, 2), (3, 4), (5,)):
        outcome = perform(order(*views), worker)
        assert (outcome.finished, outcome.left, outcome.lost, outcome.refused) == (views, (), (), "")
        assert 0 < outcome.seconds < 5
    assert rendered(tmp_path) == Counter(range(6))
    assert len(processes(tmp_path)) == 1
    assert {"starting", "rendering"} >= {*worker.states}


def test_what_exceeds_the_budget_comes_back(order, tmp_path):
    outcome = perform(order(*range(500), budget=0.5), Worker())
    assert 0 < len(outcome.finished) < 500
    assert outcome.finished + outcome.left == tuple(range(500))
    assert rendered(tmp_path) == Counter(outcome.finished)


def test_a_worker_that_ends_begins_nothing(order):
    outcome = perform(order(0, 1, 2), Worker(closing=True))
    assert (outcome.finished, outcome.left) == ((), (0, 1, 2))


@pytest.mark.parametrize(
    ("fails", "how"),
    [
        ("crash", "a render process was killed by signal 11"),
        ("hang", "a render process finished no view for 1 s and was ended"),
    ],
)
def test_the_view_that_ends_a_process_is_named_and_the_others_come_back(order, fails, how):
    outcome = perform(order(1, 2, 3, 4, 5, 6, fails=fails), Worker())
    assert (outcome.finished, outcome.crashed, outcome.left) == ((1, 2), (3,), (4, 5, 6))
    assert outcome.lost == (how,)
    # a new process
    outcome = perform(order(4, 5, fails=fails), Worker())
    assert (outcome.finished, outcome.refused) == ((4, 5), "")


def test_a_process_that_cannot_open_the_job_refuses_the_worker(order):
    outcome = perform(order(1, 2, fails="no input"), Worker())
    assert outcome.refused == "frame.png: expected an image, found none"
    assert (outcome.finished, outcome.left, outcome.wrong_input) == ((), (1, 2), "")


def test_a_full_disk_refuses_the_worker_and_keeps_what_is_finished(order):
    outcome = perform(order(2, 3, 4, fails="full disk"), Worker())
    assert (outcome.finished, outcome.refused, outcome.left) == ((2,), "the disk is full", (3, 4))


def test_a_view_that_no_input_can_give_is_the_fault_of_no_worker(order):
    outcome = perform(order(3, 4, fails="no pose"), Worker())
    assert (outcome.wrong_input, outcome.refused) == ("no pose meets the constraints", "")


def test_processes_that_end_as_they_start_refuse_the_worker_at_last(order):
    outcomes = [perform(order(1, fails="defect"), Worker()) for _ in range(3)]
    assert [bool(outcome.refused) for outcome in outcomes] == [False, False, True]
    assert "ended with code 1 (ImportError: libX11.so.6)" in outcomes[2].refused
    assert [outcome.left for outcome in outcomes] == [(1,)] * 3
    assert all(outcome.crashed == () for outcome in outcomes)


def test_a_worker_that_does_not_see_the_folder_says_which_and_whose(order, tmp_path):
    missing = perform(order(1, out="/no/such/folder"), Worker()).refused
    assert "home" in missing
    assert "/no/such/folder" in missing
    assert "has no such folder" in missing
    (tmp_path / "other").mkdir()
    assert "has another folder of this name" in perform(order(1, out=str(tmp_path / "other")), Worker()).refused


def test_a_program_that_is_not_there_refuses(order):
    assert "cannot start /no/blender" in perform(order(1, command=("/no/blender",)), Worker()).refused
    assert "cannot start /no/blender" in perform(order(1, blender="/no/blender"), Worker()).refused


def test_ending_a_run_ends_its_processes_and_another_run_in_the_folder_does_too(order, monkeypatch):
    first = order(1, 2)
    perform(first, Worker())
    process = render_processes.take(first.run, first.job["out"])
    assert process is not None
    assert process.is_alive()
    render_processes.give_back(first.run, process)
    second = order(1, fails="crash")
    assert second.run != first.run
    perform(second, Worker())
    assert process.ending().code < 0
    other = render_processes.take(second.run, second.job["out"])
    assert other is not None
    render_processes.end_run(second.run)
    assert other.ending().code < 0


def test_an_idle_process_ends(order, monkeypatch):
    monkeypatch.setattr(render_processes, "IDLE_SECONDS", 0.2)
    sent = order(1)
    perform(sent, Worker())
    process = render_processes.take(sent.run, sent.job["out"])
    render_processes.give_back(sent.run, process)
    give_up = time.monotonic() + 20
    while process.is_alive():
        assert time.monotonic() < give_up
        time.sleep(0.05)
    assert render_processes.take(sent.run, sent.job["out"]) is None
