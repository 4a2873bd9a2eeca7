"""What explains an overlay: names and depths of the structures, how fading means depth, and a scale bar."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from .layer_stack import Colour
from .overlay import DEEPEST_MM, VISIBLE_OPACITY, hidden_opacity

INK = (0.96, 0.96, 0.96)
PANEL_OPACITY = 0.6
LETTER_FRACTION = 0.0155
"""Size of the letters, as a fraction of the geometric mean of the image's sides."""
SMALLEST_LETTER_PX = 9.0
LINE_SPACING = 1.2
WIDEST_NOTE = "100 % visible, to 00.0 mm deep"
"""Room is left for it, so that the legend of a film keeps its size."""
WIDEST_FRACTION = 0.62
"""Share of the image's width that a panel may take; letters get smaller instead."""
TALLEST_FRACTION = 0.6
"""Share of its height."""
LEAST_LETTER_PX = 5.0
"""Smaller letters cannot be read."""
BORDER_FRACTION = 0.009
"""Width of a border, as a fraction of the image's longer side."""
BAR_FRACTION = 0.2
"""Greatest length of the scale bar, of the image's shorter side."""

Write = Callable[[str, float], np.ndarray]
"""Text and size in px -> ``(h, w)`` mask 0..1 of a line of text, of one height for one size."""

Place = tuple[bool, bool]
"""Corner of the image: at the right, at the bottom."""
PLACES: tuple[Place, ...] = ((False, False), (True, False), (True, True), (False, True))


@dataclass(frozen=True)
class Entry:
    """A line of the legend.

    Attributes
    ----------
    colour
        sRGB 0..1.
    name, note
        The structure, and what is to say about it.
    is_dashed
        Whether most of it is hidden.
    """

    colour: Colour
    name: str
    note: str
    is_dashed: bool


@dataclass(frozen=True)
class ScaleBar:
    """A length at a depth."""

    length_mm: float
    length_px: float
    label: str


def scale_bar(px_per_mm: float, shape_hw: tuple[int, int], where: str) -> ScaleBar:
    """A bar of 1, 2 or 5 times a power of ten millimetres; ``where`` it holds follows its length in the label."""
    longest = BAR_FRACTION * min(shape_hw) / px_per_mm
    decade = 10.0 ** np.floor(np.log10(longest))
    length = float(decade * max(step for step in (1, 2, 5) if step * decade <= longest))
    return ScaleBar(length, length * px_per_mm, f"{length:g} mm {where}")


def letter_size(shape_hw: tuple[int, int]) -> float:
    """Size of the letters in px, in an image of this size."""
    return max(LETTER_FRACTION * float(np.sqrt(shape_hw[0] * shape_hw[1])), SMALLEST_LETTER_PX)


def legend_panel(
    entries: Sequence[Entry], bar: ScaleBar | None, write: Write, shape_hw: tuple[int, int]
) -> np.ndarray | None:
    """Draw legend and scale bar for an image of this size -> ``(h, w, 4)`` float32 RGBA 0..1, straight alpha.

    ``None`` if the image has no room for letters that can be read. The bar's end covers a part of a pixel.
    """
    size = letter_size(shape_hw)
    panel = _legend(entries, bar, write, size)
    # a long name must not cover the image
    room = min(WIDEST_FRACTION * shape_hw[1] / panel.shape[1], TALLEST_FRACTION * shape_hw[0] / panel.shape[0])
    if room >= 1:
        return panel
    return _legend(entries, bar, write, size * room) if size * room >= LEAST_LETTER_PX else None


def freest_corner(busy: np.ndarray, panel_hw: tuple[int, ...]) -> Place:
    """The first of the corners under which a panel hides least of ``(H, W)`` bool ``busy``."""
    return min(PLACES, key=lambda place: int(busy[_part(busy.shape[:2], panel_hw, place)].sum()))


def put(image: np.ndarray, panel: np.ndarray, place: Place) -> None:
    """Blend a panel into a corner of an ``(H, W, 3)`` uint8 image."""
    rows, columns = _part(image.shape[:2], panel.shape[:2], place)
    under = image[rows, columns]
    panel = panel[: under.shape[0], : under.shape[1]]
    under[:] = np.rint(under + panel[..., 3:] * (panel[..., :3] * 255 - under))


