"""The header of a volume, before its voxels: SimpleITK reads it, and what it forgives is refused here.

ITK fills up a NIfTI file that was cut off, reads compressed voxels without their checksum, takes a file without
orientation for one along the patient's axes, chooses one of two orientations, and ignores units. Nothing of a header is
ever printed but numbers: text in it may name the patient.

Formats: NIfTI-1 (https://nifti.nimh.nih.gov/pub/dist/src/niftilib/nifti1.h), NRRD
(https://teem.sourceforge.net/nrrd/format.html) and MetaImage (https://itk.org/Wiki/MetaIO/Documentation).
"""

import re
import struct
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from ...errors import InputError
from ...files.content import LARGEST_TEXT, read_beginning, reading
from ...transforms import rotation_from_vector
from .header_checks import apart_mm, check_axes, simple_itk, three_dimensions

SUFFIXES = (".nii", ".nii.gz", ".nrrd", ".nhdr", ".mha", ".mhd")

_NIFTI_UNITS = {0: 1.0, 1: 1000.0, 2: 1.0, 3: 0.001}
"""Code -> mm; writers that state none mean mm."""

_NIFTI_FLOATS = {16: "f4", 64: "f8"}

_SPACES = ("left-posterior-superior", "lps", "right-anterior-superior", "ras", "left-anterior-superior", "las")
"""Of NRRD, those that ITK takes to LPS."""

_GZIP, _CHUNK = b"\x1f\x8b", 1 << 20


@dataclass(frozen=True)
class StoredVoxels:
    """Where a file holds its voxels.

    Attributes
    ----------
    path
        The file.
    start
        First byte of the voxels, or of their compressed stream; of a compressed NIfTI after decompression.
    size
        Bytes that they should take, not compressed.
    compressed
        ``"no"``, ``"voxels"``, or ``"file"``.
    floats
        Type of voxels that may be NaN where ITK makes 0 of it; empty elsewhere.
    """

    path: Path
    start: int
    size: int
    compressed: str
    floats: str = ""


@dataclass(frozen=True)
class VolumeHeader:
    """What a header claims.

    Attributes
    ----------
    size
        Voxels along x, y and z.
    mesh_from_index
        ``(4, 4)``, LPS mm.
    stored
        Where the voxels are.
    segments
        Names of segments by label, as 3D Slicer writes them.
    """

    size: tuple[int, int, int]
    mesh_from_index: np.ndarray
    stored: StoredVoxels
    segments: Mapping[int, str]


def volume_suffix(path: Path) -> str | None:
    """The suffix of a file that :func:`read_header` knows, in lower case; ``None`` for others."""
    return next((suffix for suffix in SUFFIXES[::-1] if path.name.lower().endswith(suffix)), None)


def read_header(path: Path) -> VolumeHeader:
    """Read and check the header of a volume.

    Raises
    ------
    InputError
        No such file; not a volume in a format of :data:`SUFFIXES`; damaged; not three-dimensional; several components;
        without orientation, or with two; axes that are not at right angles; implausible units.
    """
    suffix = volume_suffix(path)
    if suffix is None:
        raise InputError(
            f"{path}: expected a volume ({', '.join(SUFFIXES)}) or a folder of DICOM files, found another kind of "
            "file; convert it to NIfTI"
        )
    head = read_beginning(path, "a volume", LARGEST_TEXT)
    if not head:
        raise InputError(f"{path}: expected a volume, found an empty file; copy or export it again")
    if suffix.startswith(".nii"):
        stored = _checked_nifti(path, head)
    reader = simple_itk().ImageFileReader()
    reader.SetFileName(str(path))
    try:
        reader.ReadImageInformation()
    except RuntimeError:
        raise unreadable(path.name) from None
    size = three_dimensions(reader.GetSize(), path.name)
    pixel = simple_itk().GetPixelIDValueAsString(reader.GetPixelID())
    if reader.GetNumberOfComponents() != 1 or not re.match(r"\d", pixel):
        raise InputError(
            f"{path.name}: expected one number per voxel, found several or another kind (colour, vector, overlapping "
            "segments); save one component; in 3D Slicer, export overlapping segments as a label map"
        )
    matrix = matrix_of(reader)
    check_axes(matrix, path.name)
    if not suffix.startswith(".nii"):
        voxel_bytes = int(re.match(r"\d+", pixel)[0]) // 8  # type: ignore[index]
        stored = _checked_text(path, head, int(np.prod(size, dtype=object)) * voxel_bytes)
    return VolumeHeader(size, matrix, stored, _segments(reader))


def matrix_of(image: Any) -> np.ndarray:
    """``(4, 4)`` from the index (x, y, z) to LPS mm, of an image of ITK or its header."""
    ranks, matrix = len(image.GetSize()), np.eye(4)
    matrix[:3, :3] = np.reshape(image.GetDirection(), (ranks, ranks))[:3, :3] * image.GetSpacing()[:3]
    matrix[:3, 3] = image.GetOrigin()[:3]
    return matrix


