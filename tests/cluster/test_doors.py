"""No scheduler on another machine is trusted unasked."""

import gc

import pytest

distributed = pytest.importorskip("distributed", reason='needs Dask: pip install "oneframe[cluster]"')

from oneframe.cluster.scheduler import open_scheduler
from oneframe.errors import InputError, RunError
from tests.waiting import wait_until


@pytest.mark.parametrize("where", ["tcp://192.0.2.99:8786", "192.0.2.99:8786", "ws://[2001:db8::9]:8786"])
def test_a_scheduler_elsewhere_that_lets_everybody_in_is_refused(where, monkeypatch):
    monkeypatch.setattr("oneframe.cluster.scheduler.CONNECT_SECONDS", 0.1)
    with pytest.raises(InputError, match=r"expected tls:// .*docs/cluster\.md.*--insecure"), open_scheduler(where):
        pass
    with pytest.raises(RunError, match="found none"), open_scheduler(where, insecure=True):
        pass


@pytest.mark.parametrize("where", ["tcp://localhost:9", "[::1]:9", "tls://192.0.2.99:9"])
def test_one_here_or_with_certificates_is_asked(where, monkeypatch):
    monkeypatch.setattr("oneframe.cluster.scheduler.CONNECT_SECONDS", 0.1)
    gc.disable()
    try:
        with pytest.raises(RunError, match="found none"), open_scheduler(where):
            pass
        # a client that waits to be collected would wait there for Dask's locks
        clients = [one for one in gc.get_objects() if isinstance(one, distributed.Client)]
    finally:
        gc.enable()
    wait_until(lambda: all(one.status == "closed" for one in clients))