def put_border(image: np.ndarray, codes: tuple[int, int, int], words: str, write: Write | None) -> None:
    """Draw a border of a colour around an ``(H, W, 3)`` uint8 image, and words, if any, on a band along its top."""
    width = max(round(BORDER_FRACTION * max(image.shape)), 2)
    for part in (np.s_[:width], np.s_[-width:], np.s_[:, :width], np.s_[:, -width:]):
        image[part] = codes
    if not words or write is None:
        return
    size, room = letter_size((image.shape[0], image.shape[1])), image.shape[1] - 4 * width
    text = write(words, size)
    if text.shape[1] > room:
        text = write(words, size * room / text.shape[1])[:, :room]
    image[: text.shape[0] + width] = codes
    ink = 0 if np.dot(codes, (0.299, 0.587, 0.114)) > 128 else 255
    under = image[width // 2 :, 2 * width :][: text.shape[0], : text.shape[1]]
    under[:] = np.rint(under + text[..., None] * (ink - under.astype(np.float32)))


def _part(shape_hw: tuple[int, ...], panel_hw: tuple[int, ...], place: Place) -> tuple[slice, slice]:
    margin = max(round(0.012 * max(shape_hw)), 2)
    parts = []
    for side, length, at_end in ((shape_hw[0], panel_hw[0], place[1]), (shape_hw[1], panel_hw[1], place[0])):
        start = max(side - margin - length if at_end else margin, 0)
        parts.append(slice(start, min(start + length, side)))
    return parts[0], parts[1]


def _legend(entries: Sequence[Entry], bar: ScaleBar | None, write: Write, size: float) -> np.ndarray:
    names = [write(entry.name, size) for entry in entries]
    notes = [write(entry.note, size) for entry in entries]
    zero, deepest = write("depth below the surface: 0", size), write(f"{DEEPEST_MM:g} mm and more", size)
    length = write(bar.label, size) if bar else zero[:, :0]
    line, gap, swatch = round(LINE_SPACING * zero.shape[0]), max(round(0.6 * size), 3), max(round(2.4 * size), 10)
    ramp, thick = max(round(5 * size), 20), max(round(0.22 * size), 2)
    first = max((name.shape[1] for name in names), default=0)
    widths = [length.shape[1], int(np.ceil(bar.length_px)) + 1 if bar else 0]
    if entries:
        second = max(note.shape[1] for note in [*notes, write(WIDEST_NOTE, size)])
        widths += [swatch + first + second + 2 * gap, zero.shape[1] + ramp + deepest.shape[1] + 2 * gap]
    height = (len(entries) + bool(entries) + 1) * line + 2 * thick + 2 * gap
    panel = np.zeros((height, max(widths) + 2 * gap, 4), np.float32)
    panel[..., 3] = PANEL_OPACITY
    top = gap
    for entry, name, note in zip(entries, names, notes, strict=True):
        _swatch(panel[top : top + line, gap : gap + swatch], entry, size)
        text_top = top + (line - name.shape[0]) // 2
        _ink(panel, name, 2 * gap + swatch, text_top, INK)
        _ink(panel, note, 3 * gap + swatch + first, text_top, INK)
        top += line
    if entries:
        text_top = top + (line - zero.shape[0]) // 2
        _ink(panel, zero, gap, text_top, INK)
        opacity = hidden_opacity(np.linspace(0, DEEPEST_MM, ramp))
        height = max(round(0.6 * line), 3)
        middle = top + (line - height) // 2
        _ink(panel, np.repeat(opacity[None], height, axis=0) / opacity.max(), 2 * gap + zero.shape[1], middle, INK)
        _ink(panel, deepest, 3 * gap + zero.shape[1] + ramp, text_top, INK)
        top += line
    _ink(panel, length, gap, top + (line - length.shape[0]) // 2, INK)
    if bar:
        along = np.clip(bar.length_px - np.arange(widths[1]), 0, 1)
        _ink(panel, np.repeat(along[None], thick, axis=0), gap, top + line + thick, INK)
    return panel


def _swatch(panel: np.ndarray, entry: Entry, size: float) -> None:
    """A sample of the structure: a fill between two lines, dashed if the structure is hidden."""
    height, width = panel.shape[:2]
    thick, margin = max(round(0.12 * size), 1), max(round(0.22 * height), 1)
    fill = VISIBLE_OPACITY if not entry.is_dashed else float(hidden_opacity(np.array(DEEPEST_MM / 2)))
    _ink(panel, np.full((height - 2 * margin, width), fill), 0, margin, entry.colour)
    line = np.ones(width)
    if entry.is_dashed:
        line = (np.arange(width) % (width / 3) < width / 5).astype(float)
    for row in (margin, height - margin - thick):
        _ink(panel, np.repeat(line[None], thick, axis=0), 0, row, entry.colour)


def _ink(panel: np.ndarray, mask: np.ndarray, left: int, top: int, colour: Colour) -> None:
    """Draw a mask 0..1 over a panel, straight alpha."""
    part = panel[top : top + mask.shape[0], left : left + mask.shape[1]]
    over = mask[: part.shape[0], : part.shape[1], None].astype(np.float32)
    alpha = over + part[..., 3:] * (1 - over)
    part[..., :3] = (np.array(colour, np.float32) * over + part[..., :3] * part[..., 3:] * (1 - over)) / alpha
    part[..., 3:] = alpha
