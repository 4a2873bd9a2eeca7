"""Sizes of orders: every view exactly once, in bounded time, in small orders at the end."""

import heapq
import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.dataset.chunks import FIRST_VIEWS, MOST_VIEWS, guided_share, next_chunk, time_budget

seconds = st.floats(1e-4, 300)


@given(st.integers(-5, 10**6), st.integers(0, 5000), st.none() | seconds, st.floats(0.1, 100))
def test_an_order_has_views_while_there_are_any_and_never_too_many(left, slots, mean, target):
    count = next_chunk(left, slots, mean, target_seconds=target)
    assert (count >= 1) == (left > 0)
    assert count <= max(0, left)
    assert count <= MOST_VIEWS
    if left > 0:
        assert count <= guided_share(left, slots)
        assert count <= (FIRST_VIEWS if mean is None else max(1, target / mean))


@given(st.integers(1, 10**5), st.integers(1, 200), seconds, st.integers(1, 10**4))
def test_more_views_left_never_make_an_order_smaller_and_slower_ones_never_larger(left, slots, mean, more):
    count = next_chunk(left, slots, mean)
    assert next_chunk(left + more, slots, mean) >= count
    assert next_chunk(left, slots, 1.5 * mean) <= count


@given(st.integers(1, 600), st.lists(st.floats(0.01, 60), min_size=1, max_size=12))
def test_workers_of_any_speed_do_each_view_once_and_hold_none_back(views, pace):
    """Workers as the feeder drives them, each with its own time for a view; what exceeds the budget comes back."""
    left, done = [*range(views)], []
    timed: list[tuple[float, int]] = []
    idle = [(0.0, worker) for worker in range(len(pace))]
    held = 0.0
    while left:
        now, worker = heapq.heappop(idle)
        mean = sum(time for time, _ in timed) / sum(count for _, count in timed) if timed else None
        count = next_chunk(len(left), len(pace), mean)
        order, left = left[:count], left[count:]
        # a view begins only within the budget
        begun = min(count, 1 + int(time_budget() / pace[worker]))
        done += order[:begun]
        left = order[begun:] + left
        timed.append((begun * pace[worker], begun))
        held = max(held, begun * pace[worker])
        heapq.heappush(idle, (now + begun * pace[worker], worker))
    assert sorted(done) == [*range(views)]
    assert held <= time_budget() + max(pace) + 1e-6


@pytest.mark.parametrize("slots", [1, 7, 100])
def test_the_last_orders_are_single_views(slots):
    left, sizes = 20_000, []
    while left:
        sizes.append(next_chunk(left, slots, 0.05))
        left -= sizes[-1]
    assert sizes == sorted(sizes, reverse=True)
    assert sizes[-slots:] == [1] * slots
    # little scheduling all the same
    assert np.mean(sizes) > 20 or slots == 100
    assert len(sizes) < 20_000 / 300 + 2 * slots * np.log(20_000) + 2 * slots


def test_nothing_is_left_out_between_two_orders():
    left, counts = 1000, itertools.count()
    while left and next(counts) < 2000:
        left -= next_chunk(left, 3, None)
    assert left == 0
