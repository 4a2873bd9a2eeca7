"""The best frames of a film: none twice, none that is much worse than the best."""

from collections.abc import Sequence

from .frame_scores import FrameScore

APART_SECONDS, NEAREST_SECONDS = 1.0, 0.12
"""Chosen frames lie this far apart; less, rather than take a worse one, but never less than the second."""

LEAST_OF_BEST = 0.75
"""Worst score that is chosen, relative to the best."""


LEAST = 0.01
"""Frames of a lower score show nothing: black, or nothing that any other frame shows too."""


def best_frames(scores: Sequence[FrameScore], count: int, *, apart_s: float = APART_SECONDS) -> tuple[FrameScore, ...]:
    """At most ``count`` frames, the best first; of equal ones the earlier.

    Parameters
    ----------
    scores
        In display order.
    count
        How many.
    apart_s
        Time between two of them. Where that leaves too few, it is halved as often as needed, down to
        :data:`NEAREST_SECONDS`: a good frame's neighbour is worth more than a frame with an instrument in it.
    """
    best = max((each.total for each in scores), default=0.0)
    good = sorted(
        (each for each in scores if each.total >= max(LEAST_OF_BEST * best, LEAST)), key=lambda each: -each.total
    )
    chosen: list[FrameScore] = []
    while good:
        for score in good:
            if len(chosen) == count:
                return _best_first(chosen)
            if all(
                abs(score.time_s - other.time_s) >= apart_s - 1e-6 and score.index != other.index for other in chosen
            ):
                chosen.append(score)
        if apart_s <= NEAREST_SECONDS:
            break
        apart_s = max(apart_s / 2, NEAREST_SECONDS)
    return _best_first(chosen)


def _best_first(scores: list[FrameScore]) -> tuple[FrameScore, ...]:
    return tuple(sorted(scores, key=lambda each: (-each.total, each.index)))
