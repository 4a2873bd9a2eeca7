"""The series in a folder of DICOM files, from their headers.

Only tags of :data:`TAGS` are looked at, and of these only numbers and known words are ever printed: everything else in
a header may name the patient. File names are not printed either; hospitals write names into them. Needs ``SimpleITK``,
in the child process of the reader.
"""

import os
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import InputError
from .slice_geometry import FEWEST_SLICES, SlicePlace

TAGS = {
    "instance": "0008|0018",
    "modality": "0008|0060",
    "series": "0020|000e",
    "series number": "0020|0011",
    "position": "0020|0032",
    "orientation": "0020|0037",
    "components": "0028|0002",
    "photometry": "0028|0004",
    "rows": "0028|0010",
    "columns": "0028|0011",
    "spacing": "0028|0030",
    "intercept": "0028|1052",
    "slope": "0028|1053",
}
"""All that is read of a header; the identifiers of instance and series only tell files apart."""

MODALITIES = ("CT", "MR", "PT", "NM", "US", "XA", "RF", "CR", "DX", "OT", "SC", "RTDOSE", "SEG")

MOST_FILES = 50_000
"""In a folder of DICOM files and the folders in it, of any kind."""

_CT, _ENHANCED_CT = "1.2.840.10008.5.1.4.1.1.2", ("1.2.840.10008.5.1.4.1.1.2.1", "1.2.840.10008.5.1.4.1.1.2.2")
_DIRECTORY = "1.2.840.10008.1.3.10"

_SYNTAXES = {
    "": "Little Endian",
    ".1": "Explicit Little Endian",
    ".1.99": "Deflated",
    ".2": "Explicit Big Endian",
    ".4.50": "JPEG Baseline",
    ".4.51": "JPEG Extended",
    ".4.57": "JPEG Lossless",
    ".4.70": "JPEG Lossless, First-Order Prediction",
    ".4.80": "JPEG-LS Lossless",
    ".4.81": "JPEG-LS Near-Lossless",
    ".4.90": "JPEG 2000 Lossless",
    ".4.91": "JPEG 2000",
    ".5": "RLE Lossless",
}
"""Transfer syntaxes that GDCM reads, by what follows ``1.2.840.10008.1.2`` (DICOM PS3.6, table A-1)."""

_UNREADABLE_SYNTAXES = {
    ".4.92": "JPEG 2000 multi-component",
    ".4.93": "JPEG 2000 multi-component",
    ".4.94": "JPIP",
    ".4.95": "JPIP",
    ".4.100": "MPEG-2",
    ".4.101": "MPEG-2",
    ".4.102": "MPEG-4",
    ".4.103": "MPEG-4",
    ".4.110": "JPEG XL Lossless",
    ".4.111": "JPEG XL Recompression",
    ".4.112": "JPEG XL",
    ".4.201": "High-Throughput JPEG 2000 Lossless",
    ".4.202": "High-Throughput JPEG 2000 Lossless with RPCL",
    ".4.203": "High-Throughput JPEG 2000",
}
_SYNTAX_ROOT = "1.2.840.10008.1.2"


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
class Slice:
    """A file of a series; ``place`` is ``None`` where the header states no geometry.

    ``is_rescaled`` tells whether it states slope and intercept; GDCM takes 1 and 0 for what is missing or no number.
    """

    path: Path
    modality: str
    place: SlicePlace | None
    size: tuple[int, int]
    is_grey: bool
    is_rescaled: bool


@dataclass(frozen=True)
class Series:
    """A series: what may be printed, and its slices in no order."""

    info: SeriesInfo
    slices: tuple[Slice, ...]


def find_series(folder: Path) -> tuple[Series, ...]:
    """The series of images in a folder and the folders in it, from all their headers.

    Raises
    ------
    InputError
        No DICOM images, a transfer syntax that cannot be read, multi-frame or damaged files.
    """
    paths = dicom_paths(folder)
    found: dict[str, dict[str, tuple[int, Slice]]] = {}
    for index, (path, group) in enumerate(paths):
        kind = group.get(0x0002, "")
        if kind in _ENHANCED_CT:
            raise InputError(
                f"{folder}: expected one slice per file, found an enhanced (multi-frame) CT; convert it to NIfTI, "
                "for example with dcm2niix"
            )
        if kind == _CT:
            _check_syntax(group.get(0x0010, ""), folder)
        tags = _tags(path)
        if tags is None:
            if kind == _CT:
                raise InputError(
                    f"{folder}: expected DICOM slices, cannot read file {index + 1} of {len(paths)} in the order of "
                    "their names; it is damaged or cut off: copy or export the series again"
                )
            continue
        number = int(tags["series number"]) if re.fullmatch(r"-?\d{1,9}", tags["series number"]) else 0
        # the same slice twice, such as in two copies of a folder, counts once
        found.setdefault(tags["series"], {}).setdefault(tags["instance"] or str(index), (number, _slice(path, tags)))
    if not found:
        raise InputError(
            f"{folder}: expected DICOM files (.dcm or without a suffix), found no image in this folder; "
            "give the folder of the series, or a volume as a file"
        )
    ordered = sorted(found, key=lambda uid: (min(number for number, _ in found[uid].values()), -len(found[uid]), uid))
    return tuple(_series(index + 1, [part for _, part in found[uid].values()]) for index, uid in enumerate(ordered))


