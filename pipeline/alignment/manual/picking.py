"""Which landmark the next pick belongs to, and what to tell the person who picks."""

from collections.abc import Sequence
from typing import Literal

from ...case.landmarks import Landmark

Half = Literal["point", "pixel"]
"""The two halves of a landmark: the point on the surface, the pixel of the frame."""

NEEDED = 4
"""Pairs below which no pose is solved for."""


def landmark_for(half: Half, landmarks: Sequence[Landmark], active: int) -> int | None:
    """Index of the landmark that a newly picked half completes; ``None``: it starts a new one.

    The active landmark if it lacks this half, else the first one that has the other half only. So the halves may be
    picked in either order, alternately or all of one kind first.
    """
    if 0 <= active < len(landmarks) and getattr(landmarks[active], half) is None:
        return active
    other = "pixel" if half == "point" else "point"
    for index, landmark in enumerate(landmarks):
        if getattr(landmark, half) is None and getattr(landmark, other) is not None:
            return index
    return None


def new_name(landmarks: Sequence[Landmark]) -> str:
    """``Landmark n`` with the smallest free number that is larger than the number of landmarks."""
    taken = {landmark.name for landmark in landmarks}
    number = len(landmarks) + 1
    while f"Landmark {number}" in taken:
        number += 1
    return f"Landmark {number}"


def next_step(landmarks: Sequence[Landmark], active: int, *, in_frame: bool) -> str:
    """One sentence: what a click in this view does next.

    Parameters
    ----------
    landmarks, active
        All of them, and the index of the active one.
    in_frame
        The view looks through the frame's camera, so that both halves can be picked in it.
    """
    surface_click = "Shift + click" if in_frame else "click"
    halves = [_halves(landmark) for landmark in landmarks]
    if 0 <= active < len(landmarks) and halves[active] == 0:
        feature = f"{landmarks[active].name}: click a feature"
    elif 1 in halves:
        chosen = active if 0 <= active < len(landmarks) and halves[active] == 1 else halves.index(1)
        name = landmarks[chosen].name
        if landmarks[chosen].point is None:
            return f"{name}: {surface_click} the same point on the surface"
        return f"{name}: click the same point in the frame" + ("" if in_frame else ", seen through the camera")
    else:
        feature = "Click a feature"
    pairs = _pairs(landmarks)
    missing = f" ({NEEDED - pairs} more needed)" if pairs < NEEDED else ""
    where = " in the frame, or Shift + click it on the surface" if in_frame else " on the surface"
    return feature + where + missing


def waits(landmarks: Sequence[Landmark]) -> bool:
    """Whether picking is unfinished: a half is missing somewhere, or there are too few pairs for a pose."""
    return _pairs(landmarks) < NEEDED or any(_halves(landmark) < 2 for landmark in landmarks)


def _halves(landmark: Landmark) -> int:
    return (landmark.point is not None) + (landmark.pixel is not None)


def _pairs(landmarks: Sequence[Landmark]) -> int:
    return sum(landmark.enabled and _halves(landmark) == 2 for landmark in landmarks)
