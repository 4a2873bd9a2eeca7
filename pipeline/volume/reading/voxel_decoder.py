"""Voxels of a file or a DICOM series as ``.npy``, in the child process of the reader. Needs ``SimpleITK``.

Nothing that ITK says is passed on: its messages quote lines of headers, which may name the patient.
"""

import gzip
import json
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from ...errors import InputError
from ..volume import VoxelGrid
from .dicom_series import Slice, chosen_series, find_series
from .slice_geometry import stack_of
from .stored_voxels import apart_mm, check_axes
from .voxel_values import ValueSurvey

_SLAB = 16
"""Slices that are converted at a time."""

_FLOATS = {"16": "f4", "64": "f8"}
"""Types of NIfTI voxels that may be NaN."""

_CHUNK = 1 << 22


def file_as_npy(data: bytes, name: str, out: str, wanted: str) -> bytes:
    """Write the voxels of a file to ``out``.

    Parameters
    ----------
    data
        JSON: ``size`` and ``mesh_from_index`` as :mod:`pipeline.volume.reading.volume_header` read them, ``box_mm``.
    name, out
        Paths of the volume and of the ``.npy``.
    wanted
        ``"HU"`` or ``"labels"``.

    Returns
    -------
    JSON: ``size`` and ``mesh_from_index`` of what was written, or ``unwritable``, the reason why it was not.

    Raises
    ------
    InputError
        It cannot be read, differs from its header, or holds something else than what is wanted.
    """
    stated, path = json.loads(data), Path(name)
    sitk = _simple_itk()
    reader = sitk.ImageFileReader()
    reader.SetFileName(name)
    try:
        reader.ReadImageInformation()
        size, ranks = list(reader.GetSize()), len(reader.GetSize())
        if reader.GetNumberOfComponents() != 1 or size[:3] != stated["size"]:
            raise RuntimeError
        if ranks > 3:
            reader.SetExtractSize([*size[:3], *[0] * (ranks - 3)])
        image = reader.Execute()
    except (RuntimeError, MemoryError):
        raise InputError(
            f"{path.name}: expected a volume, cannot read it; it is damaged, or its header contradicts itself "
            "(for example, axes not at right angles): export it again as .nii.gz or .nrrd"
        ) from None
    matrix = np.eye(4)
    matrix[:3, :3] = np.reshape(image.GetDirection(), (3, 3)) * image.GetSpacing()
    matrix[:3, 3] = image.GetOrigin()
    check_axes(matrix, path.name)
    grid = VoxelGrid(image.GetSize(), matrix)
    if stated["mesh_from_index"] is not None and apart_mm(np.array(stated["mesh_from_index"]), matrix, grid.size):
        raise InputError(
            f"{path.name}: expected one orientation, found a header that ITK understands in another way; export it "
            "again as .nii.gz or .nrrd"
        )
    values: np.ndarray = sitk.GetArrayViewFromImage(image)
    survey = ValueSurvey()
    if path.name.lower().endswith((".nii", ".nii.gz")) and (kind := _FLOATS.get(reader.GetMetaData("datatype"))):
        for chunk in _stored(path, int(float(reader.GetMetaData("vox_offset"))), values.size, kind):
            # ITK has made 0 of these
            survey.add(chunk[~np.isfinite(chunk)])
    for at in range(0, len(values), _SLAB):
        survey.add(values[at : at + _SLAB])
    _check_values(survey, wanted, path.name)
    first, stop = _box(grid, stated["box_mm"], path.name)
    part: np.ndarray = values[first[2] : stop[2], first[1] : stop[1], first[0] : stop[0]]
    try:
        dtype = np.int16 if wanted == "HU" else survey.label_type
        with _new_npy(out, part.shape, dtype) as file:
            for at in range(0, len(part), _SLAB):
                slab = part[at : at + _SLAB]
                file.write((np.rint(slab) if slab.dtype.kind == "f" else slab).astype(dtype).tobytes())
    except OSError as error:
        return _unwritable(error)
    return _grid_json(grid, first, stop)


