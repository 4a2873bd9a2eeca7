"""What the header of a DICOM file says of its slice.

Only tags of :data:`TAGS` are looked at, and of these only numbers and known words are ever printed: everything else in
a header may name the patient. File names are not printed either; hospitals write names into them.
"""

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import InputError
from ..simple_itk import simple_itk
from .slice_geometry import SlicePlace

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

CT, ENHANCED_CT = "1.2.840.10008.5.1.4.1.1.2", ("1.2.840.10008.5.1.4.1.1.2.1", "1.2.840.10008.5.1.4.1.1.2.2")
DIRECTORY = "1.2.840.10008.1.3.10"
_META_UID = re.compile(rb"\x02\x00(.)\x00UI..([0-9.]*)", re.DOTALL)
_CLASS_UID = re.compile(rb"(?:\x08\x00\x16\x00|\x00\x08\x00\x16)(?:UI..|.{4})([0-9.]+)", re.DOTALL)


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


def unreadable(where: str, path: Path) -> InputError:
    """The error for a slice that GDCM cannot read."""
    syntax = (file_meta_information(path) or {}).get(0x0010, "")
    number = syntax if re.fullmatch(r"[0-9.]{1,64}", syntax) else "none"
    return InputError(
        f"{where}: cannot read its pixels; it is damaged or cut off (copy or export the series again), or compressed "
        f"in a way that GDCM does not know (transfer syntax {number}; decompress it with gdcmconv --raw or dcm2niix)"
    )


def file_meta_information(path: Path) -> dict[int, str] | None:
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
        found.setdefault(0x0002, CT)
    return found


def is_dicom_beginning(head: bytes) -> bool:
    """Whether a file's first 132 bytes are those of DICOM, with a preamble or without."""
    return head[128:132] == b"DICM" or head[:2] in (b"\x02\0", b"\x08\0", b"\0\x02", b"\0\x08")


def dicom_reader(path: Path) -> Any:
    reader = simple_itk().ImageFileReader()
    reader.SetImageIO("GDCMImageIO")
    reader.LoadPrivateTagsOff()
    reader.SetFileName(str(path))
    return reader


def tags_of(path: Path) -> dict[str, str] | None:
    """Values of :data:`TAGS`, empty where missing; ``None`` if it is no image that can be read."""
    reader = dicom_reader(path)
    try:
        reader.ReadImageInformation()
    except RuntimeError:
        return None
    tags = {name: reader.GetMetaData(tag).strip() if reader.HasMetaDataKey(tag) else "" for name, tag in TAGS.items()}
    if reader.GetSize()[2:] != (1,):
        tags["position"] = ""
    return tags


def slice_of(path: Path, tags: dict[str, str]) -> Slice:
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
