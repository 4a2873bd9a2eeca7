"""What the header of a DICOM file says of its slice.

Only tags of :data:`TAGS` are looked at, and of these only numbers and known words are ever printed: everything else in
a header may name the patient. File names are not printed either; hospitals write names into them.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import InputError
from ..simple_itk import simple_itk
from .slice_geometry import SlicePlace

APART = {
    "Frame of Reference UID": "0020|0052",
    "Convolution Kernel": "0018|1210",
    "KVP": "0018|0060",
    "Temporal Position Identifier": "0020|0100",
    "Nominal Percentage of Cardiac Phase": "0020|9241",
}
"""What all slices of a volume share: with two values, there are two volumes in a series."""

IN_TURN = {"Acquisition Number": "0020|0012", "Image Type": "0008|0008", "Series Number": "0020|0011"}
"""What may change once along a volume, as from one turn of the gantry to the next, but not to and fro."""

TAGS = {
    "instance": "0008|0018",
    "modality": "0008|0060",
    "series": "0020|000e",
    "position": "0020|0032",
    "orientation": "0020|0037",
    "components": "0028|0002",
    "photometry": "0028|0004",
    "rows": "0028|0010",
    "columns": "0028|0011",
    "spacing": "0028|0030",
    "bits": "0028|0101",
    "high bit": "0028|0102",
    "signed": "0028|0103",
    "padding": "0028|0120",
    "padding limit": "0028|0121",
    "intercept": "0028|1052",
    "slope": "0028|1053",
    "rescale type": "0028|1054",
    **APART,
    **IN_TURN,
}
"""All that is read of a header; identifiers and words only tell files apart."""

MODALITIES = ("CT", "MR", "PT", "NM", "US", "XA", "RF", "CR", "DX", "OT", "SC", "RTDOSE", "SEG")
RESCALE_TYPES = ("OD", "HU", "US", "MGML", "Z_EFF", "ED", "EDW", "HU_MOD", "PCT")
"""The standard's words; US is "unspecified"."""

CT, DIRECTORY = "1.2.840.10008.5.1.4.1.1.2", "1.2.840.10008.1.3.10"
_SYNTAX = re.compile(rb"\x02\x00\x10\x00UI..([0-9.]*)", re.DOTALL)
_UNCOMPRESSED = (b"1.2.840.10008.1.2", b"1.2.840.10008.1.2.1")
_PIXEL_DATA = re.compile(rb"\xe0\x7f\x10\x00(?:O[BW]\x00\x00)?(.{4})", re.DOTALL)
_CLASS_UID = re.compile(rb"(?:\x02\x00\x02\x00|\x08\x00\x16\x00|\x00\x08\x00\x16)(?:UI..|.{4})([0-9.]+)", re.DOTALL)


@dataclass(frozen=True)
class Slice:
    """A file of a series.

    Attributes
    ----------
    path, modality, size
        The file, one of :data:`MODALITIES` or "other", columns and rows.
    frames
        Number of images in the file.
    place
        ``None`` where the header states no geometry.
    is_rescaled
        Whether it states slope and intercept; GDCM takes 1 and 0 for what is missing or no number.
    padding_hu
        ``(2,)`` smallest and largest value that stands for no measurement; ``None`` for none.
    fault
        Why it is no slice of a CT, and what to do, to follow "expected"; empty if there is nothing.
    apart
        Values of :data:`APART` and :data:`IN_TURN` by name, never printed but for small numbers.
    """

    path: Path
    modality: str
    size: tuple[int, int]
    frames: int
    place: SlicePlace | None
    is_rescaled: bool
    padding_hu: np.ndarray | None
    fault: str
    apart: Mapping[str, str]


def unreadable(where: str) -> InputError:
    """The error for a slice that GDCM cannot read."""
    return InputError(
        f"{where}: cannot read its pixels; it is damaged or cut off (copy or export the series again), or compressed "
        "in a way that GDCM does not know (decompress it with gdcmconv --raw or dcm2niix)"
    )


def image_class(path: Path) -> str | None:
    """The identifier of what a file holds, empty if it does not say; ``None`` if it is not DICOM.

    It stands in group 0002, or, in older files, which begin with group 0008, in that.
    """
    with open(path, "rb") as file:
        head = file.read(4096)
    was_slice = (not head or path.suffix.lower() in (".dcm", ".ima")) and not path.name.startswith(".")
    if not is_dicom_beginning(head) and not was_slice:
        return None
    if match := _CLASS_UID.search(head):
        return match[1].decode()
    # cut off before it says what it is: it must not be passed over
    return CT if was_slice or head[128:132] == b"DICM" else ""


def is_dicom_beginning(head: bytes) -> bool:
    """Whether a file's first 132 bytes are those of DICOM, with a preamble or without."""
    return head[128:132] == b"DICM" or head[:2] in (b"\x02\0", b"\x08\0", b"\0\x02", b"\0\x08")


