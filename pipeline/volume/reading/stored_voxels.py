"""Voxels in a file as its header claims them, and whether they are there: axes, size, length, checksum."""

import gzip
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO

import numpy as np

from ...errors import InputError
from ...files.content import reading
from ...transforms import transform_points

SMALLEST_SPACING_MM, LARGEST_SPACING_MM = 0.005, 20.0
"""Of voxels; others mean another unit than mm."""

_SAME_PLACE_VOXELS, _SAME_TURN = 0.1, 1e-3
"""Of two transforms of a header; near half turns, a quaternion in single precision is off by up to 8e-4 radians."""

_CHUNK = 1 << 20


@dataclass(frozen=True)
class VolumeHeader:
    """What a header claims.

    Attributes
    ----------
    size
        Voxels along x, y and z.
    voxel_bytes
        Bytes of one voxel in the file.
    data
        The file that holds the voxels.
    data_start
        Its first byte of voxels, or of their compressed stream; for a compressed NIfTI after decompression.
    encoding
        ``"raw"``, ``"gzip"``, ``"zlib"`` or ``"nifti-gzip"``: the whole file is compressed.
    mesh_from_index
        ``(4, 4)`` as stated, LPS mm; ``None`` if the header states it only by a quaternion.
    segments
        Names of segments by label, as 3D Slicer writes them.
    """

    size: tuple[int, int, int]
    voxel_bytes: int
    data: Path
    data_start: int
    encoding: str
    mesh_from_index: np.ndarray | None
    segments: Mapping[int, str] = field(default_factory=dict)

    @property
    def voxel_count(self) -> int:
        """Number of voxels."""
        return self.size[0] * self.size[1] * self.size[2]

    @property
    def data_bytes(self) -> int:
        """Bytes of all voxels, not compressed."""
        return self.voxel_count * self.voxel_bytes


def check_axes(mesh_from_index: np.ndarray, where: str) -> None:
    """Check the axes of voxels: finite, a plausible spacing, at right angles.

    Raises
    ------
    InputError
        They are not; ``where`` begins the message.
    """
    axes = mesh_from_index[:3, :3]
    spacing = np.linalg.norm(axes, axis=0)
    if not (np.isfinite(mesh_from_index).all() and (spacing > 0).all()):
        raise InputError(
            f"{where}: expected a spacing and an orientation, found zero, NaN or infinity; export it again"
        )
    if spacing.min() < SMALLEST_SPACING_MM or spacing.max() > LARGEST_SPACING_MM:
        raise InputError(
            f"{where}: expected voxels of {SMALLEST_SPACING_MM:g} to {LARGEST_SPACING_MM:g} mm, found "
            f"{by_axes(spacing)} mm; the header states another unit than it means: correct its spacing"
        )
    unit = axes / spacing
    cosine = np.abs(unit.T @ unit - np.eye(3)).max()
    if cosine > 1e-3:
        raise InputError(
            f"{where}: expected axes at right angles, found them sheared by {np.rad2deg(np.arcsin(min(cosine, 1))):.2f}"
            "°; resample it to an upright grid, for example in 3D Slicer (Resample Scalar Volume)"
        )


def apart_mm(one: np.ndarray, other: np.ndarray, size: tuple[int, int, int]) -> float:
    """How far apart two ``(4, 4)`` transforms place a corner voxel; 0 if no farther than headers round."""
    ends = np.array(np.meshgrid(*[(0.0, count - 1.0) for count in size])).reshape(3, -1).T
    places = transform_points(one, ends)
    distance = np.linalg.norm(transform_points(other, ends) - places, axis=1)
    rounding = _SAME_PLACE_VOXELS * np.linalg.norm(one[:3, :3], axis=0).min()
    same = distance <= rounding + _SAME_TURN * np.linalg.norm(places - places[0], axis=1)
    return 0.0 if same.all() else float(distance.max())


def check_data(header: VolumeHeader, where: str) -> None:
    """Check that the voxels are there: the length of the file, and of a compressed one each byte by its checksum.

    Raises
    ------
    InputError
        The file is shorter than the header claims, or damaged.
    """
    with reading(header.data, "the voxels of a volume", None if header.data.name == where else where):
        found = header.data.stat().st_size
        with open(header.data, "rb") as file:
            if header.encoding == "raw":
                found -= header.data_start
            else:
                found = _inflated_bytes(file, header, where)
    if found < header.data_bytes:
        size, percent = by_axes(np.array(header.size)), 100 * max(found, 0) / header.data_bytes
        raise InputError(
            f"{where}: expected {header.data_bytes:,} bytes for {size} voxels as the header says, found "
            f"{max(found, 0):,} ({percent:.0f} %); the file was cut off: copy or export it again"
        )


def _inflated_bytes(file: BinaryIO, header: VolumeHeader, where: str) -> int:
    """Number of bytes of voxels in a compressed stream, counted up to those that are needed."""
    needed, found = header.data_bytes, 0
    try:
        if header.encoding == "zlib":
            file.seek(header.data_start)
            stream = zlib.decompressobj()
            while not stream.eof and found <= needed:
                compressed = stream.unconsumed_tail or file.read(_CHUNK)
                if not compressed:
                    break
                found += len(stream.decompress(compressed, _CHUNK))
            return found
        if header.encoding == "gzip":
            file.seek(header.data_start)
        else:
            found = -header.data_start
        with gzip.GzipFile(fileobj=file) as unzipped:
            while found <= needed and (chunk := unzipped.read(_CHUNK)):
                found += len(chunk)
        return found
    except EOFError:
        return min(found, needed - 1)
    except (OSError, zlib.error) as error:
        if isinstance(error, OSError) and error.errno:
            raise
        raise InputError(
            f"{where}: expected compressed voxels, found damaged ones after {max(found, 0) >> 20} MB; "
            "copy or export it again"
        ) from None


def three_dimensions(dims: list[int], where: str) -> tuple[int, int, int]:
    """The size of a volume; a fourth dimension may only have one entry."""
    if len(dims) > 3 and all(count == 1 for count in dims[3:]):
        dims = dims[:3]
    if len(dims) > 3:
        raise InputError(
            f"{where}: expected a volume of 3 dimensions, found {len(dims)} ({by_axes(np.array(dims[:8]))}); "
            "save one volume of it, such as one point in time"
        )
    if len(dims) < 3 or min(dims) < 2:
        raise InputError(
            f"{where}: expected a volume of at least 2 voxels along each of 3 axes, found "
            f"{by_axes(np.array(dims)) or 'none'}; a single slice has no surface"
        )
    return dims[0], dims[1], dims[2]


def several_components(where: str) -> InputError:
    return InputError(
        f"{where}: expected one number per voxel, found several or another kind (colour, vector, overlapping "
        "segments); save one component; in 3D Slicer, export overlapping segments as a label map"
    )


def by_axes(counts: np.ndarray) -> str:
    """Numbers along x, y and z for a message."""
    return " x ".join(f"{count:.4g}" for count in counts) if counts.dtype.kind == "f" else " x ".join(map(str, counts))
