"""The series in a folder of DICOM files, from their headers; what is printed of them names no patient."""

import filecmp
import os
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import InputError
from ..simple_itk import simple_itk
from ..volume import VoxelGrid
from .dicom_header import (
    CT,
    DIRECTORY,
    ENHANCED_CT,
    Slice,
    dicom_reader,
    file_meta_information,
    slice_of,
    tags_of,
    unreadable,
)
from .header_checks import check_axes, check_memory
from .slice_geometry import FEWEST_SLICES, stack_of
from .voxel_values import ValueSurvey

MOST_FILES = 50_000
"""In a folder of DICOM files and the folders in it, of any kind."""


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
        Number of slices.
    size
        Columns and rows.
    spacing_mm
        Distance of columns, of rows, and of slices (0 for a single slice).
    """

    number: int
    modality: str
    slices: int
    size: tuple[int, int]
    spacing_mm: tuple[float, float, float]

    @property
    def may_be_a_volume(self) -> bool:
        """Whether it is a CT of several slices: scouts and dose reports are not."""
        return self.modality == "CT" and self.slices >= FEWEST_SLICES

    def __str__(self) -> str:
        size = " x ".join(map(str, (*self.size, self.slices)))
        spacing = " x ".join(f"{value:.4g}" for value in self.spacing_mm)
        return f"{self.number}: {self.modality}, {self.slices} slices, {size} voxels, {spacing} mm"


@dataclass(frozen=True)
class Series:
    """A series: what may be printed, and its slices in no order."""

    info: SeriesInfo
    slices: tuple[Slice, ...]


def find_series(folder: Path) -> tuple[Series, ...]:
    """The series of images in a folder and the folders in it, from all their headers."""
    paths = _dicom_paths(folder)
    found: dict[str, dict[tuple[str, ...], list[tuple[int, Slice]]]] = {}
    for index, (path, group) in enumerate(paths):
        kind = group.get(0x0002, "")
        if kind in ENHANCED_CT:
            raise InputError(
                f"{folder}: expected one slice per file, found an enhanced (multi-frame) CT; convert it to NIfTI, "
                "for example with dcm2niix"
            )
        tags = tags_of(path)
        if tags is None:
            if kind == CT:
                raise unreadable(f"{folder}: file {index + 1} of {len(paths)} in the order of their names", path)
            continue
        if not tags["modality"] and kind == CT:
            # an anonymised file may say it by the class of its image alone
            tags["modality"] = "CT"
        number = int(tags["series number"]) if re.fullmatch(r"-?\d{1,9}", tags["series number"]) else 0
        # identifiers are not always unique
        same = found.setdefault(tags["series"], {}).setdefault((tags["instance"], tags["position"]), [])
        # the same file twice, such as in two copies of a folder, counts once
        if not any(filecmp.cmp(path, other.path, shallow=False) for _, other in same):
            same.append((number, slice_of(path, tags)))
    if not found:
        raise InputError(
            f"{folder}: expected DICOM files (.dcm or without a suffix), found no image in this folder; "
            "give the folder of the series, or a volume as a file"
        )
    parts = {uid: [part for same in alike.values() for part in same] for uid, alike in found.items()}
    ordered = sorted(parts, key=lambda uid: (min(number for number, _ in parts[uid]), -len(parts[uid]), uid))
    return tuple(_series(index + 1, [part for _, part in parts[uid]]) for index, uid in enumerate(ordered))


def chosen_series(series: Sequence[Series], number: int | None, where: str) -> Series:
    """The series of this number, or the only one that may be a volume."""
    if number is not None:
        if not 1 <= number <= len(series):
            raise InputError(f"{where}: expected a series from 1 to {len(series)}, found {number}; {_listing(series)}")
        chosen = series[number - 1]
    else:
        volumes = [one for one in series if one.info.may_be_a_volume] or list(series)
        if len(volumes) > 1:
            raise InputError(
                f"{where}: expected one series, found {len(series)}; {_listing(series)}; choose one with --series N"
            )
        chosen = volumes[0]
    if chosen.info.modality != "CT":
        raise InputError(f"{where}: expected a CT, found series {chosen.info}; choose another folder or series")
    return chosen


def series_voxels(chosen: Series, corners_mm: np.ndarray | None, folder: str) -> tuple[np.ndarray, VoxelGrid]:
    """The voxels of a series in HU, read-only ``(Z, Y, X)`` int16, and where they lie.

    ``corners_mm``, ``(8, 3)``, is a box in LPS to keep, or all if ``None``; ``folder`` begins messages.
    """
    where = f"{folder}: series {chosen.info.number}"
    places = []
    for part in chosen.slices:
        if part.place is None:
            raise InputError(
                f"{where}: expected position, orientation and pixel spacing of each slice, found slices without, so "
                "left and right are unknown; export the original series again"
            )
        if not part.is_grey:
            raise InputError(f"{where}: expected grey slices (MONOCHROME2), found others; it is no CT: choose another")
        if part.fault:
            raise InputError(f"{where}: expected {part.fault}; export the original series again")
        places.append(part.place)
    grid, order = stack_of(places, where)
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
        pixels = _pixels(chosen.slices[order[z]], f"{where}, slice {z + 1} of {len(order)}")
        survey.add(pixels)
        # what is out of range is refused below
        kept = np.rint(pixels[first[1] : stop[1], first[0] : stop[0]]).clip(-(2**15), 2**15 - 1)
        voxels[z - first[2]] = kept
    survey.check_hounsfield(where)
    voxels.setflags(write=False)
    return voxels, grid.shifted(first, (columns, rows, slices))


def _pixels(part: Slice, where: str) -> np.ndarray:
    """``(H, W)`` values of a slice after its own rescale slope and intercept."""
    try:
        pixels = simple_itk().GetArrayFromImage(dicom_reader(part.path).Execute())
    except (RuntimeError, MemoryError):
        pixels = None
    if pixels is None or pixels.shape != (1, *part.size[::-1]):
        raise unreadable(where, part.path)
    return pixels[0]


def _dicom_paths(folder: Path) -> list[tuple[Path, dict[int, str]]]:
    """The DICOM files in a folder and those in it, sorted, and their file meta information."""
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
                group = file_meta_information(path) if path.is_file() else None
                if group is not None and group.get(0x0002) != DIRECTORY:
                    paths.append((path, group))
    except OSError as error:
        raise InputError(
            f"{folder}: expected a folder of DICOM files, cannot read it ({error.strerror}); check its permissions"
        ) from None
    return paths


def _series(number: int, slices: list[Slice]) -> Series:
    first, step = slices[0], 0.0
    placed: list[Any] = [part.place for part in slices if part.place is not None]
    if len(placed) > 1:
        along = np.sort([place.position_mm @ np.cross(*placed[0].axes) for place in placed])
        step = float(np.median(np.diff(along)))
    spacing = placed[0].spacing_mm if placed else (0.0, 0.0)
    info = SeriesInfo(number, first.modality, len(slices), first.size, (float(spacing[0]), float(spacing[1]), step))
    return Series(info, tuple(slices))


def _listing(series: Sequence[Series]) -> str:
    return "; ".join(str(one.info) for one in series[:12]) + ("; ..." if len(series) > 12 else "")
