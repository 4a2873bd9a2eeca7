"""What the header of a volume claims, read before the voxels: size, type, place of the data, orientation and units.

Readers of volumes forgive much: ITK fills up a NIfTI file that was cut off, takes a file without orientation for one
along the patient's axes, and ignores units. So the headers are read here first, in Python, and nothing of them is ever
printed but numbers and the words of the format: text in them may name the patient.

Formats: NIfTI-1 (https://nifti.nimh.nih.gov/pub/dist/src/niftilib/nifti1.h), NRRD
(https://teem.sourceforge.net/nrrd/format.html) and MetaImage (https://itk.org/Wiki/MetaIO/Documentation).
"""

import re
import struct
import zlib
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from ...errors import InputError
from ...files.content import LARGEST_TEXT, read_beginning
from ...transforms import rotation_from_vector
from .stored_voxels import VolumeHeader, apart_mm, check_axes, several_components, three_dimensions

SUFFIXES = (".nii", ".nii.gz", ".nrrd", ".nhdr", ".mha", ".mhd")

_NIFTI_BYTES = {2: 1, 4: 2, 8: 4, 16: 4, 64: 8, 256: 1, 512: 2, 768: 4, 1024: 8, 1280: 8}
_NIFTI_UNITS = {0: 1.0, 1: 1000.0, 2: 1.0, 3: 0.001}
"""Code -> mm; writers that state none mean mm."""

_BYTES_OF_TYPE = {
    **dict.fromkeys(("signed char", "int8", "int8_t", "uchar", "unsigned char", "uint8", "uint8_t"), 1),
    **dict.fromkeys(("short", "short int", "signed short", "signed short int", "int16", "int16_t"), 2),
    **dict.fromkeys(("ushort", "unsigned short", "unsigned short int", "uint16", "uint16_t"), 2),
    **dict.fromkeys(("int", "signed int", "int32", "int32_t", "uint", "unsigned int", "uint32", "uint32_t"), 4),
    **dict.fromkeys(("longlong", "long long", "long long int", "signed long long", "int64", "int64_t"), 8),
    **dict.fromkeys(("ulonglong", "unsigned long long", "unsigned long long int", "uint64", "uint64_t"), 8),
    **{"float": 4, "double": 8},
    **{"met_char": 1, "met_uchar": 1, "met_short": 2, "met_ushort": 2, "met_int": 4, "met_uint": 4, "met_long": 4},
    **{"met_ulong": 4, "met_long_long": 8, "met_ulong_long": 8, "met_float": 4, "met_double": 8},
}
_NRRD_TO_LPS = {
    **dict.fromkeys(("left-posterior-superior", "lps"), (1, 1, 1)),
    **dict.fromkeys(("right-anterior-superior", "ras"), (-1, -1, 1)),
    **dict.fromkeys(("left-anterior-superior", "las"), (1, -1, 1)),
}
_LONGEST_LINE = 1 << 16
"""Bytes of a line of MetaImage; the voxels follow the last one."""

_SEGMENT = re.compile(r"Segment(\d+)_(Name|LabelValue)")
_VECTOR = re.compile(r"\(([^()]*)\)")


def volume_suffix(path: Path) -> str | None:
    """The suffix of a file that :func:`read_header` knows, in lower case; ``None`` for others."""
    return next((suffix for suffix in SUFFIXES[::-1] if path.name.lower().endswith(suffix)), None)


