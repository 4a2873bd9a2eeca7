"""How many views go out in one order, by the measured time of a view.

Large orders cost little scheduling; small ones spread the last views evenly and lose little with a worker. So an order
takes about :data:`TARGET_SECONDS`, and less as the end comes near: no more than half of an even share of what is left
(guided self-scheduling, Polychronopoulos & Kuck 1987, with the half of factoring, Hummel et al. 1992).
"""

import math

TARGET_SECONDS = 15.0
"""Time that an order should take on a worker of average speed."""
BUDGET_FACTOR = 1.3
"""A worker starts no view of an order after this many times the target, and returns the views left."""
FIRST_VIEWS = 2
"""Views of an order as long as no view has been timed."""
MOST_VIEWS = 1000
"""Views of the largest order, however fast they are."""


def next_chunk(
    views_left: int, slots: int, seconds_per_view: float | None, *, target_seconds: float = TARGET_SECONDS
) -> int:
    """Number of views of the next order.

    Parameters
    ----------
    views_left
        Views that no worker holds.
    slots
        Render processes that work at the same time, on all workers.
    seconds_per_view
        Mean time of a view in one process, in s; ``None`` if none has been timed.
    target_seconds
        Time that an order should take.

    Returns
    -------
    At least 1 if views are left, at most all of them.
    """
    if views_left <= 0:
        return 0
    if seconds_per_view is None:
        return min(FIRST_VIEWS, guided_share(views_left, slots))
    by_time = MOST_VIEWS if seconds_per_view * MOST_VIEWS <= target_seconds else int(target_seconds / seconds_per_view)
    return max(1, min(by_time, guided_share(views_left, slots)))


def guided_share(views_left: int, slots: int) -> int:
    """Half of an even share of the views left, at least one view."""
    return math.ceil(views_left / (2 * max(1, slots)))


def time_budget(*, target_seconds: float = TARGET_SECONDS) -> float:
    """Time after which a worker starts no further view of an order, in s."""
    return BUDGET_FACTOR * target_seconds
