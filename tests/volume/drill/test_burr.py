"""The burr under a pointer: only what it drills near stops it, and its way follows the bone."""

from itertools import groupby, pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from oneframe.volume.drill.burr import BurrRoom, way_over_bone
from tests.volume.solids import ball

TOWARD = np.array([0.0, 0.0, -1.0])


@given(st.floats(3.5, 6), st.floats(0.5, 2))
def test_structures_stop_a_burr_only_where_it_is(height, margin):
    room = BurrRoom({"incus": ball(0.8, np.array([0, 0, height + margin]), 3)}, {"incus": margin})
    end = np.array([0.0, 0.0, 1.0])
    assert room.reached(end - 9 * TOWARD, end, 1.5) == pytest.approx(end)
    assert room.reached(end - TOWARD, end, 1.5 + height) is None


def on_two_balls(place):
    """Pixels of 0.1 mm look along z at a ball of 10 mm in radius before another one, 30 mm behind it."""
    x, y = place / 10
    for middle, depth in ((0.0, 0.0), (12.0, -30.0)):
        if (inside := 100 - (x - middle) ** 2 - y**2) > 0:
            return np.array([x, y, depth + np.sqrt(inside)])
    return None


PLACES = st.tuples(st.floats(-300, 300), st.floats(-120, 120)).map(np.array)


@given(PLACES, PLACES, st.floats(0.3, 2))
def test_a_pointer_that_jumps_leaves_no_gap_and_no_short_cut(start, end, step):
    way = list(way_over_bone(on_two_balls, start, end, step))
    for drills, run in groupby(way, lambda centre: centre is not None):
        for one, next_one in pairwise(run) if drills else ():
            middle = (one + next_one) / 2
            assert min(abs(np.linalg.norm(middle - at) - 10) for at in ([0, 0, 0], [12, 0, -30])) <= 4 * step
            assert np.linalg.norm(next_one - one) <= 4 * step
    # whatever the pointer crosses lies near a point of the way
    points = np.array([centre for centre in way if centre is not None]).reshape(-1, 3)
    for place in np.linspace(start, end, 50):
        if (on_bone := on_two_balls(place)) is not None and np.linalg.norm(end - start) > 20:
            assert len(points), "bone was passed by"
            assert np.abs(points[:, :2] - on_bone[:2]).max(axis=1).min() <= step + 0.8