def read_header(path: Path) -> VolumeHeader:
    """Read and check the header of a volume.

    Raises
    ------
    InputError
        No such file; not a volume in a format of :data:`SUFFIXES`; not three-dimensional; several components; without
        orientation or spacing; oblique axes that are not at right angles; implausible units.
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
        header = _nifti_header(path, head)
    elif suffix.startswith(".n"):
        header = _nrrd_header(path, head)
    else:
        header = _metaimage_header(path, head)
    if header.mesh_from_index is not None:
        check_axes(header.mesh_from_index, path.name)
    return header


def _nifti_header(path: Path, head: bytes) -> VolumeHeader:
    where, compressed = path.name, head[:2] == b"\x1f\x8b"
    if compressed != path.name.lower().endswith(".gz"):
        is_so, name = ("compressed", ".nii.gz") if compressed else ("not compressed", ".nii")
        raise InputError(f"{where}: expected a file as its name says, found one that is {is_so}; rename it to {name}")
    if compressed:
        try:
            head = zlib.decompressobj(wbits=31).decompress(head, 352)
        except zlib.error:
            raise InputError(f"{where}: expected NIfTI, found a damaged gzip file; copy or export it again") from None
    order = next((order for order in "<>" if len(head) >= 348 and struct.unpack_from(order + "i", head) == (348,)), "")
    if not order or head[344:348] != b"n+1\0":
        kind = (
            "NIfTI-2" if head[4:7] in (b"n+2", b"ni2") else "a pair of files" if head[344:347] == b"ni1" else "another"
        )
        raise InputError(f"{where}: expected a NIfTI-1 file, found {kind}; convert it to NIfTI-1, or export it again")
    ranks, *dims = struct.unpack_from(order + "8h", head, 40)
    (datatype,) = struct.unpack_from(order + "h", head, 70)
    (start,) = struct.unpack_from(order + "f", head, 108)
    qform, sform = struct.unpack_from(order + "2h", head, 252)
    rows = np.array(struct.unpack_from(order + "12f", head, 280), np.float64).reshape(3, 4)
    size = three_dimensions(dims[: max(ranks, 0)], where)
    if datatype not in _NIFTI_BYTES:
        raise several_components(where)
    if qform <= 0 and sform <= 0:
        raise InputError(
            f"{where}: expected an orientation, found none (qform_code and sform_code are 0), so left and right are "
            "unknown; export it again from the original with its orientation"
        )
    mm = _NIFTI_UNITS.get(head[123] & 7)
    if mm is None:
        raise InputError(f"{where}: expected lengths in mm, found no unit of length; correct xyzt_units")
    matrix, lps = None, np.diag([-mm, -mm, mm, 1])
    if sform > 0:
        matrix = lps @ np.vstack([rows, [0, 0, 0, 1]])
    if matrix is not None and qform > 0:
        check_axes(matrix, where)
        _check_agreement(lps @ _qform(head, order), matrix, size, where)
    if not 352 <= start < 2**31:
        raise InputError(f"{where}: expected voxels after the header, found them at byte {start:g}; export it again")
    encoding = "nifti-gzip" if compressed else "raw"
    return VolumeHeader(size, _NIFTI_BYTES[datatype], path, int(start), encoding, matrix)


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


def _nrrd_header(path: Path, head: bytes) -> VolumeHeader:
    where = path.name
    if not re.match(rb"NRRD000[1-6]\r?\n", head):
        raise InputError(f"{where}: expected NRRD, found another kind of file; export it again")
    end = re.search(rb"\r?\n\r?\n", head)
    detached = end is None
    text = head[: end.start() if end else len(head)].decode("utf-8", errors="replace")
    fields: dict[str, str] = {}
    segments: dict[str, dict[str, str]] = {}
    for line in text.splitlines()[1:]:
        # a key of the user's own, such as a patient's name, is not even kept
        if ":=" in line and (": " not in line or line.index(":=") < line.index(": ")):
            key, _, value = line.partition(":=")
            if match := _SEGMENT.fullmatch(key.strip()):
                segments.setdefault(match[1], {})[match[2]] = value.strip()
        elif ":" in line and not line.startswith("#"):
            key, _, value = line.partition(":")
            fields[key.strip().lower().replace(" ", "")] = value.strip()
    kinds = fields.get("kinds", "").lower().split()
    if any(kind not in ("domain", "space", "???", "none") for kind in kinds):
        raise several_components(where)
    size = three_dimensions(_numbers(fields.get("sizes", ""), where, "sizes").astype(int).tolist(), where)
    voxel_bytes = _BYTES_OF_TYPE.get(fields.get("type", "").lower())
    if voxel_bytes is None:
        raise InputError(f"{where}: expected voxels of a whole or real number, found another type; convert it")
    signs = _NRRD_TO_LPS.get(fields.get("space", "").lower())
    directions = _VECTOR.findall(fields.get("spacedirections", ""))
    if signs is None or len(directions) != 3:
        raise InputError(
            f"{where}: expected an orientation (space: left-posterior-superior and space directions), found none, so "
            "left and right are unknown; export it again from the original with its orientation"
        )
    units = set(re.findall(r'"([^"]*)"', fields.get("spaceunits", ""))) - {"", "mm"}
    if units:
        raise InputError(f"{where}: expected space units of mm, found others; convert it to mm")
    axes = np.array([_numbers(text, where, "space directions", 3) for text in directions]).T
    origin = _numbers(re.sub(r"[()]", "", fields.get("spaceorigin", "(0,0,0)")), where, "space origin", 3)
    matrix = np.vstack([np.diag(signs) @ np.column_stack([axes, origin]), [0, 0, 0, 1]])
    encoding = {"raw": "raw", "gzip": "gzip", "gz": "gzip"}.get(fields.get("encoding", "").lower())
    if encoding is None:
        raise InputError(
            f"{where}: expected voxels stored as raw or gzip, found another encoding; save it as one of them"
        )
    if any(fields.get(skip, "0") != "0" for skip in ("lineskip", "byteskip")):
        raise InputError(f"{where}: expected no line skip or byte skip, found one; save it as one .nrrd file")
    data, start = path, end.end() if end else 0
    if "datafile" in fields:
        data, start = _data_file(path, fields["datafile"]), 0
    elif detached:
        raise InputError(f"{where}: expected voxels or the name of their file, found neither; export it again")
    return VolumeHeader(size, voxel_bytes, data, start, encoding, matrix, _segment_names(segments))


def _segment_names(segments: Mapping[str, Mapping[str, str]]) -> dict[int, str]:
    return {
        int(segment["LabelValue"]): segment["Name"]
        for segment in segments.values()
        if segment.get("LabelValue", "").isdecimal() and "Name" in segment
    }


def _metaimage_header(path: Path, head: bytes) -> VolumeHeader:
    where, fields, start = path.name, dict[str, str](), 0
    while start < len(head) and "elementdatafile" not in fields:
        line, _, _ = head[start : start + _LONGEST_LINE].partition(b"\n")
        key, equals, value = line.partition(b"=")
        if not equals or not (name := key.strip().decode("latin-1").lower()).isidentifier():
            break
        fields[name] = value.decode("latin-1").strip()
        start += len(line) + 1
    if "elementdatafile" not in fields or "dimsize" not in fields:
        raise InputError(f"{where}: expected MetaImage, found no DimSize and ElementDataFile; export it again")

    def first(*keys: str) -> str | None:
        return next((fields[key] for key in keys if key in fields), None)

    size = three_dimensions(_numbers(fields["dimsize"], where, "DimSize").astype(int).tolist(), where)
    voxel_bytes = _BYTES_OF_TYPE.get(fields.get("elementtype", "").lower())
    if fields.get("elementnumberofchannels", "1") != "1" or voxel_bytes is None:
        raise several_components(where)
    turn, spacing = first("transformmatrix", "rotation", "orientation"), first("elementspacing", "elementsize")
    origin = first("offset", "position", "origin")
    if turn is None or spacing is None:
        raise InputError(
            f"{where}: expected an orientation and a spacing (TransformMatrix and ElementSpacing), found none, so left "
            "and right are unknown; export it again from the original with its orientation"
        )
    if fields.get("distanceunits", "mm").lower() not in ("mm", "?"):
        raise InputError(f"{where}: expected DistanceUnits = mm, found others; convert it to mm")
    axes = _numbers(turn, where, "TransformMatrix", 9).reshape(3, 3).T * _numbers(spacing, where, "ElementSpacing", 3)
    offset = _numbers(origin or "0 0 0", where, "Offset", 3)
    matrix = np.vstack([np.column_stack([axes, offset]), [0, 0, 0, 1]])
    if fields.get("binarydata", "true").lower() == "false" or fields.get("headersize", "0") != "0":
        raise InputError(
            f"{where}: expected binary voxels without a header of their own, found others; save it as .mha"
        )
    encoding = "zlib" if fields.get("compresseddata", "false").lower() == "true" else "raw"
    data = path
    if fields["elementdatafile"].upper() != "LOCAL":
        data, start = _data_file(path, fields["elementdatafile"]), 0
    return VolumeHeader(size, voxel_bytes, data, start, encoding, matrix)


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


def _numbers(text: str, where: str, what: str, count: int | None = None) -> np.ndarray:
    try:
        numbers = np.array([float(word) for word in re.split(r"[\s,]+", text.strip()) if word])
    except ValueError:
        numbers = np.empty(0)
    if (count is not None and len(numbers) != count) or not len(numbers) or not np.isfinite(numbers).all():
        expected = "numbers" if count is None else f"{count} numbers"
        raise InputError(f"{where}: expected {expected} for {what}, found something else; export it again")
    if np.abs(numbers).max() > 1e9:
        raise InputError(f"{where}: expected numbers below 1e9 for {what}, found larger ones; export it again")
    return numbers
