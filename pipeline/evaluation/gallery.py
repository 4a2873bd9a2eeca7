"""Pictures of an evaluation: of single views, the paper's figure, and pairs of novel views."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, field

import cv2
import numpy as np

from ..files.outputs import write_output
from ..images.contact_sheet import downscaled
from ..images.pixel_values import mask_box, to_uint8
from ..images.png import encode_png
from .evaluate import EvaluationCase, EvaluationRun, View, shown_numbers
from .record.evaluation_record import Pictures

FIGURE, PAIRS, PICTURES = "figure.png", "pairs.png", "pictures"
PICTURE_WIDTH = 960
"""Pictures are reduced to this width, px."""
MOST_COLUMNS = 6
"""Photographs of the figure if there is one case, and cases otherwise."""
PAIR_ROWS, PAIR_COLUMNS = 6, 2
"""Cases of the gallery, and pairs in a row."""
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


def picture_stems(run: EvaluationRun) -> dict[tuple[str, int], str]:
    """Case and number of the photographs of which pictures are written -> how the names of these begin."""
    return {
        (case.name, number): f"{PICTURES}/case_{place} {case.images[number]}"
        for place, case in enumerate(run.cases, start=1)
        for number in shown_numbers(len(case.images), run.pictures)
    }


@dataclass
class Gallery:
    """Collects what the pictures show, and writes them; tiles are in the order of the methods."""

    run: EvaluationRun
    pictures: list[Pictures] = field(default_factory=list)
    _columns: dict[tuple[str, int], list[np.ndarray]] = field(default_factory=dict)
    _pairs: dict[tuple[str, int], list[np.ndarray]] = field(default_factory=dict)
    _crops: dict[tuple[str, int], Crop] = field(default_factory=dict)
    _first: dict[str, int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._stems = picture_stems(self.run)
        self._compared = self.run.settings.compared

    def add(self, view: View) -> None:
        """Write the pictures of a view, if it is one of those that are shown."""
        key = case, number = view.case.name, view.number
        if view.shown is None:
            crop = self._crops.setdefault(key, crop_of(view.rendered.any(axis=2)))
            self._pairs.setdefault(key, []).append(tile(view.rendered, crop))
            return
        real, surface = view.shown.real, view.shown.surface
        segmented, rendered = (np.where(surface[..., None], each, np.float32(0)) for each in (real, view.rendered))
        leads = view.method == self._compared[0]
        if view.method in self._compared and self._has_column(view):
            shown = [real, segmented, rendered] if leads else [rendered]
            self._columns.setdefault(key, []).extend(tile(image, crop_of(surface)) for image in shown)
        if key not in self._stems:
            return
        kinds = {"real": real, "segmented": segmented} if leads else {}
        kinds |= {view.method.key: rendered, f"{view.method.key} difference": np.abs(rendered - segmented)}
        for kind, image in kinds.items():
            self._write(f"{self._stems[key]} {kind}.png", downscaled(image, PICTURE_WIDTH))
        named = (f"{self._stems[key]} {kind}.png" for kind in ("real", "segmented", *list(kinds)[-2:]))
        self.pictures.append(Pictures(case, view.case.images[number], view.method.name, *named))

    def write_sheets(self) -> None:
        """Write the paper's figure, and the gallery: pairs in rows of two, of several cases a row each."""
        engines = [method.name for method in self._compared]
        if self._columns:
            images = {case.name: case.images for case in self.run.cases}
            several = len(images) > 1
            labels = [f"{case}: " * several + images[case][number] for case, number in self._columns]
            rows = zip(["real", "segmented", *engines], zip(*self._columns.values(), strict=True), strict=True)
            self._write(FIGURE, labelled_grid(list(rows), labels))
        lines = []
        for case in dict.fromkeys(case for case, _ in self._pairs):
            pairs = [pair for (of, _), pair in self._pairs.items() if of == case]
            for first in range(0, len(pairs), PAIR_COLUMNS):
                chunk = pairs[first : first + PAIR_COLUMNS]
                label = f"{case}: novel poses {first + 1} to {first + len(chunk)}"
                lines.append((label, list(itertools.chain.from_iterable(chunk))))
        if lines:
            self._write(PAIRS, labelled_grid(lines, engines * PAIR_COLUMNS))

    def pictured(self, case: EvaluationCase) -> set[int]:
        """Numbers of a case's photographs of which a picture is shown; of several cases, the first view is, too."""
        columns = shown_numbers(len(case.images), MOST_COLUMNS) if len(self.run.cases) == 1 else ()
        return {number for name, number in self._stems if name == case.name}.union(columns)

    def _has_column(self, view: View) -> bool:
        """Whether the figure shows a view: of several cases the first photograph that shows the surface."""
        cases = [case.name for case in self.run.cases[:MOST_COLUMNS]]
        if len(self.run.cases) == 1:
            return view.number in shown_numbers(len(view.case.images), MOST_COLUMNS)
        return view.case.name in cases and self._first.setdefault(view.case.name, view.number) == view.number

    def _write(self, name: str, image: np.ndarray) -> None:
        write_output(self.run.out / name, encode_png(to_uint8(image)))
