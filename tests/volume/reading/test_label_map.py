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
    (tmp_path / "labels.json").unlink()
    (tmp_path / "b_ColorTable.ctbl").write_text("3 κοχλίας 255 0 0 255\n12 面神经 255 0 0 255\n")
    path = write(tmp_path / "b.seg.nrrd", **{**keys, "Segment0_Name": "Temporal Bone"})
    assert read_labels(path).names == {3: "Temporal Bone", 12: "面神经"}


SLICER = (
    "# Color table file x.ctbl\n# 2 values\n0 Background 0 0 0 0\n3 лицевой_нерв 255 0 255 255\n12 (none) 0 0 0 0\n"
)
SNAP = '# ITK-SnAP\n    0   0   0   0   0  0  0   "Clear Label"\n    3   255   0  0   1  1  1   "chorda"\n'


@pytest.mark.parametrize(
    ("name", "content", "expected"),
    [
        ("dataset.json", {"labels": {"background": 0, "facial nerve": 3, "all": [3, 12]}}, "facial nerve"),
        ("../dataset.json", {"labels": {"facial nerve": 3}}, "facial nerve"),
        ("case_1.json", {"labels": {"3": {"name": "stapes"}}}, "stapes"),
        ("labels.json", {"labels": {"3": "stapes", "1" * 5000: "beyond Python's numbers"}}, "stapes"),
        ("labels.json", {"3": "stapes"}, "stapes"),
        ("case_1.txt", SNAP, "chorda"),
        ("case_1.label", SNAP.encode("utf-16"), "chorda"),
        ("case_1_ColorTable.ctbl", SLICER, "лицевой_нерв"),
        ("case_1_ColorTable.csv", "LabelValue,Name,Color_R\n3,कान की हड्डी,255\n", "कान की हड्डी"),
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


@pytest.mark.parametrize("dtype", [np.int16, np.int32, np.uint8])
def test_labels_that_a_scale_made_inexact_are_whole(tmp_path, dtype):
    nib = pytest.importorskip("nibabel")
    image = nib.Nifti1Image(LABELS.T.astype(np.float64), np.diag([-0.5, -0.5, 0.5, 1]))
    image.header.set_data_dtype(dtype)
    nib.save(image, tmp_path / "a.nii.gz")
    assert (nib.load(tmp_path / "a.nii.gz").get_fdata() != LABELS.T).any()
    np.testing.assert_array_equal(read_labels(tmp_path / "a.nii.gz").values, LABELS)


@pytest.mark.parametrize("cropped", [False, True])
def test_a_map_on_the_volumes_grid_is_in_its_place_or_refused(tmp_path, cropped):
    """Its axes in another order are; with x and y negated it is not, even if that is the same box."""
    centred = like(origin=(-1.5, -1.25, 3))
    if cropped:
        centred = Volume(centred.values[1:], centred.grid.shifted(np.array([0, 0, 1]), (7, 6, 4)), centred.grid)
    turned = write(tmp_path / "turned.nrrd", LABELS.transpose(1, 0, 2)[::-1], origin=(-1.5, 1.25, 3))
    text = turned.read_bytes().replace(b"(0,0.5,0) (0,0,0.5)", b"(0,0,0.5) (0,-0.5,0)")
    turned.write_bytes(text)
    assert read_labels(turned, centred).grid.size == (7, 5, 6)
    for origin, words in (((1.5, 1.25, 3), "x and y negated"), ((0, 0, 0), "up to 3.6 mm elsewhere")):
        path = write(tmp_path / "a.nrrd", origin=origin)
        if origin[0]:
            path.write_bytes(path.read_bytes().replace(b"(0.5,0,0) (0,0.5,0)", b"(-0.5,0,0) (0,-0.5,0)"))
        with pytest.raises(InputError, match=f"found as many voxels .*{words}: their header was lost"):
            read_labels(path, centred)
    with pytest.raises(InputError, match="their axes changed places"):
        read_labels(write(tmp_path / "a.nrrd", LABELS.transpose(2, 1, 0), origin=(-1.5, -1.25, 3)), centred)


BAD = {
    "elsewhere": (LABELS[1:], {"origin": (100, 2, 3)}, "all of them outside: they cover"),
    "a CT": (LABELS.astype(np.int16) - 1000, {}, "give a CT as the volume"),
    "an image": (np.arange(400, dtype=np.uint16).reshape(8, 5, 10), {}, "400 different values .*an image, not labels"),
    "probabilities": (LABELS.astype(np.float32) / 20, {}, "fractions such as 0.15: probabilities"),
    "labels beyond 16 bits": (LABELS.astype(np.uint32) * 9999, {}, "the largest label is 65535"),
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
