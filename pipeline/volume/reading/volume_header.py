"""The header of a volume, before its voxels: SimpleITK reads it, and what it forgives is refused here.

ITK fills up a NIfTI file that was cut off, reads compressed voxels without their checksum, takes a file without
orientation for one along the patient's axes, chooses one of two orientations, and ignores units. Nothing of a header is
ever printed but numbers: text in it may name the patient.

Formats: NIfTI-1 (https://nifti.nimh.nih.gov/pub/dist/src/niftilib/nifti1.h) and NRRD
(https://teem.sourceforge.net/nrrd/format.html).
"""

import gzip
import re
import struct
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import InputError
from ...files.content import LARGEST_TEXT, read_beginning, reading
from ...transforms import rotation_from_vector
from ..simple_itk import simple_itk
from ..volume import VoxelGrid
from .volume_checks import apart_mm, check_axes, three_dimensions

SUFFIXES = (".nii", ".nii.gz", ".nrrd")

LABEL = re.compile(r"\d{1,9}")
"""The number of a label in words."""

_NIFTI_UNITS = {0: 1.0, 1: 1000.0, 2: 1.0, 3: 0.001}
"""Code -> mm; writers that state none mean mm."""

_NIFTI_FLOATS = {16: "f4", 64: "f8"}

_SPACES = ("left-posterior-superior", "lps", "right-anterior-superior", "ras", "left-anterior-superior", "las")
"""Spaces of NRRD that ITK takes to LPS."""

_CHUNK = 1 << 20


@dataclass(frozen=True)
class StoredVoxels:
    """What of a file's voxels ITK does not check.

    Attributes
    ----------
    path
        The file.
    start
        First byte of the voxels of a NIfTI file, after decompression; of others, of a compressed stream.
    size
        Bytes that the voxels of a NIfTI file take; ``None`` for others, whose length ITK checks.
    compressed
        Whether they are.
    floats
        Type of voxels that may be NaN where ITK makes 0 of it; empty elsewhere.
    """

    path: Path
    start: int
    size: int | None
    compressed: bool
    floats: str = ""


@dataclass(frozen=True)
class VolumeHeader:
    """What a header claims.

    Attributes
    ----------
    grid
        Where the voxels lie.
    voxel_bytes
        That each takes.
    stored
        Where the voxels are.
    segments
        Names of segments by label, as 3D Slicer writes them.
    """

    grid: VoxelGrid
    voxel_bytes: int
    stored: StoredVoxels
    segments: Mapping[int, str]


def volume_suffix(path: Path) -> str | None:
    """The suffix of a file that :func:`read_header` knows, in lower case; ``None`` for others."""
    return next((suffix for suffix in SUFFIXES[::-1] if path.name.lower().endswith(suffix)), None)


def read_header(path: Path) -> VolumeHeader:
    """Read and check the header of a volume."""
    suffix = volume_suffix(path)
    if suffix is None:
        raise InputError(
            f"{path}: expected a volume ({', '.join(SUFFIXES)}) or a folder of DICOM files, found another kind of "
            "file; convert it to NIfTI or NRRD, for example in 3D Slicer"
        )
    head = read_beginning(path, "a volume", LARGEST_TEXT)
    if not head:
        raise InputError(f"{path}: expected a volume, found an empty file; copy or export it again")
    if suffix.startswith(".nii"):
        stored, matrix = _checked_nifti(path, head)
    else:
        stored, matrix = _checked_nrrd(path, head), None
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
    if matrix is None:
        ranks, matrix = len(reader.GetSize()), np.eye(4)
        matrix[:3, :3] = np.reshape(reader.GetDirection(), (ranks, ranks))[:3, :3] * reader.GetSpacing()[:3]
        matrix[:3, 3] = reader.GetOrigin()[:3]
        check_axes(matrix, path.name)
    voxel_bytes = int(re.match(r"\d+", pixel)[0]) // 8  # type: ignore[index]
    return VolumeHeader(VoxelGrid(size, matrix), voxel_bytes, stored, _segments(reader))


def unreadable(where: str) -> InputError:
    """The error for a file that ITK cannot read."""
    return InputError(
        f"{where}: expected a volume, cannot read it; it is damaged or cut off, has another name than its format, its "
        "header contradicts itself, or ITK does not know its voxels: export it again as .nii.gz or .nrrd"
    )


def check_stored(stored: StoredVoxels, where: str) -> int:
    """Check the stored bytes for what ITK forgives; return the number of voxels that are no number where it makes 0."""
    with reading(stored.path, "the voxels of a volume", None if stored.path.name == where else where):
        try:
            return _check_stream(stored) if stored.size is None else _check_nifti_voxels(stored, stored.size, where)
        except (zlib.error, gzip.BadGzipFile):
            raise InputError(
                f"{where}: expected compressed voxels, found damaged ones; copy or export it again"
            ) from None