def dicom_reader(path: Path) -> Any:
    reader = simple_itk().ImageFileReader()
    reader.SetImageIO("GDCMImageIO")
    reader.LoadPrivateTagsOff()
    reader.SetFileName(str(path))
    return reader


def tags_of(path: Path) -> tuple[dict[str, str], int] | None:
    """Values of :data:`TAGS`, empty where missing, and the number of images; ``None`` if GDCM cannot read it."""
    reader = dicom_reader(path)
    try:
        reader.ReadImageInformation()
    except RuntimeError:
        return None
    tags = {name: reader.GetMetaData(tag).strip() if reader.HasMetaDataKey(tag) else "" for name, tag in TAGS.items()}
    return tags, int(np.prod(reader.GetSize()[2:]))


def has_pixels(path: Path, count: int) -> bool:
    """Whether a file without compression states at least so many bytes of pixels: GDCM fills up others at will."""
    data = path.read_bytes()
    syntax = _SYNTAX.search(data, 0, 4096)
    if syntax and syntax[1] not in _UNCOMPRESSED:
        return True
    lengths = [int.from_bytes(length, "little") for length in _PIXEL_DATA.findall(data)]
    return not lengths or lengths[-1] >= count


def slice_of(path: Path, tags: dict[str, str], frames: int) -> Slice:
    columns, rows = (0 if (count := _numbers(tags[name], 1)) is None else int(count[0]) for name in ("columns", "rows"))
    spacing, position = _numbers(tags["spacing"], 2), _numbers(tags["position"], 3)
    orientation, place = _numbers(tags["orientation"], 6), None
    if spacing is not None and orientation is not None and position is not None and (spacing > 0).all():
        axes = orientation.reshape(2, 3)
        if np.abs(axes @ axes.T - np.eye(2)).max() < 1e-3:
            axes = axes / np.linalg.norm(axes, axis=1, keepdims=True)
            # the tag states the distance of rows first
            place = SlicePlace((columns, rows), spacing[::-1], axes, position)
    slope, intercept = _numbers(tags["slope"], 1), _numbers(tags["intercept"], 1)
    padding, fault = _padding(tags)
    return Slice(
        path,
        tags["modality"] if tags["modality"] in MODALITIES else "other",
        (columns, rows),
        frames,
        place,
        slope is not None and intercept is not None,
        None
        if padding is None
        else np.sort(padding * (1 if slope is None else slope) + (0 if intercept is None else intercept)),
        _fault(tags, frames, place) or fault,
        {name: tags[name] for name in (*APART, *IN_TURN)},
    )


def _numbers(text: str, count: int) -> np.ndarray | None:
    try:
        values = np.array([float(word) for word in text.split("\\")])
    except ValueError:
        return None
    return values if len(values) == count and np.isfinite(values).all() else None


def _fault(tags: dict[str, str], frames: int, place: SlicePlace | None) -> str:
    again, convert = "export the original series again", "convert it to NIfTI, for example with dcm2niix"
    bits, high_bit, slope = (_numbers(tags[name], 1) for name in ("bits", "high bit", "slope"))
    if frames != 1:
        return f"one slice per file, found {frames} images in one file (multi-frame); {convert}"
    if place is None:
        return (
            "position, orientation and pixel spacing of each slice, found slices without, so left and right are "
            f"unknown; {again}"
        )
    if tags["components"] not in ("", "1") or tags["photometry"] not in ("", "MONOCHROME2"):
        kind = "inverted ones (MONOCHROME1)" if tags["photometry"] == "MONOCHROME1" else "others"
        return f"grey slices (MONOCHROME2), found {kind}; choose another series, or {convert}"
    if tags["rescale type"] not in ("", "HU"):
        kind = tags["rescale type"] if tags["rescale type"] in RESCALE_TYPES else "another"
        return f"Hounsfield units, found Rescale Type {kind}; if its numbers are HU all the same, {convert}"
    if slope is not None and slope[0] == 0:
        return f"a Rescale Slope, found 0, which makes all voxels alike; {again}"
    if bits is not None and high_bit is not None and high_bit[0] != bits[0] - 1:
        return f"voxels from the lowest bit on, found High Bit {high_bit[0]:.0f} of {bits[0]:.0f} Bits Stored; {again}"
    return ""


def _padding(tags: dict[str, str]) -> tuple[np.ndarray | None, str]:
    """The stored values from padding to its limit, ``(2,)``, and what is wrong with them."""
    padding, limit, bits = (_numbers(tags[name], 1) for name in ("padding", "padding limit", "bits"))
    if padding is None or bits is None:
        return None, ""
    # the tag may have 16 bits of either sign, whichever the voxels have
    lowest = 2 ** (bits[0] - 1) if tags["signed"] == "1" else 0
    stored = (np.concatenate([padding, padding if limit is None else limit]) + lowest) % 2**16 - lowest
    if (stored >= 2 ** bits[0] - lowest).any():
        return None, (
            f"a Pixel Padding Value of {bits[0]:.0f} Bits Stored, found {padding[0]:.0f}; set the padding to air, and "
            "export the series again"
        )
    return stored, ""
