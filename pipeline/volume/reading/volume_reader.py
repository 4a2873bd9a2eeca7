"""Volumes and label maps from files: NIfTI, NRRD, MetaImage, and folders of DICOM slices.

Headers are checked first (:mod:`.volume_header`); then SimpleITK reads the voxels in a process of its
own (:mod:`.voxel_decoder`), which leaves them in a temporary file.
"""

import json
import os
from collections.abc import Callable
from pathlib import Path

import numpy as np

from ...errors import InputError
from ...files.child_process import ChildError, called_apart
from ...files.content import read_beginning
from ...files.memory import available_bytes
from ...files.temporary import temporary_folder, unwritable_temporary, writing_temporary
from ..volume import Volume, VoxelGrid
from .dicom_series import MOST_FILES, SeriesInfo
from .stored_voxels import VolumeHeader, check_data
from .volume_header import read_header, volume_suffix
from .voxel_decoder import file_as_npy, series_as_json, series_as_npy

CPU_SECONDS, CPU_SECONDS_PER_MB = 20.0, 0.2
"""Of reading, by the size of the file, and by that of its voxels."""

WAITING = 20
"""Longest time of waiting in relation to that of computing: disks and networks may be slow."""

_COPIES = 2
"""Of the file's voxels that ITK holds for a moment: its own, and those of the library of the format."""

_OF_A_SLICE = 1 << 30
"""Bytes that reading DICOM takes at most, slice by slice: GDCM allocates whatever a header claims."""

_MARGIN = 512 << 20
"""Bytes that the child's libraries take."""


def read_volume(path: Path, *, series: int | None = None, crop_mm: np.ndarray | None = None) -> Volume:
    """Read a CT.

    Parameters
    ----------
    path
        A file (``.nii``, ``.nii.gz``, ``.nrrd``, ``.nhdr``, ``.mha``, ``.mhd``), or a folder of DICOM slices, which may
        lie in folders in it.
    series
        Number of the DICOM series as :func:`list_series` counts; needed only where several CTs are in the folder.
    crop_mm
        ``(2, 3)`` two corners of a box in LPS, mm; only the voxels that cover it are kept.

    Returns
    -------
    The volume in Hounsfield units, rounded to whole ones.

    Raises
    ------
    InputError
        No such file; another format; damaged or cut off; not three-dimensional; without orientation; sheared, with a
        tilted gantry, missing slices or varying steps; several series; not in HU, such as labels; larger than the
        memory; the crop box lies outside; SimpleITK is not installed.
    RunError
        A temporary file cannot be written.
    """
    path = Path(path)
    box = None
    if crop_mm is not None:
        crop = np.sort(np.asarray(crop_mm, np.float64), axis=0)
        if crop.shape != (2, 3) or not np.isfinite(crop).all():
            raise InputError(f"crop: expected two corners of 3 finite numbers in mm, found an array of {crop.shape}")
        box = crop.tolist()
    if _is_folder(path):
        values, grid = _series_voxels(path, series, box)
    else:
        if series is not None:
            raise InputError(f"{path}: expected a folder of DICOM files, found a file; series are for folders")
        values, grid = file_voxels(path, read_header(_volume_file(path)), "HU", box)
    return Volume(values, grid)


def list_series(folder: Path) -> tuple[SeriesInfo, ...]:
    """The series in a folder of DICOM files, and in the folders in it; numbers and sizes only, no names.

    Raises
    ------
    InputError
        Not a folder, no DICOM images in it, or files that cannot be read.
    """
    folder = Path(folder)
    if not _is_folder(folder):
        raise InputError(f"{folder}: expected a folder of DICOM files, found a file; give the folder that it is in")
    megabytes = _total_megabytes(folder)
    entries = json.loads(_called(series_as_json, b"", (str(folder),), megabytes, str(folder), _OF_A_SLICE))
    return tuple(
        SeriesInfo(**entry | {"size": tuple(entry["size"]), "spacing_mm": tuple(entry["spacing_mm"])})
        for entry in entries
    )


def is_dicom(path: Path) -> bool:
    """Whether a file begins as one of DICOM does.

    Raises
    ------
    InputError
        It cannot be read.
    """
    return read_beginning(path, "a volume", 132)[128:] == b"DICM"