def _check_stream(stored: StoredVoxels) -> int:
    stream = zlib.decompressobj(47)
    with open(stored.path, "rb") as file:
        file.seek(stored.start)
        while stored.compressed and not stream.eof and (packed := file.read(_CHUNK)):
            stream.decompress(packed)
    return 0


def _check_nifti_voxels(stored: StoredVoxels, size: int, where: str) -> int:
    found = not_finite = 0
    with (gzip.open if stored.compressed else open)(stored.path, "rb") as file:
        try:
            file.seek(stored.start)
            # to the end of a compressed file, where its checksum stands
            while chunk := file.read(_CHUNK if stored.compressed else min(_CHUNK, size - found)):
                part = chunk[: size - found]
                found += len(part)
                if stored.floats:
                    values = np.frombuffer(part, stored.floats, len(part) // np.dtype(stored.floats).itemsize)
                    not_finite += int(np.count_nonzero(~np.isfinite(values)))
        except EOFError:
            found = min(found, size - 1)
    if found < size:
        raise InputError(
            f"{where}: expected {size:,} bytes of voxels as the header says, found {found:,} "
            f"({100 * found / size:.0f} %); the file was cut off: copy or export it again"
        )
    return not_finite


def _checked_nifti(path: Path, head: bytes) -> tuple[StoredVoxels, np.ndarray]:
    """Place of the voxels, and their ``mesh_from_index``, from the 348 bytes of the header.

    ITK takes the spacing beside an sform from pixdim, where it need not be that of the sform.
    """
    where, compressed = path.name, head[:2] == b"\x1f\x8b"
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
    by_qform, by_sform = np.diag([mm, mm, mm, 1]) @ _qform(head, order), np.vstack([rows * mm, [0, 0, 0, 1]])
    matrix = by_sform if sform > 0 else by_qform
    check_axes(matrix, where)
    if qform > 0 and sform > 0:
        _check_agreement(by_qform, by_sform, size, where)
    slope, intercept = struct.unpack_from(order + "2f", head, 112)
    is_scaled = np.isfinite(slope) and slope != 0
    if not (np.isfinite(intercept) if is_scaled else intercept == 0 or not np.isfinite([slope, intercept]).any()):
        raise InputError(
            f"{where}: expected a scale of the voxels, found scl_slope {slope:g} with scl_inter {intercept:g}, which "
            "programs read in different ways; correct them, or export it again"
        )
    if not 352 <= start < 2**31 or bits <= 0:
        raise unreadable(where)
    stored = int(np.prod(size, dtype=object)) * bits // 8
    floats = order + _NIFTI_FLOATS[datatype] if datatype in _NIFTI_FLOATS else ""
    # NIfTI's axes point to the right and the front
    return StoredVoxels(path, int(start), stored, compressed, floats), np.diag([-1.0, -1.0, 1.0, 1.0]) @ matrix


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


def _checked_nrrd(path: Path, head: bytes) -> StoredVoxels:
    """Place of the voxels of an NRRD, whose header states orientation and units."""
    where, fields, start = path.name, dict[str, str](), 0
    for line in head.split(b"\n"):
        start += len(line) + 1
        if not line.strip():
            break
        key, mark, value = line.decode("latin-1").partition(":")
        # with "=" they are keys of the user's own
        if mark and not value.startswith("="):
            fields[key.strip().lower().replace(" ", "")] = value.strip()
    if fields.get("space", "").lower() not in _SPACES or "spacedirections" not in fields:
        raise _unoriented(where)
    units = set(re.findall(r'"([^"]*)"', fields.get("spaceunits", "")))
    if any(not re.fullmatch(r"|mm|millimet(er|re)s?", unit, re.IGNORECASE) for unit in units):
        raise InputError(f"{where}: expected lengths in mm, found another unit; convert it to mm")
    if "datafile" in fields or any(fields.get(skip, "0") != "0" for skip in ("lineskip", "byteskip")):
        raise InputError(
            f"{where}: expected the voxels right behind the header, found them elsewhere; save it as one .nrrd file, "
            "for example in 3D Slicer"
        )
    return StoredVoxels(path, start, None, fields.get("encoding", "").lower() in ("gzip", "gz"))


def _segments(reader: Any) -> dict[int, str]:
    names: dict[int, str] = {}
    for key in reader.GetMetaDataKeys():
        if match := re.fullmatch(r"Segment(\d+)_Name", key):
            value = f"Segment{match[1]}_LabelValue"
            label = reader.GetMetaData(value).strip() if reader.HasMetaDataKey(value) else ""
            if LABEL.fullmatch(label):
                names[int(label)] = reader.GetMetaData(key).strip()
    return names


def _unoriented(where: str) -> InputError:
    return InputError(
        f"{where}: expected an orientation and a spacing, found none (NIfTI: qform_code and sform_code are 0; NRRD: no "
        "space by the body's axes, or no space directions), so left and right are unknown; export it again "
        "from the original with its orientation"
    )
