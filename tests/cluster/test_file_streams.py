"""Files to and from a worker: whole or not at all, over the worker's own connections."""

from pathlib import Path

import pytest

distributed = pytest.importorskip("distributed", reason="the extra 'cluster' is not installed")
dask = pytest.importorskip("dask")

from pipeline.cluster import file_streams
from pipeline.cluster.file_streams import WorkerFolder, fill_on_worker, read_from_worker
from pipeline.dataset.checksums import sum_of
from pipeline.errors import RunError


@pytest.fixture(scope="module")
def client():
    with (
        dask.config.set({"distributed.comm.timeouts.connect": "1s"}),
        distributed.LocalCluster(
            n_workers=1, threads_per_worker=2, processes=False, dashboard_address=None, protocol="tcp://"
        ) as cluster,
        distributed.Client(cluster) as client,
    ):
        yield client


@pytest.fixture
def blocks(monkeypatch):
    monkeypatch.setattr(file_streams, "BLOCK_BYTES", 7)


def opened(client, name: str, root: Path) -> str:
    def open_it() -> None:
        WorkerFolder.open(distributed.get_worker(), name, root)

    client.submit(open_it, pure=False).result()
    (address,) = client.nthreads()
    return address


FILES = {"case.toml": b"", "surface/bone.ply": b"0123456", "frame/a b.png": bytes(range(256))}


def cut(data: bytes) -> list[bytes]:
    return [data[at : at + 7] for at in range(0, max(len(data), 1), 7)]


def test_files_arrive_and_come_back(client, blocks, tmp_path):
    address = opened(client, "there and back", tmp_path / "case")
    folder = WorkerFolder.named("there and back")
    assert not folder.wait(0.2)
    fill_on_worker(client, address, "there and back", {name: (sum_of(d), cut(d)) for name, d in FILES.items()})
    assert folder.wait(0.2)
    assert {p.relative_to(tmp_path / "case").as_posix() for p in (tmp_path / "case").rglob("*.*")} == FILES.keys()
    for name, data in FILES.items():
        assert b"".join(read_from_worker(client, address, "there and back", name)) == data


def test_what_arrives_changed_is_never_whole(client, blocks, tmp_path):
    address = opened(client, "changed", tmp_path / "case")
    with pytest.raises(RunError, match="surface did not arrive"):
        fill_on_worker(client, address, "changed", {"surface": (sum_of(b"one"), [b"other"])})
    assert not (tmp_path / "case").exists()
    fill_on_worker(client, address, "changed", {"surface": (sum_of(b"one"), [b"one"])})
    assert (tmp_path / "case/surface").read_bytes() == b"one"


def test_a_worker_out_of_reach(client, tmp_path):
    with pytest.raises(RunError, match="cannot exchange files"):
        [*read_from_worker(client, "tcp://127.0.0.1:1", "x", "y")]
