"""A pack made by Dask workers: the bytes of one made here."""

import sys
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType

import pytest

pytest.importorskip("distributed", reason='needs Dask: pip install "oneframe[cluster]"')

from pipeline.cluster.orders import Order
from pipeline.cluster.pack_task import PackJob, perform
from pipeline.dataset.folder import run_token
from pipeline.packing.pack import on_this_machine, pack_dataset
from pipeline.packing.source import read_description
from tests.dataset.synthetic_dataset import make_dataset
from tests.different_files import different_files

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def dataset(tmp_path_factory) -> Path:
    root = tmp_path_factory.mktemp("synthetic") / "dataset"
    make_dataset(root)
    return root


def test_workers_pack_the_same_bytes(dataset, tmp_path, run_command):
    with (tmp_path / "log").open("w") as stream:
        pack_dataset(dataset, tmp_path / "here", views_per_shard=1, stream=stream)
    command = [sys.executable, ROOT / "scripts/pack_dataset.py", dataset, "--out", tmp_path / "there"]
    ended = run_command([*map(str, command), "--views-per-shard", "1", "--cluster", "local:2"])
    assert (ended.returncode, ended.stderr) == (0, "")
    assert "4 shards packed by" in ended.stdout
    assert "4/4 views packed" in ended.stdout
    assert different_files(tmp_path / "there", tmp_path / "here") == []


class Worker:
    address, host = "tcp://worker:1", "host"

    def beat(self, state, done):
        pass

    def is_closing(self):
        return False


def order_of(dataset: Path, out: Path, changes: Mapping[str, str] = MappingProxyType({})) -> Order:
    identity = read_description(dataset / "dataset.json").identity
    job = PackJob(str(dataset), str(out), identity, "client", look_seconds=0.0).to_json()
    return Order(1, "0" * 16, "pack", "", job | changes, (0, 1), 60.0)


def test_what_a_lost_worker_packed_is_found(dataset, tmp_path):
    outcomes = []

    def engine(orders, progress):
        # the workers' token, which packing puts there
        run_token(tmp_path, "0" * 16).touch()
        outcomes.extend(perform(order_of(dataset, tmp_path), Worker()) for _ in range(2))
        yield from on_this_machine(1)(orders, progress)

    with (tmp_path.parent / "log").open("w") as stream:
        pack_dataset(dataset, tmp_path, views_per_shard=2, engine=engine, stream=stream)
    first, second = outcomes
    assert (first.finished, first.found, first.refused) == ((0, 1), (), "")
    assert (second.finished, second.found) == ((), (0, 1))
    assert second.results == first.results
    assert not (tmp_path / ".work").exists()


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"out": "/nowhere"}, "does not see the folder that client writes to: /nowhere; the machine has no such"),
        ({"identity": "ab" * 32}, "expected the dataset that client packs, found another one"),
    ],
)
def test_a_worker_with_other_folders_refuses(dataset, tmp_path, changes, why):
    def engine(orders, progress):
        run_token(tmp_path, "0" * 16).touch()
        outcome = perform(order_of(dataset, tmp_path, changes), Worker())
        assert why in outcome.refused
        assert outcome.left == (0, 1)
        raise KeyboardInterrupt
        yield

    with (tmp_path.parent / "log").open("w") as stream, pytest.raises(KeyboardInterrupt):
        pack_dataset(dataset, tmp_path, views_per_shard=2, engine=engine, stream=stream)