def series_as_npy(data: bytes, folder: str, out: str, number: int) -> bytes:
    """Write the voxels of a DICOM series as HU to ``out``.

    Parameters
    ----------
    data
        JSON: ``box_mm``.
    folder, out
        Paths of the folder and of the ``.npy``.
    number
        Of the series, from 1; 0 for the only one.

    Returns
    -------
    JSON as of :func:`file_as_npy`.

    Raises
    ------
    InputError
        No series, several, or one that is not a volume in HU.
    """
    sitk = _simple_itk()
    chosen = chosen_series(find_series(Path(folder)), number or None, folder)
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
    first, stop = _box(grid, json.loads(data)["box_mm"], where)
    survey = ValueSurvey()
    shape = tuple(int(count) for count in (stop - first)[::-1])
    try:
        with _new_npy(out, shape, np.int16) as file:
            for z in range(first[2], stop[2]):
                pixels = _pixels(sitk, chosen.slices[order[z]], f"{where}, slice {z + 1} of {len(order)}")
                survey.add(pixels)
                kept = pixels[first[1] : stop[1], first[0] : stop[0]]
                # what is out of range is refused below
                file.write(np.rint(kept).clip(-(2**15), 2**15 - 1).astype(np.int16).tobytes())
    except OSError as error:
        return _unwritable(error)
    _check_values(survey, "HU", where)
    return _grid_json(grid, first, stop)


def series_as_json(_: bytes, folder: str) -> bytes:
    """The series of a folder as a JSON list of number, modality, slices, size and spacing.

    Raises
    ------
    InputError
        No series.
    """
    _simple_itk()
    return json.dumps([vars(series.info) for series in find_series(Path(folder))]).encode()


def _simple_itk() -> Any:
    """The library, silent and in one thread."""
    try:
        # in the child only: Blender need not load it
        import SimpleITK as sitk
    except ImportError:
        raise InputError(
            "volumes: expected the package SimpleITK, which reads CT, this Python has none; install it with "
            'pip install "SimpleITK>=2.5", or use a Blender in which the OneFrame extension is enabled'
        ) from None
    sitk.ProcessObject.SetGlobalWarningDisplay(False)
    # threads take memory each, and reading takes one
    sitk.ProcessObject.SetGlobalDefaultNumberOfThreads(1)
    return sitk


def _pixels(sitk: Any, part: Slice, where: str) -> np.ndarray:
    """``(H, W)`` values of a slice after its own rescale slope and intercept."""
    reader = sitk.ImageFileReader()
    reader.SetImageIO("GDCMImageIO")
    reader.SetFileName(str(part.path))
    try:
        pixels = sitk.GetArrayFromImage(reader.Execute())
    except (RuntimeError, MemoryError):
        pixels = None
    if pixels is None or pixels.shape != (1, *part.size[::-1]):
        raise InputError(f"{where}: cannot read its pixels; it is damaged: copy or export the series again")
    return pixels[0]


def _stored(path: Path, start: int, count: int, kind: str) -> Iterator[np.ndarray]:
    """The ``count`` voxels of a NIfTI file as they are stored, from byte ``start``, part by part."""
    with gzip.open(path) if path.name.lower().endswith(".gz") else open(path, "rb") as file:
        order = "<" if file.read(4) == struct.pack("<i", 348) else ">"
        file.seek(start)
        for at in range(0, count, _CHUNK):
            stored = file.read(min(_CHUNK, count - at) * int(kind[1]))
            yield np.frombuffer(stored, order + kind)


def _check_values(survey: ValueSurvey, wanted: str, where: str) -> None:
    if wanted == "HU":
        survey.check_hounsfield(where)
    else:
        survey.check_labels(where)


def _box(grid: VoxelGrid, box_mm: Any, where: str) -> tuple[np.ndarray, np.ndarray]:
    """First and one past the last voxel (x, y, z) of a box; of all voxels if it is ``None``."""
    if box_mm is None:
        return np.zeros(3, int), np.array(grid.size)
    lower, upper = np.array(box_mm, np.float64)
    return grid.box_of(lower, upper, f"{where}: crop")


def _new_npy(out: str, shape: tuple[int, ...], dtype: Any) -> BinaryIO:
    """An ``.npy`` file to append voxels to; one mapped into memory would crash the process on a full disk."""
    file = open(out, "wb")  # noqa: SIM115 - the caller closes it
    header = {"descr": np.lib.format.dtype_to_descr(np.dtype(dtype)), "fortran_order": False, "shape": shape}
    np.lib.format.write_array_header_1_0(file, header)
    return file


def _grid_json(whole: VoxelGrid, first: np.ndarray, stop: np.ndarray) -> bytes:
    columns, rows, slices = (int(count) for count in stop - first)
    grid = whole.shifted(first, (columns, rows, slices))
    return json.dumps({"size": grid.size, "mesh_from_index": grid.mesh_from_index.tolist()}).encode()


def _unwritable(error: OSError) -> bytes:
    return json.dumps({"unwritable": error.strerror or "unknown"}).encode()