def unreadable(where: str) -> InputError:
    """The error for a file that ITK cannot read."""
    return InputError(
        f"{where}: expected a volume, cannot read it; it is damaged or cut off, or its header contradicts itself: "
        "export it again as .nii.gz or .nrrd"
    )


def checked_chunks(stored: StoredVoxels, where: str) -> Iterator[bytes]:
    """The stored bytes of all voxels, in parts of whole voxels; in the end an error if some are missing.

    Raises
    ------
    InputError
        The file is shorter than its header claims, or damaged: a compressed one has a checksum.
    """
    found, waiting = 0, b""
    with reading(stored.path, "the voxels of a volume", None if stored.path.name == where else where):
        for chunk in _inflated(stored, where):
            found += len(chunk)
            waiting += chunk
            whole = len(waiting) & -8
            yield waiting[:whole]
            waiting = waiting[whole:]
    if found < stored.size:
        raise InputError(
            f"{where}: expected {stored.size:,} bytes of voxels as the header says, found {found:,} "
            f"({100 * found / stored.size:.0f} %); the file was cut off: copy or export it again"
        )


def _inflated(stored: StoredVoxels, where: str) -> Iterator[bytes]:
    """The bytes of the voxels, decompressed; no more than there should be."""
    skipped, left = (stored.start, stored.size) if stored.compressed == "file" else (0, stored.size)
    with open(stored.path, "rb") as file:
        file.seek(stored.start - skipped)
        for chunk in iter(lambda: file.read(_CHUNK), b"") if stored.compressed == "no" else _unzipped(file, where):
            part = chunk[skipped : skipped + left]
            skipped, left = max(skipped - len(chunk), 0), left - len(part)
            yield part
            # one chunk more than is needed: behind the last voxel stands the checksum
            if not left and len(chunk) > len(part):
                return


def _unzipped(file: BinaryIO, where: str) -> Iterator[bytes]:
    """What is compressed by gzip or zlib; several streams may follow one another."""
    stream = zlib.decompressobj(47)
    try:
        while packed := stream.unconsumed_tail or stream.unused_data or file.read(_CHUNK):
            if stream.eof:
                if not packed.startswith(_GZIP):
                    return
                stream = zlib.decompressobj(47)
            yield stream.decompress(packed, _CHUNK)
        yield stream.flush()
    except zlib.error:
        raise InputError(f"{where}: expected compressed voxels, found damaged ones; copy or export it again") from None


def _checked_nifti(path: Path, head: bytes) -> StoredVoxels:
    """Orientation, units and place of the voxels, from the 348 bytes of the header."""
    where, compressed = path.name, head[:2] == _GZIP
    if compressed:
        try:
            head = zlib.decompressobj(31).decompress(head, 352)
        except zlib.error:
            raise unreadable(where) from None
    order = next((order for order in "<>" if len(head) >= 348 and struct.unpack_from(order + "i", head) == (348,)), "")
    if not order or head[344:348] != b"n+1\0":
        kind = "NIfTI-2" if head[4:7] in (b"n+2", b"ni2") else "another"
        raise InputError(f"{where}: expected a NIfTI-1 file, found {kind}; convert it to NIfTI-1, or export it again")
    ranks, *dims = struct.unpack_from(order + "8h", head, 40)
    size = three_dimensions(dims[: max(ranks, 0)], where)
    datatype, bits = struct.unpack_from(order + "2h", head, 70)
    (start,) = struct.unpack_from(order + "f", head, 108)
    qform, sform = struct.unpack_from(order + "2h", head, 252)
    rows = np.array(struct.unpack_from(order + "12f", head, 280), np.float64).reshape(3, 4)
    if qform <= 0 and sform <= 0:
        raise _unoriented(where)
    mm = _NIFTI_UNITS.get(head[123] & 7)
    if mm is None:
        raise InputError(f"{where}: expected lengths in mm, found no unit of length; correct xyzt_units")
    if sform > 0:
        matrix = np.vstack([rows * mm, [0, 0, 0, 1]])
        check_axes(matrix, where)
        if qform > 0:
            _check_agreement(np.diag([mm, mm, mm, 1]) @ _qform(head, order), matrix, size, where)
    if not 352 <= start < 2**31 or bits <= 0:
        raise unreadable(where)
    stored = int(np.prod(size, dtype=object)) * bits // 8
    floats = order + _NIFTI_FLOATS[datatype] if datatype in _NIFTI_FLOATS else ""
    return StoredVoxels(path, int(start), stored, "file" if compressed else "no", floats)


def _qform(head: bytes, order: str) -> np.ndarray:
    """``(4, 4)`` RAS, by the quaternion of NIfTI, whose real part is not stored."""
    mirror, *spacing = struct.unpack_from(order + "4f", head, 76)
    numbers = np.array(struct.unpack_from(order + "6f", head, 256), np.float64)
    sine = np.linalg.norm(numbers[:3])
    turn = rotation_from_vector(numbers[:3] * 2 * np.arcsin(np.minimum(sine, 1)) / max(sine, 1e-9))
    axes = turn * spacing * [1, 1, -1 if mirror < 0 else 1]
    return np.vstack([np.column_stack([axes, numbers[3:]]), [0, 0, 0, 1]])


