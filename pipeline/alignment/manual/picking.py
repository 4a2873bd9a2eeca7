"""Which landmark the next pick belongs to, and the instruction shown to the user."""

from collections.abc import Sequence
from typing import Literal

from ...case.landmarks import Landmark

Half = Literal["point", "pixel"]
"""The two halves of a landmark: the point on the surface, the pixel of the frame."""

MIN_LANDMARKS = 4
"""Complete landmarks that a pose needs."""


def landmark_for(half: Half, landmarks: Sequence[Landmark], active: int) -> int | None:
    """Index of the landmark that a newly picked half belongs to; ``None`` if it starts a new one.

    That is the active landmark if it lacks this half, else the first one that has only the other half. So users may
    pick in either order, alternately or all of one kind first.
    """
    if 0 <= active < len(landmarks) and getattr(landmarks[active], half) is None:
        return active
    other = "pixel" if half == "point" else "point"
    for index, landmark in enumerate(landmarks):
        if getattr(landmark, half) is None and getattr(landmark, other) is not None:
            return index
    return None


def new_name(landmarks: Sequence[Landmark]) -> str:
    """``Landmark n`` with the smallest unused n above the number of landmarks."""
    taken = {landmark.name for landmark in landmarks}
    number = len(landmarks) + 1
    while f"Landmark {number}" in taken:
        number += 1
    return f"Landmark {number}"


def _half_picked(landmarks: Sequence[Landmark], active: int) -> int | None:
    """Index of the landmark to complete next, the active one first; ``None`` if none has just one half."""
    indices = [index for index, landmark in enumerate(landmarks) if _count_halves(landmark) == 1]
    return active if active in indices else next(iter(indices), None)


def next_step(landmarks: Sequence[Landmark], active: int, *, in_frame: bool) -> str:
    """One sentence: what a click in this viewport does next.

    Parameters
    ----------
    landmarks, active
        All landmarks, and the index of the active one.
    in_frame
        Whether the viewport looks through the frame's camera, so that both halves can be picked in it.
    """
    surface_click = "Shift + click" if in_frame else "click"
    chosen = _half_picked(landmarks, active)
    if 0 <= active < len(landmarks) and _count_halves(landmarks[active]) == 0:
        feature = f"{landmarks[active].name}: click a feature"
    elif chosen is not None:
        name = landmarks[chosen].name
        if landmarks[chosen].point is None:
            return f"{name}: {surface_click} the same point on the surface"
        return f"{name}: click the same point in the frame" + ("" if in_frame else ", seen through the camera")
    else:
        feature = "Click a feature"
    complete = _count_complete(landmarks)
    missing = f" ({MIN_LANDMARKS - complete} more needed)" if complete < MIN_LANDMARKS else ""
    where = " in the frame, or Shift + click it on the surface" if in_frame else " on the surface"
    return feature + where + missing


def is_unfinished(landmarks: Sequence[Landmark]) -> bool:
    """Whether picking is unfinished: a half is missing, or there are too few complete landmarks for a pose."""
    return _count_complete(landmarks) < MIN_LANDMARKS or any(_count_halves(landmark) < 2 for landmark in landmarks)


def _count_halves(landmark: Landmark) -> int:
    return (landmark.point is not None) + (landmark.pixel is not None)


def _count_complete(landmarks: Sequence[Landmark]) -> int:
    return sum(landmark.enabled and _count_halves(landmark) == 2 for landmark in landmarks)
