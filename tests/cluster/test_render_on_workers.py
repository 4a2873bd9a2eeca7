"""Render processes on a worker: they live on, fail in every way, and are never waited for in vain."""

import shutil
import sys
from collections import Counter
from pathlib import Path

import pytest

pytest.importorskip("distributed", reason='needs Dask: pip install "oneframe[cluster]"')

from oneframe.cluster import on_worker, render_on_workers
from oneframe.cluster.on_worker import LostError
from oneframe.cluster.render_on_workers import RenderOnWorker
from oneframe.dataset.run.work_folder import run_token
from oneframe.errors import InputError, RunError
from tests.waiting import wait_until

STAND_IN = Path(__file__).with_name("stand_in_process.py")


@pytest.fixture
def opened(tmp_path, monkeypatch):
    """Opens a run on a worker, whose stand-in fails in a certain way."""
    monkeypatch.setattr(on_worker, "LOOK_SECONDS", 0.3)
    monkeypatch.setattr(render_on_workers, "_RENDER", (sys.executable,))
    plugins = []

    def make(fails: str = "none", **changes) -> RenderOnWorker:
        run_token(tmp_path, "0" * 16).parent.mkdir(exist_ok=True)
        run_token(tmp_path, "0" * 16).touch()
        plugin = RenderOnWorker(
            run="0" * 16,
            folder=str(tmp_path),
            # what follows is ignored
            arguments=(str(STAND_IN), fails, str(tmp_path)),
            blender=None,
            identity="ab" * 32,
            kinds=("rgb",),
            damaged=frozenset(),
            description=None,
        )
        for name, value in changes.items():
            setattr(plugin, name, value)
        plugins.append(plugin)
        plugin.open(tmp_path / "own", None)
        return plugin

    yield make
    for plugin in plugins:
        plugin.teardown(None)


def rendered(folder: Path) -> Counter:
    """How often each view was rendered."""
    return Counter(int(path.name.partition("-")[0]) for path in folder.glob("[0-9]*-*"))


def test_one_process_does_order_after_order(opened, tmp_path):
    plugin = opened()
    for views in ((0, 1, 2), (3, 4), (5,)):
        assert plugin.do(views) == {view: {} for view in views}
    assert rendered(tmp_path) == Counter(range(6))
    assert len({path.name.partition("-")[2] for path in tmp_path.glob("[0-9]*-*")}) == 1


@pytest.mark.parametrize(
    ("fails", "how"),
    [
        ("crash", "a render process was killed by signal 11 (without a word)"),
        ("hang", "a render process finished no view for 1 s and was ended (without a word)"),
    ],
)
def test_the_view_that_ends_a_process_is_named_and_another_process_goes_on(opened, monkeypatch, tmp_path, fails, how):
    plugin = opened(fails)
    monkeypatch.setattr(render_on_workers, "VIEW_SECONDS", 1.0)
    with pytest.raises(LostError) as caught:
        plugin.do((1, 2, 3, 4, 5, 6))
    assert str(caught.value) == f"view 3: {how}"
    monkeypatch.undo()
    assert {*plugin.do((4, 5))} == {4, 5}
    assert {*rendered(tmp_path)} == {1, 2, 4, 5}


@pytest.mark.parametrize(
    ("fails", "kind", "message"),
    [
        ("no input", RunError, "frame.png: expected an image, found none"),
        ("defect", LostError, "before it rendered, a render process ended with code 1 (ImportError: libX11.so.6)"),
        # a view that no input can give is the fault of no worker
        ("no pose", InputError, "no pose meets the constraints"),
        ("full disk", RunError, "the disk is full"),
    ],
)
def test_what_a_process_says_decides_whose_fault_it_is(opened, fails, kind, message):
    with pytest.raises(kind) as caught:
        opened(fails).do((2, 3, 4))
    assert (type(caught.value), str(caught.value)) == (kind, message)


def test_a_worker_that_does_not_see_the_folder_says_which_and_whose(opened, tmp_path):
    with pytest.raises(RunError, match=r"that home writes to: /no/such/folder; the machine has no such folder"):
        opened(folder="/no/such/folder", client="home")
    (tmp_path / "other").mkdir()
    with pytest.raises(RunError, match="has another folder of this name"):
        opened(folder=str(tmp_path / "other"))


@pytest.mark.parametrize("why", ["it waits for orders in vain", "the run ends"])
def test_processes_end_if(opened, monkeypatch, tmp_path, why):
    monkeypatch.setattr(render_on_workers, "IDLE_SECONDS", 1e9 if why == "the run ends" else 0.01)
    plugin = opened()
    (process,) = plugin._processes
    if why == "the run ends":
        plugin.teardown(None)
        with pytest.raises(LostError):
            plugin.do((1,))
        assert not (tmp_path / "own").exists()
    wait_until(lambda: not process.is_alive())


def test_views_that_are_gathered_leave_the_machine(opened, tmp_path, monkeypatch):
    paths = {kind: Path(f"train_synt/000000/{kind}/000001.{end}") for kind, end in (("rgb", "png"), ("frame", "json"))}
    plugin = opened(description={"count": 3}, folder="")
    monkeypatch.setattr(render_on_workers, "is_finished", lambda *_: True)
    for kind, path in paths.items():
        (plugin._out / path).parent.mkdir(parents=True)
        (plugin._out / path).write_bytes(kind.encode())
    assert plugin.do((1,)) == {1: {path.as_posix(): kind.encode() for kind, path in paths.items()}}
    shutil.rmtree(plugin._out / "train_synt")
    assert not [path for path in plugin._out.rglob("*") if path.name != "dataset.json"]
