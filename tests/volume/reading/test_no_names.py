"""Nothing that names the patient leaves the reader: not in messages, results, or files, whatever the header holds."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from oneframe.errors import InputError
from oneframe.volume.reading.label_map import read_labels
from oneframe.volume.reading.volume_reader import list_series, read_volume

sitk = pytest.importorskip("SimpleITK")
pydicom = pytest.importorskip("pydicom")
nib = pytest.importorskip("nibabel")

SECRET = "ZQXDOE"
ROOT = Path(__file__).resolve().parents[3]

READ = """
import sys, pathlib
from oneframe.volume.reading.volume_reader import list_series, read_volume
from oneframe.volume.reading.label_map import read_labels
for call in (list_series, read_volume, read_labels):
    try:
        result = call(pathlib.Path(sys.argv[1]))
        print(result, getattr(result, "grid", ""), getattr(result, "names", ""))
    except Exception as error:
        print(type(error).__name__, error, file=sys.stderr)
"""


def planted(folder: Path) -> None:
    """Put the name into every tag of text that DICOM has for a CT's header, in each series of a folder."""
    from pydicom.datadict import DicomDictionary, keyword_for_tag

    needed = ["SOPClassUID", "SOPInstanceUID", "SeriesInstanceUID", "TransferSyntaxUID", "Modality", "InstanceNumber"]
    needed += ["PhotometricInterpretation", "SeriesNumber", "PixelSpacing", "SpecificCharacterSet"]
    words = {"AE", "CS", "LO", "LT", "PN", "SH", "ST", "UC", "UT"}
    tags = [
        tag
        for tag, entry in DicomDictionary.items()
        if entry[0] in words and tag >> 16 in (0x8, 0x10, 0x18, 0x20, 0x32)
    ]
    secrets = pydicom.Dataset()
    secrets.add_new(0x00091001, "LO", SECRET)
    for tag in tags:
        if (keyword := keyword_for_tag(tag)) and keyword not in needed:
            setattr(secrets, keyword, SECRET)
    for path in sorted(folder.rglob("*")):
        if path.is_file():
            dataset = pydicom.dcmread(path)
            dataset.update(secrets)
            dataset.save_as(path.with_name(f"{SECRET}-{path.name}"))
            path.unlink()


def spoken_and_written(path: Path, folder: Path) -> bytes:
    """All that a process prints and leaves behind that reads a path."""
    ended = subprocess.run(
        [sys.executable, "-c", READ, path.name],
        cwd=path.parent,
        env=os.environ | {"PYTHONPATH": str(ROOT), "TMPDIR": str(folder)},
        capture_output=True,
        check=True,
    )
    left = b"".join(each.read_bytes() + str(each).encode() for each in folder.rglob("*") if each.is_file())
    return ended.stdout + ended.stderr + left


def reported_by(call, path: Path) -> str:
    """What a function gives, or its error."""
    try:
        return repr(call(path))
    except InputError as error:
        return f"{error!r} {error.__cause__!r}"


def test_no_tag_of_dicom_is_ever_reported(write_series, tmp_path):
    """Read well, listed, and refused at each step: several series, a missing slice, no geometry, damage, modality."""
    from pydicom.uid import UID

    folders = []
    for name, options in {
        "good": {},
        "gap": {"missing": [2]},
        "unplaced": {"ImagePositionPatient": None},
        "other": {"Modality": SECRET},
        "wordy": {"PhotometricInterpretation": SECRET},
    }.items():
        folders.append(tmp_path / "in" / name)
        write_series(folders[-1], 4, **options)
    for name, number in (("two", 1), ("two", 2), ("cut", 1), ("syntax", 1)):
        write_series(tmp_path / "in" / name, 3, number=number)
    planted(tmp_path / "in")
    for path in (tmp_path / "in" / "cut").iterdir():
        path.write_bytes(path.read_bytes()[:-20])
    for path in (tmp_path / "in" / "syntax").iterdir():
        dataset = pydicom.dcmread(path)
        dataset.file_meta.TransferSyntaxUID = UID("1.2.3.4")
        dataset.save_as(path, implicit_vr=False, little_endian=True)
    folders += [tmp_path / "in" / name for name in ("two", "cut", "syntax")]
    assert all(SECRET.encode() in path.read_bytes() for path in (tmp_path / "in").rglob("*") if path.is_file())
    for folder in folders:
        for call in (list_series, read_volume, read_labels):
            assert SECRET not in reported_by(call, folder)
    (tmp_path / "out").mkdir()
    assert "spacing_mm" in reported_by(list_series, tmp_path / "in" / "good")
    reported = spoken_and_written(tmp_path / "in" / "good", tmp_path / "out")
    assert b"SeriesInfo" in reported
    assert SECRET.encode() not in reported


@pytest.mark.parametrize("suffix", [".nii", ".nrrd"])
@pytest.mark.parametrize("fault", ["none", "labels", "cut", "keyword"])
def test_no_text_of_a_header_is_ever_reported(tmp_path, suffix, fault):
    path, values = tmp_path / f"ct{suffix}", np.arange(-60, 60, dtype=np.int16).reshape(4, 5, 6)
    values = abs(values) % 3 if fault == "labels" else values
    sitk.WriteImage(sitk.GetImageFromArray(values), str(path))
    if suffix == ".nii":
        image = nib.load(path)
        image = nib.Nifti1Image(values.T, image.affine, image.header)
        for field in ("descrip", "aux_file", "intent_name", "db_name"):
            image.header[field] = SECRET.encode()
        nib.save(image, path)
    else:
        text = f"Segment0_Name:={SECRET}\nSegment0_LabelValue:=1\n"
        text += f"# {SECRET}\nPatient Name:={SECRET}\nSegment0_ID:={SECRET}\ncontent: {SECRET}\nlabels: "
        text += f'"{SECRET}" "{SECRET}" "{SECRET}"\n' + (f"no such line {SECRET}\n" if fault == "keyword" else "")
        path.write_bytes(path.read_bytes().replace(b"kinds:", text.encode() + b"kinds:", 1))
    assert SECRET.encode() in path.read_bytes()
    if fault == "cut":
        path.write_bytes(path.read_bytes()[:-20])
    reported = reported_by(read_volume, path) + reported_by(read_labels, path)
    assert "Volume(" in reported or "LabelMap(" in reported or "InputError" in reported
    assert SECRET not in reported
    if fault == "none":
        (tmp_path / "out").mkdir()
        spoken = spoken_and_written(path, tmp_path / "out")
        assert b"Volume(" in spoken
        assert SECRET.encode() not in spoken
