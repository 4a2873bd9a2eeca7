"""Label maps: names as others write them, and labels in the volume."""

import json

import numpy as np
import pytest

from oneframe.errors import InputError
from oneframe.volume.reading.label_map import read_labels
from oneframe.volume.volume import Volume, VoxelGrid

sitk = pytest.importorskip("SimpleITK")

LABELS = np.zeros((5, 6, 7), np.uint8)
LABELS[1:4, 1:3, 2:5], LABELS[2:4, 4:5, 1:6] = 3, 12


def write(path, values=LABELS, spacing=(0.5, 0.5, 0.5), origin=(1.0, 2, 3), **keys):
    image = sitk.GetImageFromArray(values)
    image.SetSpacing([float(each) for each in spacing])
    image.SetOrigin([float(each) for each in origin])
    for key, value in keys.items():
        image.SetMetaData(key, value)
    sitk.WriteImage(image, str(path))
    return path


def like(size=(7, 6, 5), spacing=0.5, origin=(1.0, 2, 3)) -> Volume:
    matrix = np.diag([spacing, spacing, spacing, 1.0])
    matrix[:3, 3] = origin
    return Volume(np.zeros(size[::-1], np.int16), VoxelGrid(size, matrix))


def test_names_of_slicer(tmp_path):
    """Only the anatomy in them, as a header may name the patient; a name of the user's own stands beside the map."""
    keys = {"Segment0_Name": "DOE JOHN Facial Nerve (L)", "Segment0_LabelValue": "3", "Segment1_Name": "DOE JOHN"}
    path = write(tmp_path / "a.seg.nrrd", **keys, Segment1_LabelValue="12", Segment1_Layer="0")
    labels = read_labels(path, like())
    assert labels.names == {3: "facial_nerve_left", 12: "label 12"}
    np.testing.assert_array_equal(labels.values, LABELS)
    (tmp_path / "labels.json").write_text(json.dumps({"labels": {"3": "other", "12": "tegmen"}}))
    assert read_labels(path).names == {3: "facial_nerve_left", 12: "tegmen"}
    path = write(tmp_path / "b.seg.nrrd", **{**keys, "Segment0_Name": "Temporal Bone"})
    assert read_labels(path).names[3] == "Temporal Bone"


SNAP = '# ITK-SnAP\n    0   0   0   0   0  0  0   "Clear Label"\n    3   255   0  0   1  1  1   "chorda"\n'


@pytest.mark.parametrize(
    ("name", "content", "expected"),
    [
        ("dataset.json", {"labels": {"background": 0, "facial nerve": 3, "all": [3, 12]}}, "facial nerve"),
        ("../dataset.json", {"labels": {"facial nerve": 3}}, "facial nerve"),
        ("case_1.json", {"labels": {"3": {"name": "stapes"}}}, "stapes"),
        ("labels.json", {"3": "stapes"}, "stapes"),
        ("case_1.txt", SNAP, "chorda"),
        ("case_1.label", SNAP.encode("utf-16"), "chorda"),
        ("other.json", {"labels": {"3": "no"}}, "label 3"),
        ("dataset.json", {"name": "without labels"}, "label 3"),
        ("case_1.json", {"Modality": "CT", "SeriesNumber": 3}, "label 3"),
    ],
)
def test_names_beside_the_map(tmp_path, name, content, expected):
    (tmp_path / "labelsTr").mkdir()
    text = json.dumps(content) if isinstance(content, dict) else content
    (tmp_path / "labelsTr" / name).write_bytes(text.encode() if isinstance(text, str) else text)
    assert read_labels(write(tmp_path / "labelsTr" / "case_1.nii.gz")).names == {3: expected, 12: "label 12"}


@pytest.mark.parametrize("dtype", [np.uint8, np.int16, np.float32])
def test_labels_of_any_type_of_number_and_equal_names_that_stay_apart(tmp_path, dtype):
    (tmp_path / "labels.json").write_text(json.dumps({"labels": {"3": "nerve", "12": "nerve"}}))
    labels = read_labels(write(tmp_path / "a.nrrd", LABELS.astype(dtype)))
    assert labels.names == {3: "nerve", 12: "nerve 12"}
    assert labels.values.dtype == np.uint8
    np.testing.assert_array_equal(labels.values, LABELS)
    assert set(read_labels(write(tmp_path / "b.nrrd", LABELS.astype(np.uint16) * 1000)).names) == {3000, 12000}


def test_a_map_on_a_finer_grid_keeps_its_own(tmp_path):
    finer = LABELS.repeat(2, 0).repeat(2, 1).repeat(2, 2)
    labels = read_labels(write(tmp_path / "a.nii.gz", finer, (0.25,) * 3, (0.875, 1.875, 2.875)), like((7, 2, 5)))
    assert labels.grid.size == (14, 12, 10)
    np.testing.assert_array_equal(labels.values, finer)


BAD = {
    "elsewhere": (LABELS, {"origin": (100, 2, 3)}, "all of them outside: they cover"),
    "lost header": (LABELS, {"spacing": (1, 1, 1), "origin": (0, 0, 0)}, "the header was lost"),
    "a CT": (LABELS.astype(np.int16) - 1000, {}, "looks like a CT; give it as the volume"),
    "an image": (np.arange(400, dtype=np.uint16).reshape(8, 5, 10), {}, "400 different values .*an image, not labels"),
    "probabilities": (LABELS.astype(np.float32) / 20, {}, "looks like probabilities"),
    "labels beyond 16 bits": (LABELS.astype(np.uint32) * 9999, {}, "the largest label is 65535"),
    "labels that are nearly whole": (LABELS.astype(np.float64) * 0.99999, {}, "fractions such as 2.99997"),
    "nothing": (LABELS * 0, {}, "found 0 everywhere"),
}


@pytest.mark.parametrize("name", BAD)
def test_what_is_no_label_map_of_the_volume_is_refused(tmp_path, name):
    values, place, expected = BAD[name]
    with pytest.raises(InputError, match=expected):
        read_labels(write(tmp_path / "a.nrrd", values, **place), like())


def test_overlapping_segments_and_broken_names_are_refused(tmp_path):
    vector = sitk.GetImageFromArray(np.stack([LABELS, LABELS], axis=-1), isVector=True)
    sitk.WriteImage(vector, str(tmp_path / "a.seg.nrrd"))
    with pytest.raises(InputError, match="export overlapping segments as a label map"):
        read_labels(tmp_path / "a.seg.nrrd")
    (tmp_path / "labels.json").write_text("{")
    with pytest.raises(InputError, match=r"labels\.json: expected JSON"):
        read_labels(write(tmp_path / "b.nrrd"))
    with pytest.raises(InputError, match="found a folder"):
        read_labels(tmp_path)
