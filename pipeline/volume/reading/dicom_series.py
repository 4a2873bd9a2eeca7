"""The series in a folder of DICOM files, from their headers; what is printed of them names no patient."""

import filecmp
import os
import re
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import InputError
from ..simple_itk import simple_itk
from ..volume import VoxelGrid
from .dicom_header import (
    APART,
    CT,
    DIRECTORY,
    IN_TURN,
    Slice,
    dicom_reader,
    has_pixels,
    image_class,
    slice_of,
    tags_of,
    unreadable,
)
from .slice_geometry import FEWEST_SLICES, stack_of
from .volume_checks import ValueSurvey, check_axes, check_memory, check_slices

MOST_FILES = 50_000
"""In a folder of DICOM files and the folders in it, of any kind."""

PADDING_HU = -1024
"""What padding becomes: air."""

_SMALL_NUMBER = re.compile(r"\d{1,4}(\.\d{1,3})?")
"""What is printed of a tag: too short to name anybody."""


@dataclass(frozen=True)
class SeriesInfo:
    """A series in a folder, without anything that names the patient.

    Attributes
    ----------
    number
        Counted from 1 in the order of the scanner's series numbers; what ``--series`` takes.
    modality
        ``"CT"``, ``"MR"``, ...; ``"other"`` if not one of :data:`MODALITIES`.
    slices
        Number of slices; of images, where a file has several.
    size
        Columns and rows.
    spacing_mm
        Distance of columns, of rows, and of slices (0 for a single slice).
    apart
        What tells it from others that share its Series Instance UID; empty if there are none.
    """

    number: int
    modality: str
    slices: int
    size: tuple[int, int]
    spacing_mm: tuple[float, float, float]
    apart: str

    @property
    def may_be_a_volume(self) -> bool:
        """Whether it is a CT of several slices: scouts and dose reports are not."""
        return self.modality == "CT" and self.slices >= FEWEST_SLICES

    def __str__(self) -> str:
        size = " x ".join(map(str, (*self.size, self.slices)))
        spacing = " x ".join(f"{value:.4g}" for value in self.spacing_mm)
        return f"{self.number}: {self.modality}, {self.slices} slices, {size} voxels, {spacing} mm{self.apart}"


@dataclass(frozen=True)
class Series:
    """A series: what may be printed, and its slices in no order."""

    info: SeriesInfo
    slices: tuple[Slice, ...]


def find_series(folder: Path) -> tuple[Series, ...]:
    """The series of images in a folder and the folders in it, from all their headers."""
    paths = _dicom_paths(folder)
    files: dict[str, dict[tuple[str, ...], list[Slice]]] = {}
    for index, (path, kind) in enumerate(paths):
        header = tags_of(path)
        # enhanced CT, too
        is_ct = f"{kind}.".startswith(f"{CT}.")
        if header is None:
            if is_ct:
                raise unreadable(f"{folder}: file {index + 1} of {len(paths)} in the order of their names")
            continue
        tags, frames = header
        if not tags["modality"] and is_ct:
            # an anonymised file may say it by the class of its image alone
            tags["modality"] = "CT"
        # identifiers are not always unique
        same = files.setdefault(tags["series"], {}).setdefault((tags["instance"], tags["position"]), [])
        # the same file twice, such as in two copies of a folder, counts once
        if not any(filecmp.cmp(path, other.path, shallow=False) for other in same):
            same.append(slice_of(path, tags, frames))
    if not files:
        raise InputError(
            f"{folder}: expected DICOM files (.dcm or without a suffix), found no image in this folder; "
            "give the folder of the series, or a volume as a file"
        )
    parts = [
        (min(map(_series_number, part)), -len(part), uid, apart, part)
        for uid, alike in files.items()
        for apart, part in _volumes([part for same in alike.values() for part in same])
    ]
    ordered = sorted(parts, key=lambda part: part[:4])
    return tuple(_series(index + 1, part, apart) for index, (*_, apart, part) in enumerate(ordered))


def chosen_series(series: Sequence[Series], number: int | None, where: str) -> Series:
    """The series of this number, or the only one that may be a volume."""
    if number is not None:
        if not 1 <= number <= len(series):
            raise InputError(f"{where}: expected a series from 1 to {len(series)}, found {number}; {_listing(series)}")
        chosen = series[number - 1]
    else:
        # a part of a series is never left out, however small
        volumes = [one for one in series if one.info.may_be_a_volume or one.info.apart] or list(series)
        alone = [one for one in series if one.info.modality == "CT" and one.info.slices == 1]
        if len(alone) >= FEWEST_SLICES and not any(one.info.may_be_a_volume for one in series):
            raise InputError(
                f"{where}: expected a series of slices, found {len(alone)} series of one slice each: each file has a "
                "Series Instance UID or Frame of Reference UID of its own; give them one, for example with DCMTK: "
                'dcmodify -m "(0020,000e)=1.2.3" -m "(0020,0052)=1.2.4" FILES'
            )
        if len(volumes) > 1:
            raise InputError(
                f"{where}: expected one series, found {len(series)}; {_listing(series)}; choose one with --series N"
            )
        chosen = volumes[0]
    if chosen.info.modality != "CT":
        raise InputError(f"{where}: expected a CT, found series {chosen.info}; choose another folder or series")
    return chosen


