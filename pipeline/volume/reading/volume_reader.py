"""Volumes and label maps from files: NIfTI, NRRD, and folders of DICOM slices.

Headers are checked first (:mod:`.volume_header`, :mod:`.dicom_series`); then SimpleITK reads the voxels.
"""

from pathlib import Path

import numpy as np

from ...errors import InputError
from ...files.content import read_beginning
from ..simple_itk import simple_itk
from ..volume import Volume, VoxelGrid, box_corners, box_slices
from .dicom_header import is_dicom_beginning
from .dicom_series import SeriesInfo, chosen_series, find_series, series_voxels
from .volume_checks import ValueSurvey, check_memory, check_slices
from .volume_header import VolumeHeader, check_stored, read_header, unreadable, volume_suffix

_COPIES = 2
"""Copies of the file's voxels that ITK holds for a moment: its own, and those of the library of the format."""

_SLAB = 16
"""Slices that are converted at a time."""


def read_volume(path: Path, *, series: int | None = None, crop_mm: np.ndarray | None = None) -> Volume:
    """Read a CT in Hounsfield units, rounded to whole ones.

    Parameters
    ----------
    path
        A file (``.nii``, ``.nii.gz``, ``.nrrd``), or a folder of DICOM slices, which may
        lie in folders in it.
    series
        Number of the DICOM series as :func:`list_series` counts; needed only where several CTs are in the folder.
    crop_mm
        ``(2, 3)`` two corners of a box in LPS, mm; only the voxels that cover it are kept.
    """
    path = Path(path)
    box = None
    if crop_mm is not None:
        crop = np.sort(np.asarray(crop_mm, np.float64), axis=0)
        if crop.shape != (2, 3) or not np.isfinite(crop).all():
            raise InputError(f"crop: expected two corners of 3 finite numbers in mm, found an array of {crop.shape}")
        box = box_corners(*crop)
    if series is not None:
        _require_folder(path, "series are for folders")
    if _is_folder(path):
        values, grid, whole = series_voxels(chosen_series(find_series(path), series, str(path)), box, str(path))
    else:
        header = read_header(_volume_file(path))
        (values, grid), whole = file_voxels(path, header, "HU", box), header.grid
    return Volume(values, grid, whole)


def list_series(folder: Path) -> tuple[SeriesInfo, ...]:
    """The series in a folder of DICOM files, and in the folders in it; numbers and sizes only, no names."""
    folder = Path(folder)
    _require_folder(folder, "give the folder that it is in")
    return tuple(series.info for series in find_series(folder))


def is_dicom(path: Path) -> bool:
    """Whether a file begins as one of DICOM does."""
    return is_dicom_beginning(read_beginning(path, "a volume", 132))


def file_voxels(
    path: Path, header: VolumeHeader, wanted: str, corners_mm: np.ndarray | None = None
) -> tuple[np.ndarray, VoxelGrid]:
    """The voxels of a file, read-only and ``(Z, Y, X)``, and where they lie.

    Parameters
    ----------
    path, header
        The file, and its header.
    wanted
        ``"HU"`` for int16, or ``"labels"`` for uint8 or uint16.
    corners_mm
        ``(8, 3)`` of a box in LPS to keep; ``None`` keeps all.
    """
    where, grid = path.name, header.grid
    needed = (_COPIES * header.voxel_bytes + 2) * int(np.prod(grid.size, dtype=object))
    check_memory(needed, grid.size, where)
    survey = ValueSurvey(not_finite=check_stored(header.stored, where))
    sitk = simple_itk()
    reader = sitk.ImageFileReader()
    reader.SetFileName(str(path))
    try:
        reader.ReadImageInformation()
        ranks = len(reader.GetSize())
        if ranks > 3:
            reader.SetExtractSize([*grid.size, *[0] * (ranks - 3)])
        image = reader.Execute()
    except (RuntimeError, MemoryError):
        raise unreadable(where) from None
    voxels: np.ndarray = sitk.GetArrayViewFromImage(image)
    for at in range(0, len(voxels), _SLAB):
        survey.add(voxels[at : at + _SLAB])
    if wanted == "HU":
        survey.check_hounsfield(where)
    else:
        survey.check_labels(where)
    first, stop = grid.box_of(corners_mm, f"{where}: crop")
    part = voxels[box_slices(first, stop)]
    kept = np.empty(part.shape, np.int16 if wanted == "HU" else survey.label_type)
    for at in range(0, len(part), _SLAB):
        slab = part[at : at + _SLAB]
        kept[at : at + _SLAB] = np.rint(slab) if slab.dtype.kind == "f" else slab
    if wanted == "HU":
        check_slices(kept, where)
    kept.setflags(write=False)
    depth, height, width = kept.shape
    return kept, grid.shifted(first, (width, height, depth))


def _is_folder(path: Path) -> bool:
    try:
        return path.is_dir()
    except (OSError, ValueError):
        return False


def _require_folder(path: Path, advice: str) -> None:
    if not _is_folder(path):
        # a path that leads nowhere is no file
        read_beginning(path, "a folder of DICOM files", 1)
        raise InputError(f"{path}: expected a folder of DICOM files, found a file; {advice}")


def _volume_file(path: Path) -> Path:
    """The path of a file, unless it is a single DICOM file."""
    if volume_suffix(path) is None and is_dicom(path):
        raise InputError(f"{path}: expected a folder of DICOM files, found one of them; give the folder of the series")
    return path
