"""The record of an alignment on one page: the frame with its overlay and residuals, and what the case states."""

from collections.abc import Iterator
from dataclasses import astuple, dataclass
from pathlib import Path

import cv2
import numpy as np

from ..alignment.landmarks.align_landmarks import complete_landmarks, landmark_arrays
from ..alignment.landmarks.picture import MAGNIFIED, with_residuals
from ..case.case_folder import made_by_file
from ..case.case_queue import state_of
from ..case.loaded_case import LoadedCase
from ..case.surface_doubts import size_text
from ..errors import InputError
from ..files.content import LARGEST_TEXT, read_content
from ..files.numbers import format_two_digits
from ..files.tables import parsed_json
from ..images.legend import Write
from ..images.pixel_values import to_uint8
from ..transforms import transform_points

PAGE_WH = 1240, 1754
"""A4, 150 px an inch."""

MARGIN, GAP, LETTERS_PX, HEADING_PX = 70, 18, 17.0, 21.0
LABEL_PX = 200
"""Width of the column of labels."""

UNITS = {"px": "px", "deg": "°", "mm": "mm"}
"""Ends of keys in ``[alignment]`` -> units."""

MADE_BY_KEYS = ("command", "threshold_hu", "strokes", "removed_mm3")

Section = tuple[str, list[tuple[str, str]]]


def record_page(loaded: LoadedCase, picture: np.ndarray, write: Write) -> np.ndarray:
    """The page, ``(H, W, 3)`` uint8, A4 upright.

    ``picture`` is the :func:`.case_picture` of the case at its pose, ``(H, W, 3)`` uint8.

    Raises
    ------
    InputError
        What there is to say does not fit on the page.
    """
    page, case = _Page(np.full((PAGE_WH[1], PAGE_WH[0], 3), 255, np.uint8), write), loaded.case
    width = PAGE_WH[0] - 2 * MARGIN
    used = tuple(complete_landmarks(case.landmarks).values())
    if used:
        picture = to_uint8(with_residuals(picture / np.float32(255), used, case.camera, case.cam_from_mesh))
    scale = min(width / picture.shape[1], 0.55 * PAGE_WH[1] / picture.shape[0])
    size = round(scale * picture.shape[1]), round(scale * picture.shape[0])
    picture = cv2.resize(picture, size, interpolation=cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR)
    title = f"Alignment of {case.path.parent.name or case.image.stem}"
    top = page.line(title, MARGIN, MARGIN // 2, 1.5 * HEADING_PX) + GAP
    left = MARGIN + (width - size[0]) // 2
    page.pixels[top : top + size[1], left : left + size[0]] = picture
    top += size[1] + GAP
    for number, sections in enumerate((_pose_sections(loaded), _source_sections(loaded))):
        page.column(sections, MARGIN + number * (width + GAP) // 2, top, (width - GAP) // 2)
    return page.pixels


def _pose_sections(loaded: LoadedCase) -> Iterator[Section]:
    case = loaded.case
    rows = [("state", state_of(case))]
    for key, value in case.alignment.items():
        if key == "image":
            continue
        unit = UNITS.get(key.rpartition("_")[2], "")
        label = key.removesuffix(f"_{key.rpartition('_')[2]}") if unit else key
        rows.append((label.replace("_", " "), _text(value, unit)))
    yield "Pose", rows
    used = tuple(complete_landmarks(case.landmarks).values())
    if used:
        points, pixels = landmark_arrays(used)
        apart = case.camera.project(transform_points(case.cam_from_mesh, points)) - pixels
        off = np.linalg.norm(apart, axis=1)
        rows = [(mark.name, f"{each:.2f} px") for mark, each in zip(used, off, strict=True)]
        yield f"Landmarks (drawn {MAGNIFIED:g} times as far off as they are)", rows


def _source_sections(loaded: LoadedCase) -> Iterator[Section]:
    case, camera = loaded.case, loaded.frame.camera
    rows = [("file", case.image.name), ("size", f"{camera.width} x {camera.height} px")]
    if case.video is not None:
        rows.append(("film", f"{case.video[0]}, frame {case.video[1]}"))
    if not loaded.frame.valid.all():
        rows.append(("masked", f"{1 - loaded.frame.valid.mean():.1%}"))
    yield "Frame", rows
    rows = [("fx, fy", f"{camera.fx:.2f}, {camera.fy:.2f} px"), ("cx, cy", f"{camera.cx:.2f}, {camera.cy:.2f} px")]
    if case.distortion is not None:
        rows.append(("distortion", ", ".join(f"{value:.4g}" for value in astuple(case.distortion))))
    yield "Camera", rows
    mesh = loaded.surface.mesh
    low, high = mesh.bounds
    rows = [("file", case.mesh.name), ("triangles", f"{len(mesh.faces):,}"), ("size", size_text(high - low))]
    made_by = _made_by(case.mesh)
    rows += [(key.replace("_", " "), _text(made_by[key], "")) for key in MADE_BY_KEYS if key in made_by]
    rows += [("structures", ", ".join(structure.name for structure in case.structures))] if case.structures else []
    yield "Surface", rows
    yield (
        "cam_from_mesh (OpenCV axes, mm)",
        [("", "  ".join(f"{value:.6f}" for value in row)) for row in case.cam_from_mesh[:3]],
    )


def _made_by(mesh: Path) -> dict[str, object]:
    """How a surface was made from its CT, if a file beside it says so."""
    path = made_by_file(mesh)
    if not path.exists():
        return {}
    record = parsed_json(read_content(path, "the record of a surface", str(path), most=LARGEST_TEXT), str(path))
    if not isinstance(record, dict):
        raise InputError(f"{path}: expected the record of a surface, found another file; remove it, or save the case")
    return record


def _text(value: object, unit: str) -> str:
    if isinstance(value, list):
        return " / ".join(_text(each, "") for each in value) + f" {unit}"
    return f"{format_two_digits(value) if isinstance(value, float) else value} {unit}".rstrip()


@dataclass(frozen=True)
class _Page:
    """``(H, W, 3)`` uint8 ``pixels`` that are written on."""

    pixels: np.ndarray
    write: Write

    def column(self, sections: Iterator[Section], left: int, top: int, width: int) -> None:
        """Write sections one below the other."""
        for heading, rows in sections:
            top = self.line(heading, left, top, HEADING_PX)
            for label, value in rows:
                indent = left + (LABEL_PX if label else 0)
                if label:
                    self.line(label, left, top, LETTERS_PX, grey=110)
                for line in self._wrapped(value, left + width - indent):
                    top = self.line(line, indent, top, LETTERS_PX)
            top += GAP

    def line(self, text: str, left: int, top: int, size_px: float, grey: int = 0) -> int:
        """Write a line; returns the top of the next one."""
        mask = self.write(text, size_px)
        part = self.pixels[top : top + mask.shape[0], left : left + mask.shape[1]]
        if part.shape[0] < mask.shape[0]:
            raise InputError("the record: expected lines for one page, found more; leave out landmarks that say little")
        over = mask[:, : part.shape[1], None]
        part[:] = np.rint(part * (1 - over) + grey * over)
        return top + mask.shape[0]

    def _wrapped(self, text: str, width: int) -> list[str]:
        """Lines that are no wider than this, broken between words; a word that is wider stays whole."""
        lines: list[str] = []
        for word in text.split(" ") or [""]:
            longer = f"{lines[-1]} {word}" if lines else word
            if lines and self.write(longer, LETTERS_PX).shape[1] <= width:
                lines[-1] = longer
            else:
                lines.append(word)
        return lines