def chosen_series(series: Sequence[Series], number: int | None, where: str) -> Series:
    """The series of this number, or the only one that may be a volume.

    Raises
    ------
    InputError
        No such number, several to choose from, or no CT.
    """
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


def dicom_paths(folder: Path) -> list[tuple[Path, dict[int, str]]]:
    """The DICOM files (with a preamble) in a folder and those in it, sorted, and their file meta information."""
    paths = []
    for parent, folders, names in os.walk(folder):
        folders.sort()
        for name in sorted(names):
            path = Path(parent, name)
            if path.is_file() and (group := file_meta_information(path)) is not None:
                if group.get(0x0002) == _DIRECTORY:
                    continue
                paths.append((path, group))
    return paths


def file_meta_information(path: Path) -> dict[int, str] | None:
    """Identifiers in group 0002 by element (DICOM PS3.10, 7.1); ``None`` if the file is not DICOM with a preamble.

    This group is never compressed, so a transfer syntax that cannot be read is named.
    """
    with open(path, "rb") as file:
        head = file.read(4096)
    if head[128:132] != b"DICM":
        return None
    elements, at = {}, 132
    while head[at : at + 2] == b"\x02\x00" and at + 12 <= len(head):
        element, kind = int.from_bytes(head[at + 2 : at + 4], "little"), head[at + 4 : at + 6]
        long = kind in (b"OB", b"OW", b"UN", b"UT", b"SQ")
        start = at + (12 if long else 8)
        length = int.from_bytes(head[at + 8 : start] if long else head[at + 6 : start], "little")
        if kind == b"UI":
            elements[element] = head[start : start + length].decode("latin-1").strip("\0 ")
        at = start + length
    return elements


def _check_syntax(syntax: str, folder: Path) -> None:
    code = syntax.removeprefix(_SYNTAX_ROOT)
    if syntax.startswith(_SYNTAX_ROOT) and code in _SYNTAXES:
        return
    name = _UNREADABLE_SYNTAXES.get(code, "a private or unknown one") if syntax else "none"
    number = f" ({syntax})" if re.fullmatch(r"[0-9.]{1,64}", syntax) else ""
    raise InputError(
        f"{folder}: expected slices that are not compressed, or by JPEG, JPEG-LS, JPEG 2000 or RLE; found the transfer "
        f"syntax {name}{number}; decompress them with a tool that knows it, such as gdcmconv --raw, dcmdjpeg or "
        "dcm2niix"
    )


def _tags(path: Path) -> dict[str, str] | None:
    """Values of :data:`TAGS`, empty where missing; ``None`` if it is no image that can be read."""
    # in the child only: Blender need not load it
    import SimpleITK as sitk

    reader = sitk.ImageFileReader()
    reader.SetImageIO("GDCMImageIO")
    reader.LoadPrivateTagsOff()
    reader.SetFileName(str(path))
    try:
        reader.ReadImageInformation()
    except RuntimeError:
        return None
    tags = {name: reader.GetMetaData(tag).strip() if reader.HasMetaDataKey(tag) else "" for name, tag in TAGS.items()}
    if reader.GetSize()[2:] != (1,):
        tags["position"] = ""
    return tags


def _slice(path: Path, tags: dict[str, str]) -> Slice:
    def numbers(name: str, count: int) -> np.ndarray | None:
        try:
            values = np.array([float(word) for word in tags[name].split("\\")])
        except ValueError:
            return None
        return values if len(values) == count and np.isfinite(values).all() else None

    counts = [numbers(name, 1) for name in ("columns", "rows")]
    columns, rows = (0 if count is None else int(count[0]) for count in counts)
    spacing, orientation, position = numbers("spacing", 2), numbers("orientation", 6), numbers("position", 3)
    place = None
    if spacing is not None and orientation is not None and position is not None and (spacing > 0).all():
        axes = orientation.reshape(2, 3)
        if np.abs(axes @ axes.T - np.eye(2)).max() < 1e-3:
            axes = axes / np.linalg.norm(axes, axis=1, keepdims=True)
            # the tag states the distance of rows first
            place = SlicePlace((columns, rows), spacing[::-1], axes, position)
    modality = tags["modality"] if tags["modality"] in MODALITIES else "other"
    is_grey = tags["components"] in ("", "1") and tags["photometry"] in ("", "MONOCHROME2")
    slope, intercept = numbers("slope", 1), numbers("intercept", 1)
    is_rescaled = slope is not None and intercept is not None and slope[0] != 0
    return Slice(path, modality, place, (columns, rows), is_grey, is_rescaled)


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