def series_voxels(
    chosen: Series, corners_mm: np.ndarray | None, folder: str
) -> tuple[np.ndarray, VoxelGrid, VoxelGrid]:
    """The voxels of a series in HU, read-only ``(Z, Y, X)`` int16, where they lie, and where those of the whole do.

    ``corners_mm``, ``(8, 3)``, is a box in LPS to keep, or all if ``None``; ``folder`` begins messages.
    """
    where = f"{folder}: series {chosen.info.number}"
    for part in chosen.slices:
        if part.fault:
            raise InputError(f"{where}: expected {part.fault}")
    grid, order = stack_of([part.place for part in chosen.slices if part.place is not None], where)
    check_axes(grid.mesh_from_index, where)
    stored = [z + 1 for z in range(len(order)) if not chosen.slices[order[z]].is_rescaled]
    if 0 < len(stored) < len(order):
        raise InputError(
            f"{where}: expected Rescale Slope and Intercept in all slices or in none, {len(stored)} of {len(order)} "
            f"are without (the first: slice {stored[0]}, counted along the series), so their HU are unknown; copy or "
            "export the series again"
        )
    first, stop = grid.box_of(corners_mm, f"{where}: crop")
    columns, rows, slices = (int(count) for count in np.subtract(stop, first))
    # of a slice, GDCM holds several copies, also in double precision
    check_memory(2 * columns * rows * slices + 32 * grid.size[0] * grid.size[1], grid.size, where)
    survey, voxels = ValueSurvey(), np.empty((slices, rows, columns), np.int16)
    for z in range(first[2], stop[2]):
        part = chosen.slices[order[z]]
        pixels = _pixels(part, f"{where}, slice {z + 1} of {len(order)}")
        if part.padding_hu is not None:
            padded = (pixels > part.padding_hu[0] - 1e-3) & (pixels < part.padding_hu[1] + 1e-3)
            survey.add(pixels[~padded])
            pixels = np.where(padded, PADDING_HU, pixels)
        else:
            survey.add(pixels)
        # what is out of range is refused below
        kept = np.rint(pixels[first[1] : stop[1], first[0] : stop[0]]).clip(-(2**15), 2**15 - 1)
        voxels[z - first[2]] = kept
    survey.check_hounsfield(where)
    check_slices(voxels, where)
    voxels.setflags(write=False)
    return voxels, grid.shifted(first, (columns, rows, slices)), grid


def _pixels(part: Slice, where: str) -> np.ndarray:
    """``(H, W)`` values of a slice after its own rescale slope and intercept."""
    try:
        reader = dicom_reader(part.path)
        pixels = simple_itk().GetArrayFromImage(reader.Execute())
        if not has_pixels(part.path, pixels.size * int(reader.GetMetaData("0028|0100")) // 8):
            pixels = None
    except (RuntimeError, MemoryError):
        pixels = None
    if pixels is None or pixels.shape != (1, *part.size[::-1]):
        raise unreadable(where)
    return pixels[0]


def _dicom_paths(folder: Path) -> list[tuple[Path, str]]:
    """The DICOM files in a folder and those in it, sorted, and what they hold."""
    paths, count = [], 0
    try:
        for parent, folders, names in os.walk(folder):
            folders.sort()
            count += len(names)
            if count > MOST_FILES:
                raise InputError(
                    f"{folder}: expected a folder of DICOM files, found more than {MOST_FILES:,} files in it; give the "
                    "folder of one examination"
                )
            for path in (Path(parent, name) for name in sorted(names)):
                kind = image_class(path) if path.is_file() else None
                if kind not in (None, DIRECTORY):
                    paths.append((path, kind))
    except OSError as error:
        raise InputError(
            f"{folder}: expected a folder of DICOM files, cannot read it ({error.strerror}); check its permissions"
        ) from None
    return paths


def _series_number(part: Slice) -> int:
    number = part.apart["Series Number"]
    return int(number) if re.fullmatch(r"-?\d{1,9}", number) else 0


def _volumes(slices: list[Slice]) -> list[tuple[str, list[Slice]]]:
    """The slices of a series, apart where a tag says that they are not of one volume, and which tag that is."""
    placed = [part.place for part in slices if part.place is not None]
    if len(placed) == len(slices):
        normal = np.cross(*placed[0].axes)
        slices = [
            slices[index] for index in np.argsort([place.position_mm @ normal for place in placed], kind="stable")
        ]
    volumes = [("", slices)]
    for name in (*APART, *IN_TURN):
        divided = []
        for apart, part in volumes:
            values = [each.apart[name] for each in part]
            different = sorted(set(values))
            runs = 1 + sum(one != other for one, other in pairwise(values))
            if len(different) == 1 or (name in IN_TURN and runs == len(different)):
                divided.append((apart, part))
                continue
            for number, value in enumerate(different, 1):
                words = f" {value}" if _SMALL_NUMBER.fullmatch(value) else ""
                among = f"{apart}, {name}{words} ({number} of {len(different)} in this series)"
                divided.append((among, [each for each in part if each.apart[name] == value]))
        volumes = divided
    return volumes


def _series(number: int, slices: list[Slice], apart: str) -> Series:
    first, step = slices[0], 0.0
    placed: list[Any] = [part.place for part in slices if part.place is not None]
    if len(placed) > 1:
        along = np.sort([place.position_mm @ np.cross(*placed[0].axes) for place in placed])
        step = float(np.median(np.diff(along)))
    column, row = placed[0].spacing_mm if placed else (0.0, 0.0)
    images = sum(part.frames for part in slices)
    info = SeriesInfo(number, first.modality, images, first.size, (float(column), float(row), step), apart)
    return Series(info, tuple(slices))


def _listing(series: Sequence[Series]) -> str:
    return "; ".join(str(one.info) for one in series[:12]) + ("; ..." if len(series) > 12 else "")
