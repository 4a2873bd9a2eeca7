"""Nobody but the run itself gets into its scheduler and workers, and none is trusted on another machine unasked."""

import os
import signal
import subprocess
from pathlib import Path

import pytest

pytest.importorskip("distributed", reason='needs Dask: pip install "oneframe[cluster]"')

from oneframe.cluster.scheduler import open_scheduler
from oneframe.errors import InputError, RunError
from tests.cluster.strangers import check_closed, listeners
from tests.cluster.watching import render_processes
from tests.waiting import wait_until


@pytest.mark.render
@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="needs Linux's /proc")
def test_a_stranger_on_this_machine_stays_outside(tmp_path, write_tiny_case, render_command):
    command = render_command(write_tiny_case(tmp_path), "--out", tmp_path / "out", "--count", 5000)
    run = subprocess.Popen(
        [*command, "--cluster", "local:2"], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, start_new_session=True
    )
    try:
        wait_until(lambda: len(render_processes(run.pid)) == 2, run)
        open_here = listeners([run.pid])
        # scheduler and workers
        assert len(open_here) >= 3
        assert {host for host, _ in open_here} == {"127.0.0.1"}
        check_closed(open_here)
    finally:
        os.killpg(run.pid, signal.SIGKILL)
        run.communicate()


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
    with pytest.raises(RunError, match="found none"), open_scheduler(where):
        pass
