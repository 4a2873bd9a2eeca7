"""Numbers of views as ranges, for messages."""

from collections.abc import Iterable
from itertools import pairwise

MOST_SHOWN = 4


def runs(numbers: Iterable[int]) -> list[range]:
    """Different numbers, in any order, as increasing ranges of consecutive ones."""
    ordered = sorted(numbers)
    starts = [place for place, (one, other) in enumerate(pairwise(ordered), 1) if other != one + 1]
    bounds = [0, *starts, len(ordered)] if ordered else []
    return [range(ordered[first], ordered[stop - 1] + 1) for first, stop in pairwise(bounds)]


def ranges_text(ranges: Iterable[range]) -> str:
    """Increasing ranges as text: "0-9, 12"; neighbours are joined, and only the first :data:`MOST_SHOWN` are shown."""
    joined: list[range] = []
    for one in ranges:
        if joined and joined[-1].stop == one.start:
            joined[-1] = range(joined[-1].start, one.stop)
        elif len(one):
            joined.append(one)
    texts = [str(one.start) if len(one) == 1 else f"{one.start}-{one.stop - 1}" for one in joined]
    return ", ".join(texts[:MOST_SHOWN]) + (", ..." if len(texts) > MOST_SHOWN else "")


def view_ranges(views: Iterable[int]) -> str:
    """Numbers of views as text: see :func:`ranges_text`."""
    return ranges_text(runs(views))
