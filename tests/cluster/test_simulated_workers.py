"""The benchmark's simulated workers: all of the engine but rendering."""

import pytest

pytest.importorskip("distributed", reason='needs Dask: pip install "oneframe[cluster]"')

from pathlib import Path

from pipeline.cluster.simulated_workers import StandIn, run_engine


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="needs Linux's /proc")
def test_simulated_workers_do_every_view_and_the_cost_is_measured():
    run = run_engine(6, StandIn(400, spread=0.2, slow_share=0.2, slow_factor=5.0, view_spread=0.3))
    # orders of about 15 s of simulated time, and fewer views at the beginning and the end
    assert 400 / 30 < run.orders < 400
    assert 0 < run.order_seconds < 1
    assert run.client_mb > 10
    assert run.scheduler_mb > 10
