"""Blender's sidebar in a picture: where buttons and closed panels are, which cannot be asked for but can be seen.

In the default theme at scale 1. Places are column and row from the picture's upper left corner.
"""

import numpy as np

PANEL_GREY = 54, 61
"""Of the panels in panels, and of panels; all that is neither is a button, a text or outside."""
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
"""Arrows are found this far from the left edge."""


def closed_panels(sidebar: np.ndarray) -> list[tuple[int, int]]:
    """The middle of each closed panel's arrow, from top to bottom; ``sidebar`` is ``(H, W, 3)`` uint8."""
    arrow = np.array([[letter == "#" for letter in line] for line in ARROW.split()])
    bright = sidebar[:, :ARROWS_WIDTH].mean(axis=-1) > BRIGHT
    windows = np.lib.stride_tricks.sliding_window_view(np.pad(bright, 1), (arrow.shape[0] + 2, arrow.shape[1] + 2))
    # with a dark rim, so that a part of something larger is not taken for it
    differing = (windows != np.pad(arrow, 1)).sum(axis=(-2, -1))
    middle = np.array([arrow.shape[1] // 2, arrow.shape[0] // 2])
    return [tuple(map(int, place + middle)) for place in np.argwhere(differing <= 3)[:, ::-1]]


def likely_buttons(sidebar: np.ndarray) -> list[tuple[int, int]]:
    """The middle of what may be a button or a field, from top to bottom; also some words.

    Parts of a row that is divided by lines of the panel's grey are found one by one.
    """
    import cv2  # from the wheel of the extension: there once that is enabled

    grey = sidebar.astype(int)
    other = np.min([np.abs(grey - level).max(axis=-1) for level in PANEL_GREY], axis=0) > 5
    _, _, boxes, _ = cv2.connectedComponentsWithStats(other.astype(np.uint8), connectivity=4)
    likely = [box for box in boxes[1:] if box[2] >= 10 and 10 <= box[3] <= 28]
    return sorted(((int(x + w // 2), int(y + h // 2)) for x, y, w, h, _ in likely), key=lambda place: place[::-1])