def _check_agreement(qform: np.ndarray, sform: np.ndarray, size: tuple[int, int, int], where: str) -> None:
    if found_mm := apart_mm(sform, qform, size):
        mirrored = np.linalg.det(qform[:3, :3]) * np.linalg.det(sform[:3, :3]) < 0
        raise InputError(
            f"{where}: expected one orientation, found two: qform and sform place voxels up to {found_mm:.1f} mm apart"
            f"{', and one mirrors the other' if mirrored else ''}; keep the right one, for example with nibabel: "
            "image.set_sform(image.get_qform()), or image.set_qform(image.get_sform()), and save"
        )


def _checked_text(path: Path, head: bytes, size: int) -> StoredVoxels:
    """Orientation, units and place of the voxels, from the lines of NRRD or MetaImage."""
    where, is_nrrd = path.name, head.startswith(b"NRRD")
    fields, start = _fields(head, is_nrrd)
    if is_nrrd:
        oriented = fields.get("space", "").lower() in _SPACES and "spacedirections" in fields
        units = set(re.findall(r'"([^"]*)"', fields.get("spaceunits", "")))
        packed = fields.get("encoding", "").lower() in ("gzip", "gz")
        name, local = fields.get("datafile", ""), "datafile" not in fields
        elsewhere = any(fields.get(skip, "0") != "0" for skip in ("lineskip", "byteskip"))
        is_binary = packed or fields.get("encoding", "").lower() == "raw"
    else:
        turned, spaced = {"transformmatrix", "rotation", "orientation"}, {"elementspacing", "elementsize"}
        oriented = not turned.isdisjoint(fields) and not spaced.isdisjoint(fields)
        units = {fields.get("distanceunits", "mm").lower()} - {"?"}
        packed = fields.get("compresseddata", "false").lower() == "true"
        name = fields.get("elementdatafile", "")
        local, elsewhere = name.upper() == "LOCAL", fields.get("headersize", "0") != "0"
        is_binary = fields.get("binarydata", "true").lower() == "true"
    if not oriented:
        raise _unoriented(where)
    if units - {"", "mm"}:
        raise InputError(f"{where}: expected lengths in mm, found another unit; convert it to mm")
    if not is_binary or elsewhere:
        raise InputError(
            f"{where}: expected binary voxels, raw or gzip, without a header of their own, found others; save it as "
            "one .nrrd or .mha file"
        )
    if local:
        return StoredVoxels(path, start, size, "voxels" if packed else "no")
    return StoredVoxels(_data_file(path, name), 0, size, "voxels" if packed else "no")


def _fields(head: bytes, is_nrrd: bool) -> tuple[dict[str, str], int]:
    """Fields by name in lower case without spaces, and where the voxels begin; keys of the user's own are left out."""
    fields: dict[str, str] = {}
    start = 0
    for line in head.split(b"\n"):
        start += len(line) + 1
        key, mark, value = line.decode("latin-1").partition(":" if is_nrrd else "=")
        if is_nrrd and not line.strip():
            break
        if mark and not value.startswith("="):
            fields[key.strip().lower().replace(" ", "")] = value.strip()
        if not is_nrrd and "elementdatafile" in fields:
            break
    return fields, start


def _data_file(path: Path, name: str) -> Path:
    """The file of the voxels that a header names; only one in the header's own folder."""
    name = name.removeprefix("./")
    if re.search(r"[/\\:%]|^\.*$|^LIST\b|\s\d+\s+\d+\s+\d+", name):
        raise InputError(
            f"{path.name}: expected the voxels in one file in the same folder, found another place; save it as one "
            "file (.nrrd or .mha)"
        )
    data = path.with_name(name)
    if not data.is_file():
        raise InputError(
            f"{path.name}: expected the file of its voxels beside it, as the header says; it is missing: copy it, too"
        )
    return data


def _segments(reader: Any) -> dict[int, str]:
    names: dict[int, str] = {}
    for key in reader.GetMetaDataKeys():
        if match := re.fullmatch(r"Segment(\d+)_Name", key):
            value = f"Segment{match[1]}_LabelValue"
            if reader.HasMetaDataKey(value) and (label := reader.GetMetaData(value).strip()).isdecimal():
                names[int(label)] = reader.GetMetaData(key).strip()
    return names


def _unoriented(where: str) -> InputError:
    return InputError(
        f"{where}: expected an orientation and a spacing, found none (NIfTI: qform_code and sform_code are 0; NRRD: no "
        "space and space directions; MetaImage: no TransformMatrix), so left and right are unknown; export it again "
        "from the original with its orientation"
    )
