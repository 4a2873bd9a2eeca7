"""A picture of slices through a volume: grey values, contours, a tinted part, directions and a scale bar.

Slices are shown as radiologists look at them: from the feet (axial), from the front (coronal) and from the left
(sagittal), so the patient's right is on the left of the picture, and the face looks to the left.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

GAP_PX = 12
BACKGROUND = 0.08
INK = (0.95, 0.95, 0.95)
TINT = (0.95, 0.25, 0.15)
TINT_OPACITY = 0.45
LINE_PX = 1.6
FONT, FONT_SCALE = cv2.FONT_HERSHEY_SIMPLEX, 0.5

Colour = tuple[float, float, float]


@dataclass(frozen=True)
class Contour:
    """A line where a field is zero.

    Attributes
    ----------
    field
        ``(H, W)``, of any unit; its crossing of zero is drawn to a fraction of a pixel.
    colour
        sRGB 0..1.
    shown
        ``(H, W)`` bool: where the line is drawn; ``None`` for everywhere.
    """

    field: np.ndarray
    colour: Colour
    shown: np.ndarray | None = None


@dataclass(frozen=True)
class Slice:
    """One slice, resampled to square pixels.

    Attributes
    ----------
    title
        In ASCII.
    image
        ``(H, W)`` grey values 0..1, the top row first.
    mm_per_px
        Side of a pixel.
    directions
        The patient's sides at the left, right, top and bottom of the picture, such as ``"RLAP"``.
    contours
        Later ones cover earlier ones.
    tinted
        ``(H, W)`` bool: the part that is marked, or ``None``.
    """

    title: str
    image: np.ndarray
    mm_per_px: float
    directions: str
    contours: Sequence[Contour] = ()
    tinted: np.ndarray | None = None


def slice_picture(slices: Sequence[Slice]) -> np.ndarray:
    """Draw slices side by side -> ``(H, W, 3)`` float32, sRGB 0..1."""
    panels = [_panel(each) for each in slices]
    height = max(len(panel) for panel in panels)
    width = sum(panel.shape[1] for panel in panels) + GAP_PX * (len(panels) + 1)
    picture = np.full((height + 2 * GAP_PX, width, 3), BACKGROUND, np.float32)
    left = GAP_PX
    for panel in panels:
        top = GAP_PX + (height - len(panel)) // 2
        picture[top : top + len(panel), left : left + panel.shape[1]] = panel
        left += panel.shape[1] + GAP_PX
    return picture


def _panel(part: Slice) -> np.ndarray:
    panel = np.repeat(part.image[:, :, None].astype(np.float32), 3, axis=2)
    if part.tinted is not None:
        panel[part.tinted] = (1 - TINT_OPACITY) * panel[part.tinted] + TINT_OPACITY * np.array(TINT, np.float32)
    for contour in part.contours:
        opacity = _line_opacity(contour.field)
        if contour.shown is not None:
            opacity *= contour.shown
        panel += opacity[:, :, None] * (np.array(contour.colour, np.float32) - panel)
    _letter(panel, part.title, 0.02, 0.02)
    for letter, x, y in zip(part.directions, (0.02, 0.98, 0.5, 0.5), (0.5, 0.5, 0.02, 0.98), strict=True):
        _letter(panel, letter, x, y)
    _scale_bar(panel, part.mm_per_px)
    return panel


def _line_opacity(field: np.ndarray) -> np.ndarray:
    """``(H, W)`` 0..1 of a line of :data:`LINE_PX` where the field is zero: the distance is the field / its slope."""
    field = field.astype(np.float32)
    down, along = np.gradient(field)
    slope = np.hypot(down, along)
    distance = np.divide(np.abs(field), slope, out=np.full_like(field, np.inf), where=slope > 0)
    return np.clip(LINE_PX / 2 + 0.5 - distance, 0, 1)


def _letter(panel: np.ndarray, text: str, x: float, y: float) -> None:
    """Write a text at a relative place in a panel, its centre there but inside the panel."""
    (width, height), _ = cv2.getTextSize(text, FONT, FONT_SCALE, 1)
    _write(panel, text, round(x * (panel.shape[1] - width - 2)) + 1, round(y * (len(panel) - height - 2)) + height + 1)


def _write(panel: np.ndarray, text: str, left: int, base: int) -> None:
    """Write a text, if it fits, with a dark rim that sets it off."""
    (width, height), _ = cv2.getTextSize(text, FONT, FONT_SCALE, 1)
    if not text.strip() or not (0 < left <= panel.shape[1] - width and height < base < len(panel)):
        return
    for colour, thickness in (((0.0, 0.0, 0.0), 3), (INK, 1)):
        cv2.putText(panel, text, (left, base), FONT, FONT_SCALE, colour, thickness, cv2.LINE_AA)


def _scale_bar(panel: np.ndarray, mm_per_px: float) -> None:
    """A bar of a round length, about a quarter of the panel's width, with its length."""
    quarter = panel.shape[1] * mm_per_px / 4
    decade = 10 ** np.floor(np.log10(quarter))
    length = decade * max(step for step in (1, 2, 5) if step * decade <= quarter)
    width, height = round(length / mm_per_px), len(panel)
    left, top = round(0.02 * panel.shape[1]) + 1, round(0.98 * height) - 4
    if width < 4 or top < 1:
        return
    panel[top - 1 : top + 5, left - 1 : left + width + 1] = 0.0
    panel[top : top + 4, left : left + width] = INK
    _write(panel, f"{length:g} mm", left, top - 6)
