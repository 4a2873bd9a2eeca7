"""Progress on a terminal and in a file."""

import io

import pytest

from oneframe import progress
from oneframe.progress import ShareProgress


class Terminal(io.StringIO):
    def isatty(self):
        return True


@pytest.fixture
def clock(monkeypatch):
    """Seconds that only the test lets pass."""
    seconds = [100.0]
    monkeypatch.setattr(progress.time, "monotonic", lambda: seconds[0])
    return seconds


def test_a_share_says_what_is_left_and_nothing_of_what_is_soon_done(clock):
    stream, terminal = io.StringIO(), Terminal()
    for seconds, expected in ((4.0, 0), (40.0, 4)):
        with ShareProgress("of the film", stream=stream) as shown, ShareProgress("of it", stream=terminal) as bar:
            for done in range(100):
                clock[0] += seconds / 100
                shown.reach((done + 1) / 100)
                # it never goes back
                shown.reach(0.0)
                bar.reach((done + 1) / 100)
        assert len(stream.getvalue().splitlines()) == expected
    assert stream.getvalue().splitlines()[1] == "50 % of the film, 20 s left"
    assert terminal.getvalue().count("100 % of it, done in 4 s") == 1
    assert terminal.getvalue().endswith("\n")
