"""Laws of the model of many workers, and the finished datasets that stand for 100 000 views."""

import tracemalloc
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.dataset import layout
from pipeline.dataset.layout import ViewPaths
from pipeline.dataset.survey import survey_views
from pipeline.evaluation.scaling.cluster_model import Cluster, Interruptions, Policy, run_model
from pipeline.evaluation.scaling.dataset_times import scan, write_tables
from pipeline.evaluation.scaling.efficiency import OrderCost
from pipeline.evaluation.scaling.finished_views import KINDS, finished_description, write_finished_views

clusters = st.builds(
    Cluster,
    workers=st.integers(1, 40),
    start_seconds=st.floats(0, 20),
    order_seconds=st.floats(0, 0.5),
    view_seconds=st.floats(0, 0.01),
    spread=st.floats(0, 1),
    slow_share=st.floats(0, 1),
    slow_factor=st.floats(1, 20),
    view_spread=st.floats(0, 1),
    interruptions=st.lists(
        st.builds(Interruptions, st.floats(100, 2000), st.floats(1, 100), st.floats(0, 100)), max_size=2
    ).map(tuple),
    target_seconds=st.floats(1, 60),
    orders_held=st.integers(1, 2),
)
policies = st.sampled_from(list(Policy))


@given(clusters, policies, st.integers(1, 400), st.integers(0, 100))
@settings(max_examples=150, deadline=None)
def test_every_view_is_finished_once_whatever_stops(cluster, policy, views, seed):
    run = run_model(cluster, policy, views, 1.0, np.random.default_rng(seed))
    assert (run.times_finished == 1).all()
    assert 0 < run.efficiency <= 1 + 1e-9
    if policy is not Policy.SHARDS:
        assert run.seconds >= run.orders * cluster.order_seconds * (1 - 1e-9)


@given(st.integers(1, 50), st.integers(1, 20), policies, st.integers(1, 2))
@settings(max_examples=60, deadline=None)
def test_without_overhead_and_stragglers_the_efficiency_is_1(workers, each, policy, held):
    run = run_model(Cluster(workers, orders_held=held), policy, workers * each, 1.0, np.random.default_rng(0))
    # orders of several views may leave one view more to some worker
    slack = 1 if policy is Policy.CHUNKS else 0
    assert each - 1e-9 <= run.seconds <= each + slack + 1e-9
    if workers == 1 or policy is not Policy.CHUNKS:
        assert run.efficiency == pytest.approx(1)


@given(st.integers(2, 30), st.integers(0, 50))
@settings(max_examples=40, deadline=None)
def test_the_slowest_worker_limits_fixed_shards_and_not_orders(workers, seed):
    cluster = Cluster(workers, spread=0.2, slow_share=0.2, slow_factor=10.0)
    shards, chunks = (
        run_model(cluster, policy, 200 * workers, 1.0, np.random.default_rng(seed))
        for policy in (Policy.SHARDS, Policy.CHUNKS)
    )
    generator = np.random.default_rng(seed)
    cluster.durations(200 * workers, 1.0, generator)
    speeds = cluster.speeds(generator)
    assert shards.seconds == pytest.approx(200 / speeds.min())
    # even share, and the last order of a slow worker: the budget and one view more
    assert chunks.seconds <= 200 * workers / speeds.sum() + 1.3 * cluster.target_seconds + 1 / speeds.min() + 1e-6


def test_longer_orders_help_a_scheduler_that_is_at_its_limit():
    busy = Cluster(1000, order_seconds=0.05)
    short, long = (
        run_model(replace(busy, target_seconds=target), Policy.CHUNKS, 100_000, 1.0, np.random.default_rng(0))
        for target in (2.0, 30.0)
    )
    assert long.seconds < 0.7 * short.seconds


def test_cost_of_orders_is_that_which_was_measured_and_grows_beyond():
    cost = OrderCost((1, 10, 1000), (0.005, 0.001, 0.002))
    assert [cost.at(number) for number in (1, 10, 1000)] == pytest.approx([0.005, 0.001, 0.002])
    assert cost.at(100) == pytest.approx(0.0015)
    assert cost.at(1990) == pytest.approx(0.003)
    assert OrderCost((1, 10), (0.002, 0.001)).at(100) == 0.001


def test_a_resume_scan_finds_the_views_and_what_is_damaged(tmp_path: Path):
    root = tmp_path / "dataset"
    assert [*write_finished_views(root, 30)] == [30]
    scan(root, 30)
    paths = ViewPaths(root, 7)
    paths.file("depth").write_bytes(b"")
    found = survey_views(root, range(30), finished_description(30), KINDS)
    assert found.finished == {*range(30)} - {7}
    assert "depth/000007.png has 0 bytes" in found.damaged[7]


def test_memory_of_the_tables_does_not_grow_with_the_views(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(layout, "VIEWS_PER_SCENE", 10)
    peaks = []
    for count in (20, 20, 200):
        root = tmp_path / f"{len(peaks)}"
        for _ in write_finished_views(root, count):
            pass
        tracemalloc.start()
        write_tables(root, count)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
        assert sum(1 for _ in (root / "poses.csv").open()) == count + 1
    # the first run pays for caches
    assert peaks[2] < 1.15 * peaks[1]
