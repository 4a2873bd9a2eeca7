"""A pack made by Dask workers: the bytes of one made here."""

import sys
from dataclasses import replace
from pathlib import Path

import pytest

pytest.importorskip("distributed", reason='needs Dask: pip install "oneframe[cluster]"')

from oneframe.cluster import on_worker
from oneframe.cluster.pack_on_workers import PackOnWorker
from oneframe.dataset.run.work_folder import run_token
from oneframe.errors import InputError, RunError
from oneframe.packing.pack import PackOptions, on_this_machine, pack_dataset
from tests.dataset.synthetic_dataset import make_dataset
from tests.tree import different_files

ROOT = Path(__file__).resolve().parents[2]
RUN = "0" * 16


@pytest.fixture(scope="module")
def dataset(tmp_path_factory) -> Path:
    root = tmp_path_factory.mktemp("synthetic") / "dataset"
    make_dataset(root)
    return root


def test_workers_pack_the_same_bytes(dataset, tmp_path, run_command):
    with (tmp_path / "log").open("w") as stream:
        pack_dataset(dataset, tmp_path / "here", PackOptions(1), stream=stream)
    command = [sys.executable, "-m", "oneframe.commands", "pack", dataset, "--out", tmp_path / "there"]
    ended = run_command([*map(str, command), "--views-per-shard", "1", "--cluster", "local:2"])
    assert (ended.returncode, ended.stderr) == (0, "")
    assert "4 shards packed by" in ended.stdout
    assert "4/4 views packed" in ended.stdout
    assert different_files(tmp_path / "there", tmp_path / "here") == []


def pack_after(dataset: Path, out: Path, try_plugin) -> None:
    """Pack; before, do what a worker does there with a plugin of the run."""

    def engine(orders, progress):
        # the token of the run, which its client puts there
        run_token(out, RUN).touch()
        try_plugin(PackOnWorker(RUN, str(out), {order.number: order for order in orders}, None), orders)
        run_token(out, RUN).unlink()
        yield from on_this_machine(1)(orders, progress)

    with (out.parent / "log").open("w") as stream:
        pack_dataset(dataset, out, PackOptions(2), engine=engine, stream=stream)


def test_what_a_lost_worker_packed_is_found(dataset, tmp_path):
    def twice(plugin: PackOnWorker, _orders) -> None:
        plugin.open(tmp_path, None)
        first = plugin.do((0, 1))
        state = [path.stat().st_mtime_ns for path in sorted(tmp_path.glob("*.tar"))]
        assert (plugin.do((0, 1)), len(state)) == (first, 2)
        assert [path.stat().st_mtime_ns for path in sorted(tmp_path.glob("*.tar"))] == state

    pack_after(dataset, tmp_path, twice)
    assert not (tmp_path / ".work").exists()


def test_a_worker_with_other_folders_refuses_and_a_damaged_view_ends_the_run(dataset, tmp_path, monkeypatch):
    monkeypatch.setattr(on_worker, "LOOK_SECONDS", 0.0)

    def refused(plugin: PackOnWorker, orders) -> None:
        with pytest.raises(RunError, match=r"client writes to: /nowhere; the machine has no such"):
            replace(plugin, folder="/nowhere", client="client").open(tmp_path, None)
        other = {order.number: replace(order, identity="ab" * 32) for order in orders}
        with pytest.raises(RunError, match="found another one"):
            replace(plugin, shards=other).open(tmp_path, None)
        with pytest.raises(RunError, match="the pack's JPEG files are those of OpenCV 99"):
            replace(plugin, opencv="99").open(tmp_path, None)
        with pytest.raises(InputError):
            replace(plugin, shards=other).do((0,))

    pack_after(dataset, tmp_path, refused)
