"""Finds buttons and closed panels in a picture of Blender's sidebar, since Blender does not report their positions.

For the default theme at scale 1. Places are column and row from the picture's upper left corner.
"""

import numpy as np

PANEL_GREY = 54, 61
"""Grey values of sub-panels and panels; everything else is a button, a text or outside."""

ARROW = """
##....
###...
.###..
..###.
...###
....##
...##.
..##..
.##...
##....
#.....
"""
"""The bright pixels of a closed panel's ``>``."""

BRIGHT = 90
ARROWS_WIDTH = 48
"""Arrows lie within this distance of the left edge."""


def closed_panels(sidebar: np.ndarray) -> list[tuple[int, int]]:
    """The middle of each closed panel's arrow, from top to bottom; ``sidebar`` is ``(H, W, 3)`` uint8."""
    arrow = np.array([[letter == "#" for letter in line] for line in ARROW.split()])
    bright = sidebar[:, :ARROWS_WIDTH].mean(axis=-1) > BRIGHT
    windows = np.lib.stride_tricks.sliding_window_view(np.pad(bright, 1), (arrow.shape[0] + 2, arrow.shape[1] + 2))
    # with a dark border: part of a larger shape is not an arrow
    differing = (windows != np.pad(arrow, 1)).sum(axis=(-2, -1))
    middle = np.array([arrow.shape[1] // 2, arrow.shape[0] // 2])
    return [tuple(map(int, place + middle)) for place in np.argwhere(differing <= 3)[:, ::-1]]


def likely_buttons(sidebar: np.ndarray) -> list[tuple[int, int]]:
    """The middle of everything that may be a button or a field, from top to bottom; includes some words.

    Buttons of a row that are separated by lines of the panel's grey are found individually.
    """
    import cv2  # from the wheel of the extension: available once that is enabled

    grey = sidebar.astype(int)
    other = np.min([np.abs(grey - level).max(axis=-1) for level in PANEL_GREY], axis=0) > 5
    _, _, boxes, _ = cv2.connectedComponentsWithStats(other.astype(np.uint8), connectivity=4)
    likely = [box for box in boxes[1:] if box[2] >= 10 and 10 <= box[3] <= 28]
    return sorted(((int(x + w // 2), int(y + h // 2)) for x, y, w, h, _ in likely), key=lambda place: place[::-1])