def file_voxels(
    path: Path, header: VolumeHeader, wanted: str, box: list[list[float]] | None = None
) -> tuple[np.ndarray, VoxelGrid]:
    """The voxels of a file, read-only and ``(Z, Y, X)``, and where they lie.

    Parameters
    ----------
    path, header
        The file, and its header.
    wanted
        ``"HU"`` for int16, or ``"labels"`` for uint8 or uint16.
    box
        Two corners of a box in LPS, mm, to keep.

    Raises
    ------
    InputError
        As for :func:`read_volume`.
    RunError
        A temporary file cannot be written.
    """
    _check_memory(header, path.name)
    check_data(header, path.name)
    stated = None if header.mesh_from_index is None else header.mesh_from_index.tolist()
    data = json.dumps({"size": header.size, "mesh_from_index": stated, "box_mm": box}).encode()
    megabytes = (header.data.stat().st_size + header.data_bytes) / 2**20
    with temporary_folder() as folder:
        out = folder / "voxels.npy"
        # absolute: the child may not start where this process is
        arguments = (str(path.resolve()), str(out), wanted)
        return _voxels(out, _called(file_as_npy, data, arguments, megabytes, path.name))


def _series_voxels(folder: Path, series: int | None, box: list[list[float]] | None) -> tuple[np.ndarray, VoxelGrid]:
    if series is not None and series < 1:
        raise InputError(f"{folder}: expected a series from 1, found {series}")
    megabytes = _total_megabytes(folder)
    with temporary_folder() as temporary:
        out = temporary / "voxels.npy"
        arguments = (str(folder), str(out), series or 0)
        data = json.dumps({"box_mm": box}).encode()
        return _voxels(out, _called(series_as_npy, data, arguments, megabytes, str(folder), _OF_A_SLICE))


def _voxels(out: Path, answer: bytes) -> tuple[np.ndarray, VoxelGrid]:
    grid = json.loads(answer)
    if "unwritable" in grid:
        raise unwritable_temporary(grid["unwritable"])
    with writing_temporary():
        # not mapped: Windows could not remove the file, and what renews the disk's cache would read it again and again
        values = np.load(out, allow_pickle=False)
    values.setflags(write=False)
    return values, VoxelGrid(tuple(grid["size"]), np.array(grid["mesh_from_index"]))


def _called(
    function: Callable[..., bytes],
    data: bytes,
    arguments: tuple[str | int, ...],
    megabytes: float,
    where: str,
    most_bytes: int | None = None,
) -> bytes:
    cpu_seconds = CPU_SECONDS + CPU_SECONDS_PER_MB * megabytes
    try:
        return called_apart(
            function,
            data,
            arguments,
            seconds=WAITING * cpu_seconds,
            cpu_seconds=cpu_seconds,
            megabytes=((available_bytes() if most_bytes is None else most_bytes) + _MARGIN) / 2**20,
        )
    except ChildError as error:
        raise InputError(f"{where}: expected a volume, cannot read it ({error}); copy or export it again") from None


def _check_memory(header: VolumeHeader, where: str) -> None:
    needed, free = _COPIES * header.data_bytes + 2 * header.voxel_count, available_bytes()
    if needed > free:
        size = " x ".join(map(str, header.size))
        raise InputError(
            f"{where}: expected a volume that fits into memory, found one of {size} voxels, which takes "
            f"{needed / 2**30:.1f} GB to read, and {free / 2**30:.1f} GB are free; crop or resample it, for example in "
            "3D Slicer (Crop Volume)"
        )


def _is_folder(path: Path) -> bool:
    try:
        return path.is_dir()
    except (OSError, ValueError):
        return False


def _volume_file(path: Path) -> Path:
    """The path of a file, unless it is a single DICOM file."""
    if volume_suffix(path) is None and is_dicom(path):
        raise InputError(f"{path}: expected a folder of DICOM files, found one of them; give the folder of the series")
    return path


def _total_megabytes(folder: Path) -> float:
    """Size of all files in a folder and those in it."""
    count = size = 0
    try:
        for parent, _, names in os.walk(folder):
            count += len(names)
            if count > MOST_FILES:
                raise InputError(
                    f"{folder}: expected a folder of DICOM files, found more than {MOST_FILES:,} files in it; give the "
                    "folder of one examination"
                )
            size += sum(path.stat().st_size for name in names if (path := Path(parent, name)).is_file())
    except OSError as error:
        raise InputError(
            f"{folder}: expected a folder of DICOM files, cannot read it ({error.strerror}); check its permissions"
        ) from None
    return size / 2**20
