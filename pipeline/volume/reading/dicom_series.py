"""The series in a folder of DICOM files, from their headers.

Only tags of :data:`TAGS` are looked at, and of these only numbers and known words are ever printed: everything else in
a header may name the patient. File names are not printed either; hospitals write names into them.
"""

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
from .header_checks import check_axes, check_memory
from .slice_geometry import FEWEST_SLICES, SlicePlace, stack_of
from .voxel_values import ValueSurvey

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
    "bits": "0028|0101",
    "high bit": "0028|0102",
    "intercept": "0028|1052",
    "slope": "0028|1053",
}
"""All that is read of a header; the identifiers of instance and series only tell files apart."""

MODALITIES = ("CT", "MR", "PT", "NM", "US", "XA", "RF", "CR", "DX", "OT", "SC", "RTDOSE", "SEG")

MOST_FILES = 50_000
"""In a folder of DICOM files and the folders in it, of any kind."""

_CT, _ENHANCED_CT = "1.2.840.10008.5.1.4.1.1.2", ("1.2.840.10008.5.1.4.1.1.2.1", "1.2.840.10008.5.1.4.1.1.2.2")
_DIRECTORY = "1.2.840.10008.1.3.10"
_META_UID = re.compile(rb"\x02\x00(.)\x00UI..([0-9.]*)", re.DOTALL)
_CLASS_UID = re.compile(rb"(?:\x08\x00\x16\x00|\x00\x08\x00\x16)(?:UI..|.{4})([0-9.]+)", re.DOTALL)


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
    ``fault`` says what GDCM reads otherwise than it is written; empty if there is nothing.
    """

    path: Path
    modality: str
    place: SlicePlace | None
    size: tuple[int, int]
    is_grey: bool
    is_rescaled: bool
    fault: str


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
    paths = _dicom_paths(folder)
    found: dict[str, dict[tuple[str, ...], list[tuple[int, Slice]]]] = {}
    for index, (path, group) in enumerate(paths):
        kind = group.get(0x0002, "")
        if kind in _ENHANCED_CT:
            raise InputError(
                f"{folder}: expected one slice per file, found an enhanced (multi-frame) CT; convert it to NIfTI, "
                "for example with dcm2niix"
            )
        tags = _tags(path)
        if tags is None:
            if kind == _CT:
                raise _unreadable(f"{folder}: file {index + 1} of {len(paths)} in the order of their names", path)
            continue
        if not tags["modality"] and kind == _CT:
            # an anonymised file may say it by the class of its image alone
            tags["modality"] = "CT"
        number = int(tags["series number"]) if re.fullmatch(r"-?\d{1,9}", tags["series number"]) else 0
        # identifiers are not always unique
        same = found.setdefault(tags["series"], {}).setdefault((tags["instance"], tags["position"]), [])
        # the same file twice, such as in two copies of a folder, counts once
        if not any(filecmp.cmp(path, other.path, shallow=False) for _, other in same):
            same.append((number, _slice(path, tags)))
    if not found:
        raise InputError(
            f"{folder}: expected DICOM files (.dcm or without a suffix), found no image in this folder; "
            "give the folder of the series, or a volume as a file"
        )
    parts = {uid: [part for same in alike.values() for part in same] for uid, alike in found.items()}
    ordered = sorted(parts, key=lambda uid: (min(number for number, _ in parts[uid]), -len(parts[uid]), uid))
    return tuple(_series(index + 1, [part for _, part in parts[uid]]) for index, uid in enumerate(ordered))


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


def series_voxels(chosen: Series, corners_mm: np.ndarray | None, folder: str) -> tuple[np.ndarray, VoxelGrid]:
    """The voxels of a series in HU, read-only ``(Z, Y, X)`` int16, and where they lie.

    Parameters
    ----------
    chosen
        The series.
    corners_mm
        ``(8, 3)`` of a box in LPS to keep; ``None`` keeps all.
    folder
        Begins messages.

    Raises
    ------
    InputError
        It is not a volume in HU, or damaged.
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
        pixels = simple_itk().GetArrayFromImage(_reader(part.path).Execute())
    except (RuntimeError, MemoryError):
        pixels = None
    if pixels is None or pixels.shape != (1, *part.size[::-1]):
        raise _unreadable(where, part.path)
    return pixels[0]


def _unreadable(where: str, path: Path) -> InputError:
    """The error for a slice that GDCM cannot read."""
    syntax = (_file_meta_information(path) or {}).get(0x0010, "")
    number = syntax if re.fullmatch(r"[0-9.]{1,64}", syntax) else "none"
    return InputError(
        f"{where}: cannot read its pixels; it is damaged or cut off (copy or export the series again), or compressed "
        f"in a way that GDCM does not know (transfer syntax {number}; decompress it with gdcmconv --raw or dcm2niix)"
    )


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
                group = _file_meta_information(path) if path.is_file() else None
                if group is not None and group.get(0x0002) != _DIRECTORY:
                    paths.append((path, group))
    except OSError as error:
        raise InputError(
            f"{folder}: expected a folder of DICOM files, cannot read it ({error.strerror}); check its permissions"
        ) from None
    return paths


def _file_meta_information(path: Path) -> dict[int, str] | None:
    """Identifiers in group 0002 by element below 256; ``None`` if the file is not DICOM.

    This group is never compressed, so a transfer syntax that cannot be read is named. Older files have neither it nor
    the preamble and begin with group 0008, in which the class of the image stands too.
    """
    with open(path, "rb") as file:
        head = file.read(4096)
    was_slice = (not head or path.suffix.lower() in (".dcm", ".ima")) and not path.name.startswith(".")
    if not is_dicom_beginning(head) and not was_slice:
        return None
    found = {element[0]: value.decode() for element, value in _META_UID.findall(head)}
    if image_class := _CLASS_UID.search(head):
        found.setdefault(0x0002, image_class[1].decode())
    elif was_slice or head[128:132] == b"DICM":
        # cut off before it says what it is: it must not be passed over
        found.setdefault(0x0002, _CT)
    return found


def is_dicom_beginning(head: bytes) -> bool:
    """Whether a file's first 132 bytes are those of DICOM, with a preamble or without."""
    return head[128:132] == b"DICM" or head[:2] in (b"\x02\0", b"\x08\0", b"\0\x02", b"\0\x08")


def _reader(path: Path) -> Any:
    reader = simple_itk().ImageFileReader()
    reader.SetImageIO("GDCMImageIO")
    reader.LoadPrivateTagsOff()
    reader.SetFileName(str(path))
    return reader


def _tags(path: Path) -> dict[str, str] | None:
    """Values of :data:`TAGS`, empty where missing; ``None`` if it is no image that can be read."""
    reader = _reader(path)
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
    is_rescaled = slope is not None and intercept is not None
    bits, high_bit, fault = numbers("bits", 1), numbers("high bit", 1), ""
    if slope is not None and slope[0] == 0:
        fault = "a Rescale Slope, found 0, which makes all voxels alike"
    elif bits is not None and high_bit is not None and high_bit[0] != bits[0] - 1:
        fault = f"voxels from the lowest bit on, found High Bit {high_bit[0]:.0f} of {bits[0]:.0f} Bits Stored"
    return Slice(path, modality, place, (columns, rows), is_grey, is_rescaled, fault)


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
