"""Pictures of an evaluation: the paper's figure, and pairs of novel views. Needs ``cv2``."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from ...images.pixel_values import mask_box

TILE_WH = (320, 240)
GAP_PX, LABEL_PX = 6, 26
INK, PAPER = (0.12, 0.14, 0.16), 1.0
FONT, FONT_SCALE = cv2.FONT_HERSHEY_SIMPLEX, 0.5
ROW_LABEL_PX = 170
CROP_MARGIN = 0.08


@dataclass(frozen=True)
class Crop:
    """A part of an image in the aspect of a tile, in px; it may reach beyond the image."""

    left: float
    top: float
    width: float
    height: float


def crop_of(mask: np.ndarray) -> Crop:
    """The part of an image around an ``(H, W)`` bool mask; the whole image where it is empty."""
    height, width = mask.shape
    if mask.any():
        rows, columns = mask_box(mask)
        left, right, top, bottom = columns.start, columns.stop, rows.start, rows.stop
    else:
        left, right, top, bottom = 0, width, 0, height
    across, down = CROP_MARGIN * (right - left), CROP_MARGIN * (bottom - top)
    left, right = max(left - across, 0), min(right + across, width)
    top, bottom = max(top - down, 0), min(bottom + down, height)
    wide = max(right - left, (bottom - top) * TILE_WH[0] / TILE_WH[1], 16)
    tall = wide * TILE_WH[1] / TILE_WH[0]
    return Crop((left + right - wide) / 2, (top + bottom - tall) / 2, wide, tall)


def tile(image: np.ndarray, crop: Crop) -> np.ndarray:
    """``(H, W, 3)`` -> the part in the size of a tile, averaged where it is reduced; black beyond the image."""
    left, top = int(np.floor(crop.left)), int(np.floor(crop.top))
    right, bottom = left + int(np.ceil(crop.width)), top + int(np.ceil(crop.height))
    height, width = image.shape[:2]
    part = np.zeros((bottom - top, right - left, 3), np.float32)
    inside = (slice(max(top, 0), min(bottom, height)), slice(max(left, 0), min(right, width)))
    part[inside[0].start - top : inside[0].stop - top, inside[1].start - left : inside[1].stop - left] = image[inside]
    reduced = crop.width > TILE_WH[0]
    return cv2.resize(part, TILE_WH, interpolation=cv2.INTER_AREA if reduced else cv2.INTER_NEAREST)


def labelled_grid(rows: Sequence[tuple[str, Sequence[np.ndarray]]], columns: Sequence[str]) -> np.ndarray:
    """Tiles in a grid on white with a label for each row at its left, and for each column above it -> ``(h, w, 3)``.

    Labels that are too long are cut short; letters beyond ASCII become question marks.
    """
    width = ROW_LABEL_PX + len(columns) * (TILE_WH[0] + GAP_PX) + GAP_PX
    height = LABEL_PX + len(rows) * (TILE_WH[1] + GAP_PX) + GAP_PX
    sheet = np.full((height, width, 3), PAPER, np.float32)
    for number, label in enumerate(columns):
        left = ROW_LABEL_PX + GAP_PX + number * (TILE_WH[0] + GAP_PX)
        _write(sheet, label, left + 2, LABEL_PX - 8, TILE_WH[0] - 4)
    for row, (label, tiles) in enumerate(rows):
        top = LABEL_PX + row * (TILE_WH[1] + GAP_PX) + GAP_PX
        for line, text in enumerate(_lines(label)):
            _write(sheet, text, GAP_PX, top + TILE_WH[1] // 2 + 20 * line, ROW_LABEL_PX - GAP_PX)
        for number, each in enumerate(tiles):
            left = ROW_LABEL_PX + GAP_PX + number * (TILE_WH[0] + GAP_PX)
            sheet[top : top + TILE_WH[1], left : left + TILE_WH[0]] = each
    return sheet


def _lines(label: str) -> list[str]:
    """A label in lines that fit to the left of a row, broken at spaces."""
    lines = [""]
    for word in label.split():
        longer = f"{lines[-1]} {word}".strip()
        if lines[-1] and _width(longer) > ROW_LABEL_PX - 2 * GAP_PX:
            lines.append(word)
        else:
            lines[-1] = longer
    return lines


def _width(text: str) -> int:
    return cv2.getTextSize(text, FONT, FONT_SCALE, 1)[0][0]


def _write(sheet: np.ndarray, text: str, x: int, y: int, most_px: int) -> None:
    text = text.encode("ascii", errors="replace").decode()
    if _width(text) > most_px:
        while text and _width(text + "...") > most_px:
            text = text[:-1]
        text += "..."
    cv2.putText(sheet, text, (x, y), FONT, FONT_SCALE, INK, 1, cv2.LINE_AA)
