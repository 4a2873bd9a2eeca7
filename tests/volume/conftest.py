"""Volumes and DICOM series on disk."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest


@pytest.fixture(scope="session")
def write_series() -> Callable[..., np.ndarray]:
    """Writer of a CT series by pydicom, one file per slice under shuffled names; see :func:`series_on_disk`."""
    pytest.importorskip("pydicom")
    return series_on_disk


def series_on_disk(
    folder: Path,
    slices: int = 8,
    *,
    size: tuple[int, int] = (7, 6),
    spacing: tuple[float, float, float] = (0.4, 0.3, 0.9),
    rotation: np.ndarray | None = None,
    origin: Sequence[float] = (-10.0, 20.5, 300.0),
    places: Sequence[float] | None = None,
    shear_mm: float = 0.0,
    seed: int = 0,
    number: int = 3,
    missing: Sequence[int] = (),
    compress: str | None = None,
    **tags: object,
) -> np.ndarray:
    """Write a series, and give its ``(Z, Y, X)`` HU, slices in the direction of their normal.

    ``places`` are the slices' distances along the normal, in steps; ``shear_mm`` moves each slice along the rows'
    direction, as a tilted gantry does; ``tags`` replace those of each file, ``None`` deletes one.
    """
    import pydicom
    from pydicom.uid import CTImageStorage, ExplicitVRLittleEndian, generate_uid

    folder.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(seed)
    columns, rows = size
    turn = np.eye(3) if rotation is None else rotation
    places = range(slices) if places is None else places
    stored = rng.integers(0, 3000, (slices, rows, columns), dtype=np.uint16)
    series, names = generate_uid(), rng.permutation(slices)
    for index in range(slices):
        if index in missing:
            continue
        file = pydicom.Dataset()
        file.file_meta = pydicom.dataset.FileMetaDataset()
        file.file_meta.TransferSyntaxUID = ExplicitVRLittleEndian
        file.SOPClassUID, file.SOPInstanceUID = CTImageStorage, generate_uid()
        file.Modality, file.SeriesNumber, file.SeriesInstanceUID = "CT", number, series
        file.InstanceNumber = int(names[index])
        file.Rows, file.Columns, file.SamplesPerPixel, file.PhotometricInterpretation = rows, columns, 1, "MONOCHROME2"
        file.BitsAllocated, file.BitsStored, file.HighBit, file.PixelRepresentation = 16, 16, 15, 0
        file.RescaleSlope, file.RescaleIntercept = 1, -1024
        # the tag states the distance of rows first
        file.PixelSpacing = [spacing[1], spacing[0]]
        file.ImageOrientationPatient = [float(f"{value:.12f}") for value in (*turn[:, 0], *turn[:, 1])]
        position = np.asarray(origin) + turn[:, 2] * spacing[2] * places[index] + turn[:, 1] * shear_mm * index
        file.ImagePositionPatient = [float(f"{value:.10f}") for value in position]
        file.PixelData = stored[index].tobytes()
        for tag, value in tags.items():
            if value is None:
                delattr(file, tag)
            else:
                setattr(file, tag, value)
        if compress:
            file.compress(compress)
        file.save_as(folder / f"{names[index]:04d}-{number}", enforce_file_format=True)
    return stored.astype(np.int16) - 1024
