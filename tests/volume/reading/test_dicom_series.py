"""DICOM: slices come together by their positions whatever the files are called, and a stack with faults is refused."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from oneframe.errors import InputError
from oneframe.transforms import rotation_from_vector, transform_points
from oneframe.volume.reading.volume_checks import check_slices
from oneframe.volume.reading.volume_reader import list_series, read_volume
from tests.volume.solids import check_crop

pytest.importorskip("SimpleITK")
pydicom = pytest.importorskip("pydicom")


@settings(max_examples=8)
@given(vector=st.tuples(*[st.floats(-3, 3)] * 3), seed=st.integers(0, 99), step=st.floats(0.3, 3))
def test_a_voxel_is_read_where_it_was_written(write_series, tmp_path_factory, vector, seed, step):
    folder = tmp_path_factory.mktemp("series")
    turn, spacing = rotation_from_vector(np.array(vector)), (0.4, 0.3, step)
    values = write_series(folder, rotation=turn, spacing=spacing, seed=seed)
    volume = read_volume(folder)
    np.testing.assert_array_equal(volume.values, values)
    # columns, rows and slices of the last voxel
    last = np.array([6, 5, 7])
    expected = np.array([-10, 20.5, 300]) + turn @ (last * spacing)
    np.testing.assert_allclose(transform_points(volume.grid.mesh_from_index, last[None] * 1.0)[0], expected, atol=1e-5)
    assert not volume.grid.is_left_handed


def test_names_second_copies_a_scout_and_rounded_positions_do_not_matter(write_series, tmp_path):
    """Positions as headers round them, to 0.01 mm."""
    rounded = np.arange(8) + np.random.default_rng(1).uniform(-0.005, 0.005, 8) / 0.9
    values = write_series(tmp_path / "a" / "b", places=rounded)
    for index, path in enumerate(sorted((tmp_path / "a" / "b").iterdir())):
        if index % 2:
            (tmp_path / "copy").mkdir(exist_ok=True)
            (tmp_path / "copy" / f"{99 - index}.dcm").write_bytes(path.read_bytes())
    write_series(tmp_path / "scout", 1, number=1, seed=3, size=(20, 30))
    (tmp_path / "DICOMDIR.txt").write_text("not DICOM")
    volume = read_volume(tmp_path)
    np.testing.assert_array_equal(volume.values, values)
    np.testing.assert_allclose(volume.grid.mesh_from_index[:3, 2], [0, 0, 0.9], atol=0.005)


def test_a_crop_keeps_every_voxel_in_its_place(write_series, tmp_path):
    write_series(tmp_path)
    whole = read_volume(tmp_path)
    lower, upper = whole.grid.mesh_from_index[:3, 3] + [0.5, 0.4, 1.0], whole.grid.mesh_from_index[:3, 3] + [1.5, 1, 4]
    check_crop(whole, read_volume(tmp_path, crop_mm=np.stack([upper, lower])))


def test_several_series_are_listed_and_chosen_by_number(write_series, tmp_path):
    thin = write_series(tmp_path, number=5, seed=1)
    thick = write_series(tmp_path, 4, number=2, seed=2, spacing=(0.4, 0.3, 2.5))
    write_series(tmp_path, 1, number=1, seed=3)
    listed = list_series(tmp_path)
    assert [(one.number, one.slices, one.size) for one in listed] == [(1, 1, (7, 6)), (2, 4, (7, 6)), (3, 8, (7, 6))]
    np.testing.assert_allclose(listed[1].spacing_mm, (0.4, 0.3, 2.5))
    with pytest.raises(InputError, match=r"found 3; .*2: CT, 4 slices, .*--series N"):
        read_volume(tmp_path)
    np.testing.assert_array_equal(read_volume(tmp_path, series=2).values, thick)
    np.testing.assert_array_equal(read_volume(tmp_path, series=3).values, thin)
    with pytest.raises(InputError, match="expected a series from 1 to 3, found 4"):
        read_volume(tmp_path, series=4)


@pytest.mark.parametrize(
    ("slices", "options"),
    [
        # RLE; GDCM does not read it where a picture is so small that it grows by it
        (8, {"size": (16, 20), "compress": "1.2.840.10008.1.2.5"}),
        # anonymised: the class of the files tells that they are a CT
        (8, {"Modality": None}),
        # positions that an archive rounded
        (20, {"step": 0.625}),
        (20, {"step": 1.25}),
    ],
)
def test_series_as_others_store_them_have_their_values_in_equal_steps(write_series, tmp_path, slices, options):
    if step := options.pop("step", None):
        options["places"] = np.round(step * np.arange(slices), 1) / 0.9
    values = write_series(tmp_path, slices, **options)
    volume = read_volume(tmp_path)
    np.testing.assert_array_equal(volume.values, values)
    assert volume.grid.spacing_mm[2] == pytest.approx(step or 0.9, abs=0.002)


BAD = {
    "a missing slice": ({"missing": [4]}, "steps of 0.9 to 1.8 mm, the largest after slice 4 of 7.* export it again"),
    "two steps": ({"places": [0, 1, 2, 3, 4.3, 5.6, 6.9, 8.2]}, "steps of 0.9 to 1.17 mm.*resample it"),
    "a tilted gantry": ({"shear_mm": 0.9 * np.tan(np.deg2rad(12))}, r"gantry tilted by 12.00°.*resample"),
    "two slices at a place": ({"places": [0, 1, 2, 3, 0, 1, 2, 3]}, "found 4 places with several"),
    "too few": ({"slices": 2}, "at least 3 slices, found 2"),
    "MR": ({"Modality": "MR"}, "expected a CT, found series 1: MR, 8 slices"),
    "no position": ({"ImagePositionPatient": None}, "slices without, so left and right are unknown"),
    "no spacing": ({"PixelSpacing": None}, "slices without"),
    "no offset": ({"RescaleIntercept": 0}, "no negative ones"),
    "colours inverted": ({"PhotometricInterpretation": "MONOCHROME1"}, r"grey slices .*inverted ones \(MONOCHROME1\)"),
    "no HU": ({"RescaleType": "OD"}, "found Rescale Type OD"),
    "no slope": ({"RescaleSlope": 0}, "found 0, which"),
    "high bit": ({"BitsStored": 12}, "found High Bit 15 of 12 Bits Stored"),
    "padding beyond its bits": (
        *({"BitsStored": 12, "HighBit": 11, "PixelPaddingValue": 63536}, "Value of 12 Bits Stored, found 63536"),
    ),
}


@pytest.mark.parametrize("name", BAD)
def test_stacks_with_faults_are_refused_in_a_sentence(write_series, tmp_path, name):
    options, expected = BAD[name]
    write_series(tmp_path, **options)
    with pytest.raises(InputError, match=expected):
        read_volume(tmp_path)


@pytest.mark.parametrize(
    ("slices", "options", "expected"),
    [
        (8, {"size": (9, 6)}, "slices of one size, found 7 x 6 and 9 x 6"),
        (8, {"spacing": (0.5, 0.3, 0.9)}, "one pixel spacing, found 0.3 to 0.5 mm"),
        (8, {"rotation": rotation_from_vector(np.array([0.0, np.pi / 2, 0]))}, "found some that are turned"),
        # GDCM takes what such a slice stores for HU
        (1, {"RescaleSlope": None, "RescaleIntercept": None}, r"Slope and Intercept in all slices .* 1 of 9 "),
        (1, {"RescaleIntercept": ""}, r"Slope and Intercept in all slices .* 1 of 9 "),
        (8, {"origin": (-10, 20.5, 300), "seed": 1, "SOPInstanceUID": "1.2.3"}, "found 8 places with several"),
    ],
)
def test_slices_of_two_kinds_in_one_series_are_refused(write_series, tmp_path, slices, options, expected):
    own = {"SOPInstanceUID": options["SOPInstanceUID"]} if "SOPInstanceUID" in options else {}
    write_series(tmp_path / "first", SeriesInstanceUID="1.2.3", **own)
    behind = {"origin": (-10, 20.5, 307.2), "SeriesInstanceUID": "1.2.3"}
    write_series(tmp_path / "second", slices, **(behind | options))
    with pytest.raises(InputError, match=expected):
        read_volume(tmp_path)


def changed(folder, change) -> None:
    """Write every file again after ``change(dataset)``."""
    import pydicom

    for path in folder.iterdir():
        dataset = pydicom.dcmread(path)
        change(dataset)
        dataset.save_as(path)


def test_each_slice_has_its_own_rescale(write_series, tmp_path):
    """As some scanners choose it to use all bits."""
    values = write_series(tmp_path)

    def rescale(dataset) -> None:
        if dataset.InstanceNumber % 2:
            dataset.RescaleSlope, dataset.RescaleIntercept = 0.5, -100

    changed(tmp_path, rescale)
    odd = np.random.default_rng(0)
    odd.integers(0, 3000, values.shape, dtype=np.uint16)
    odd = odd.permutation(len(values)) % 2 == 1
    values[odd] = np.rint((values[odd] + 1024) * 0.5 - 100)
    np.testing.assert_array_equal(read_volume(tmp_path).values, values)


@pytest.mark.parametrize(("signed", "padding"), [(0, 63536), (0, 4095), (1, -32768), (1, -2000)])
def test_padding_is_air_whatever_its_value(write_series, tmp_path, signed, padding):
    values = write_series(tmp_path, PixelRepresentation=signed, PixelPaddingValue=padding)

    def pad(dataset) -> None:
        stored = np.frombuffer(dataset.PixelData, np.uint16).copy()
        stored[:9] = padding & 0xFFFF
        dataset.PixelData = stored.tobytes()

    changed(tmp_path, pad)
    values.reshape(len(values), -1)[:, :9] = -1024
    np.testing.assert_array_equal(read_volume(tmp_path).values, values)


@pytest.mark.parametrize(
    ("tags", "listed"),
    [
        ({"FrameOfReferenceUID": ["1.2.31234", "1.2.41234"]}, r"Frame of Reference UID \(1 of 2 in this series\)"),
        ({"KVP": [80, 140]}, r"KVP 140.0 \(1 of 2"),
        ({"ConvolutionKernel": ["H30s", "H60s"]}, r"mm, Convolution Kernel \(2 of 2"),
        ({"TemporalPositionIdentifier": [1, 2]}, "Temporal Position Identifier 1 "),
        ({"AcquisitionNumber": [1, 2]}, "Acquisition Number 2 "),
    ],
)
def test_two_volumes_in_one_series_are_chosen_from(write_series, tmp_path, tags, listed):
    """Half a step apart they would be one volume of a comb."""
    ((tag, pair),) = tags.items()
    values = [
        write_series(
            *(tmp_path / str(value), 8),
            seed=seed,
            origin=(-10, 20, 300 + 0.45 * seed),
            **{"SeriesInstanceUID": "1.2", tag: value},
        )
        for seed, value in enumerate(pair)
    ]
    with pytest.raises(InputError, match=rf"expected one series, found 2; .*{listed}.*choose one with --series N"):
        read_volume(tmp_path)
    found = [read_volume(tmp_path, series=number).values for number in (1, 2)]
    order = (1, 0) if tag == "KVP" else (0, 1)
    np.testing.assert_array_equal(found, [values[index] for index in order])


def test_where_no_header_tells_the_voxels_do():
    """Of two volumes that are interleaved, and of padding that would become a shell of bone."""
    z, y, x = np.indices((16, 20, 20))
    ball = np.where((x - 9) ** 2 + (y - 9) ** 2 + (z - 8) ** 2 < 36, 1200, -1000).astype(np.int16)
    check_slices(ball, "ct")
    with pytest.raises(InputError, match="every second one alike"):
        check_slices(np.where(z % 2, np.roll(ball, 4, axis=2), ball), "ct")
    with pytest.raises(InputError, match="3000, in a corner of all"):
        check_slices(np.where(np.hypot(x - 9, y - 9) > 10, 3000, ball), "ct")


def test_acquisitions_one_after_the_other_are_one_volume_and_series_of_one_slice_none(write_series, tmp_path):
    """As the table steps through a head; as some programs make names unknown."""
    values = write_series(tmp_path)
    changed(tmp_path, lambda d: setattr(d, "AcquisitionNumber", 1 + (d.ImagePositionPatient[2] > 303)))
    np.testing.assert_array_equal(read_volume(tmp_path).values, values)
    changed(tmp_path, lambda d: setattr(d, "SeriesInstanceUID", f"1.2.{d.InstanceNumber}"))
    with pytest.raises(InputError, match=r"found 8 series of one slice each: .*dcmodify"):
        read_volume(tmp_path)


@pytest.mark.parametrize("alike", [(3, 4), (6, 7), range(8)])
def test_slices_that_share_an_identifier_are_told_apart_by_position(write_series, tmp_path, alike):
    values = write_series(tmp_path)
    order = np.argsort([pydicom.dcmread(path).ImagePositionPatient[2] for path in sorted(tmp_path.iterdir())])
    for index in alike:
        path = sorted(tmp_path.iterdir())[order[index]]
        dataset = pydicom.dcmread(path)
        dataset.SOPInstanceUID = dataset.file_meta.MediaStorageSOPInstanceUID = "1.2.3"
        dataset.save_as(path)
    np.testing.assert_array_equal(read_volume(tmp_path).values, values)


@pytest.mark.parametrize(("implicit", "with_meta"), [(True, False), (True, True), (False, False)])
def test_files_without_a_preamble_are_read(write_series, tmp_path, implicit, with_meta):
    """As older scanners and planning systems write them; one that cannot be read is not left out."""
    values = write_series(tmp_path)
    for path in tmp_path.iterdir():
        dataset = pydicom.dcmread(path)
        uid = pydicom.uid.ImplicitVRLittleEndian if implicit else pydicom.uid.ExplicitVRLittleEndian
        dataset.file_meta.TransferSyntaxUID, dataset.preamble = uid, None
        if with_meta:
            pydicom.dcmwrite(path, dataset, implicit_vr=implicit, little_endian=True)
        else:
            del dataset.file_meta
            dataset.save_as(path, implicit_vr=implicit, little_endian=True)
    assert not any(path.read_bytes()[128:132] == b"DICM" for path in tmp_path.iterdir())
    np.testing.assert_array_equal(read_volume(tmp_path).values, values)
    path = min(tmp_path.iterdir())
    path.write_bytes(path.read_bytes()[:200])
    with pytest.raises(InputError, match="damaged or cut off"):
        read_volume(tmp_path)


@pytest.mark.parametrize("kept", [0, 100, 140, 400, -20])
def test_a_slice_that_was_cut_off_is_not_passed_over(write_series, tmp_path, kept):
    """At an end of the series nothing else would tell."""
    write_series(tmp_path)
    last = max(tmp_path.iterdir(), key=lambda path: pydicom.dcmread(path).ImagePositionPatient[2])
    last.write_bytes(last.read_bytes()[:kept])
    last.rename(last.with_suffix(".dcm"))
    (tmp_path / "._hidden.dcm").write_bytes(b"\0\5\x16\7")
    with pytest.raises(InputError, match=r"file \d of 8 .* damaged or cut off"):
        read_volume(tmp_path)


def test_multi_frame_and_single_files_are_refused(write_series, tmp_path):
    write_series(tmp_path / "ct")
    single = next((tmp_path / "ct").iterdir())
    write_series(tmp_path / "many")
    write_series(tmp_path / "short")
    changed(tmp_path / "short", lambda dataset: setattr(dataset, "PixelData", dataset.PixelData[:-20]))

    def framed(dataset) -> None:
        dataset.NumberOfFrames, dataset.PixelData = 3, dataset.PixelData * 3

    changed(tmp_path / "many", framed)
    (tmp_path / "empty").mkdir()
    for path, message in {
        single: "expected a folder of DICOM files, found one of them",
        tmp_path / "many": r"found 3 images in one file \(multi-frame\); convert it to NIfTI",
        tmp_path / "short": "damaged or cut off",
        tmp_path / "empty": "found no image",
        tmp_path / "nowhere.nii": "does not exist",
    }.items():
        with pytest.raises(InputError, match=message):
            read_volume(path)
