"""Volumes: the voxel that was written is read at the same place, from every format; and what is refused."""

import itertools
import struct
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from oneframe.errors import InputError
from oneframe.transforms import rotation_from_vector, transform_points
from oneframe.volume.reading import header_checks
from oneframe.volume.reading.volume_header import read_header
from oneframe.volume.reading.volume_reader import read_volume
from oneframe.volume.volume import Volume

sitk = pytest.importorskip("SimpleITK")
nib = pytest.importorskip("nibabel")

DATA = Path(__file__).resolve().parents[4] / "shared" / "data"
FORMATS = (".nii", ".nii.gz", ".nrrd", ".nhdr", ".mha", ".mhd")
LPS_FROM_RAS = np.diag([-1.0, -1, 1, 1])


def voxels(shape=(5, 4, 6), seed=0) -> np.ndarray:
    return np.random.default_rng(seed).integers(-1024, 3000, shape).astype(np.int16)


def write(path: Path, values: np.ndarray, axes=None, spacing=(0.5, 0.6, 0.7), origin=(1.0, 2, 3), packed=False):
    image = sitk.GetImageFromArray(values)
    image.SetSpacing([float(each) for each in spacing])
    image.SetOrigin([float(each) for each in origin])
    image.SetDirection(np.asarray(np.eye(3) if axes is None else axes, float).ravel())
    sitk.WriteImage(image, str(path), packed)
    return image


def corners(volume: Volume) -> np.ndarray:
    return np.array(list(itertools.product(*[(0.0, count - 1.0) for count in volume.grid.size])))


@settings(max_examples=30)
@given(
    suffix=st.sampled_from(FORMATS),
    packed=st.booleans(),
    vector=st.tuples(*[st.floats(-3, 3)] * 3),
    signs=st.tuples(*[st.sampled_from([-1, 1])] * 3),
    order=st.permutations(range(3)),
    spacing=st.tuples(*[st.floats(0.1, 3)] * 3),
    origin=st.tuples(*[st.floats(-500, 500)] * 3),
    seed=st.integers(0, 9),
)
def test_a_voxel_is_read_where_it_was_written(
    tmp_path_factory, suffix, packed, vector, signs, order, spacing, origin, seed
):
    path = tmp_path_factory.mktemp("volume") / f"ct{suffix}"
    axes = rotation_from_vector(np.array(vector)) @ np.diag(signs)[:, list(order)]
    values = voxels(seed=seed)
    image = write(path, values, axes, spacing, origin, packed and suffix != ".nii")
    volume = read_volume(path)
    np.testing.assert_array_equal(volume.values, values)
    assert volume.values.dtype == np.int16
    wanted = [image.TransformContinuousIndexToPhysicalPoint(index) for index in corners(volume).tolist()]
    # the header of NIfTI is in single precision
    atol = 2e-4 if suffix.startswith(".nii") else 1e-9
    np.testing.assert_allclose(transform_points(volume.grid.mesh_from_index, corners(volume)), wanted, atol=atol)
    if suffix.startswith(".nii"):
        np.testing.assert_allclose(volume.grid.mesh_from_index, LPS_FROM_RAS @ nib.load(path).affine, atol=2e-4)


@settings(max_examples=60, deadline=None)
@given(
    axis=st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda axis: np.linalg.norm(axis) > 0.1),
    half_turn_but=st.one_of(st.floats(0, np.pi), st.floats(1e-5, 2e-3)),
    mirror=st.sampled_from([-1, 1]),
    spacing=st.tuples(*[st.floats(0.1, 3)] * 3),
    origin=st.tuples(*[st.floats(-500, 500)] * 3),
)
def test_qform_and_sform_of_one_affine_agree(tmp_path_factory, axis, half_turn_but, mirror, spacing, origin):
    """The quaternion of half a turn is ill-conditioned in single precision; few voxels, as large as a head."""
    turn = rotation_from_vector((np.pi - half_turn_but) * np.array(axis) / np.linalg.norm(axis))
    affine = np.eye(4)
    affine[:3, :3], affine[:3, 3] = turn * spacing * [1, 1, mirror], origin
    image = nib.Nifti1Image(voxels().T, None)
    image.set_qform(affine, 1)
    image.set_sform(affine, 1)
    path = tmp_path_factory.mktemp("volume") / "ct.nii"
    nib.save(image, path)
    patched(path, 40, "4h", 3, 512, 512, 400)
    np.testing.assert_allclose(read_header(path).mesh_from_index, LPS_FROM_RAS @ affine, rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("metres", [False, True])
def test_nifti_of_nibabel_with_left_and_right_as_it_says(tmp_path, metres):
    """Index x grows to the right here, so LPS x falls."""
    unit = 0.001 if metres else 1
    affine = np.diag([0.5, 0.5, 0.8, 1.0]) @ np.diag([unit, unit, unit, 1])
    affine[:3, 3] = np.array([-30.0, 10, 5]) * unit
    image = nib.Nifti1Image(voxels().T, affine)
    image.header.set_xyzt_units("meter" if metres else "mm")
    nib.save(image, tmp_path / "ct.nii.gz")
    volume = read_volume(tmp_path / "ct.nii.gz")
    np.testing.assert_array_equal(volume.values, voxels())
    np.testing.assert_allclose(volume.grid.mesh_from_index[:3, 3], [30, -10, 5], atol=1e-5)
    np.testing.assert_allclose(volume.grid.mesh_from_index[:3, :3], np.diag([-0.5, -0.5, 0.8]), atol=1e-6)
    assert not volume.grid.is_left_handed


@pytest.mark.parametrize("suffix", [".nii.gz", ".mha"])
def test_a_crop_keeps_every_voxel_in_its_place(tmp_path, suffix):
    values = voxels((12, 11, 10))
    write(tmp_path / f"ct{suffix}", values, rotation_from_vector(np.array([0.3, -0.2, 0.5])), packed=True)
    whole = read_volume(tmp_path / f"ct{suffix}")
    middle = whole.grid.bounds_mm.mean(axis=0)
    part = read_volume(tmp_path / f"ct{suffix}", crop_mm=np.stack([middle - 0.8, middle + 0.6]))
    expected = whole.cropped(middle - 0.8, middle + 0.6)
    assert 0 < part.values.size < values.size
    np.testing.assert_array_equal(part.values, expected.values)
    np.testing.assert_allclose(part.grid.mesh_from_index, expected.grid.mesh_from_index, atol=1e-9)
    with pytest.raises(InputError, match="expected a box in the volume"):
        read_volume(tmp_path / f"ct{suffix}", crop_mm=np.array([[900.0] * 3, [910.0] * 3]))


@pytest.mark.parametrize("dtype", [np.int32, np.float32, np.float64])
def test_other_types_are_rounded_to_whole_hu(tmp_path, dtype):
    write(tmp_path / "ct.nrrd", (voxels() + (0.4 if dtype != np.int32 else 0)).astype(dtype))
    np.testing.assert_array_equal(read_volume(tmp_path / "ct.nrrd").values, voxels())


def test_slope_and_intercept_of_nifti_count(tmp_path):
    image = nib.Nifti1Image((voxels().T + 1024).astype(np.uint16), np.eye(4))
    image.header.set_slope_inter(1, -1024)
    # nibabel writes what it scales itself
    nib.save(image, tmp_path / "ct.nii")
    data = bytearray((tmp_path / "ct.nii").read_bytes())
    struct.pack_into("<2f", data, 112, 1.0, -1024.0)
    (tmp_path / "ct.nii").write_bytes(data)
    np.testing.assert_array_equal(read_volume(tmp_path / "ct.nii").values, voxels())


def test_a_fourth_dimension_of_one_is_no_obstacle(tmp_path):
    nifti(tmp_path / "ct.nii.gz", voxels().T[..., None])
    np.testing.assert_array_equal(read_volume(tmp_path / "ct.nii.gz").values, voxels())


def test_a_volume_larger_than_what_is_free_is_refused(tmp_path, monkeypatch):
    write(tmp_path / "ct.nrrd", voxels())
    monkeypatch.setattr(header_checks, "available_bytes", lambda: 700)
    with pytest.raises(InputError, match="a volume that fits into memory, found one of 6 x 4 x 5 voxels"):
        read_volume(tmp_path / "ct.nrrd")


def nifti(path: Path, values=None, affine=None, **header) -> Path:
    image = nib.Nifti1Image(voxels().T if values is None else values, np.eye(4) if affine is None else affine)
    for key, value in header.items():
        image.header[key] = value
    nib.save(image, path)
    return path


def patched(path: Path, at: int, kind: str, *values) -> Path:
    data = bytearray(path.read_bytes())
    struct.pack_into("<" + kind, data, at, *values)
    path.write_bytes(data)
    return path


def cut(path: Path, share: float) -> Path:
    data = path.read_bytes()
    path.write_bytes(data[: int(len(data) * share)])
    return path


def text(path: Path, old: bytes, new: bytes) -> Path:
    data = path.read_bytes()
    assert old in data
    path.write_bytes(data.replace(old, new, 1))
    return path


def written(path: Path, values: np.ndarray, packed: bool = False, **place) -> Path:
    write(path, values, packed=packed, **place)
    return path


def damaged(path: Path) -> Path:
    """Bytes inside the compressed stream changed: ITK reads other voxels without a word."""
    data = bytearray(written(path, voxels((20, 30, 40)), packed=True).read_bytes())
    for at in range(len(data) // 2, len(data) // 2 + 40):
        data[at] ^= 0x55
    path.write_bytes(data)
    return path


SHEARED = np.diag([0.5, 0.5, 0.5, 1.0]) + np.outer([0.03, 0, 0, 0], [0, 1, 0, 0])
BAD = {
    "a label map": (
        lambda p: written(p / "a.nrrd", np.eye(9, dtype=np.uint8)[None].repeat(3, 0)),
        "looks like a label",
    ),
    "raw numbers": (lambda p: written(p / "a.mha", (voxels() + 1024).astype(np.uint16)), r"no negative.*subtract"),
    "beyond 16 bits": (lambda p: written(p / "a.mha", voxels().astype(np.int32) * 99), "beyond 16 bits"),
    "NaN": (
        lambda p: written(p / "a.mha", np.where(voxels() > 0, np.nan, voxels())),
        "NaN or infinity in [0-9,]+ voxels",
    ),
    "NaN in NIfTI": (
        lambda p: nifti(p / "a.nii", np.where(voxels().T > 0, np.nan, voxels().T).astype(np.float32)),
        "NaN or infinity in [0-9]+ voxels",
    ),
    "infinity in NIfTI, big-endian": (
        lambda p: big_endian(p / "a.nii.gz", np.where(voxels().T > 2900, np.inf, voxels().T)),
        "NaN or infinity in [0-9]+ voxels",
    ),
    "two dimensions": (lambda p: written(p / "a.nii", voxels((1, 8, 8))), "at least 2 voxels along each of 3 axes"),
    "four dimensions": (lambda p: nifti(p / "a.nii", np.zeros((4, 5, 6, 3), np.int16)), "of 3 dimensions, found 4"),
    "colour": (lambda p: vector(p / "a.nrrd"), "one number per voxel, found several"),
    "no orientation": (
        lambda p: patched(nifti(p / "a.nii"), 252, "2h", 0, 0),
        "expected an orientation .*left and right are unknown",
    ),
    "no orientation in NRRD": (
        lambda p: text(written(p / "a.nrrd", voxels()), b"space: left-posterior-superior\n", b"space dimension: 3\n"),
        "expected an orientation .*left and right are unknown",
    ),
    "no orientation in MHD": (
        lambda p: text(written(p / "a.mhd", voxels()), b"TransformMatrix", b"Something"),
        "expected an orientation .*right are unknown",
    ),
    "other units": (
        lambda p: text(written(p / "a.nrrd", voxels()), b"kinds:", b'space units: "um" "um" "um"\nkinds:'),
        "lengths in mm",
    ),
    "metres that are not stated": (lambda p: nifti(p / "a.nii", None, np.diag([4e-4, 4e-4, 4e-4, 1])), "another unit"),
    "sheared": (lambda p: nifti(p / "a.nii", None, SHEARED), "sheared by 3.43"),
    "sheared NRRD": (
        lambda p: text(written(p / "a.nrrd", voxels()), b"(0,0.5", b"(0.1,0.5"),
        "at right angles, found them sheared",
    ),
    "two orientations": (
        lambda p: two_orientations(p / "a.nii", np.eye(4) + np.outer([20, 0, 0, 0], [0, 0, 0, 1]), 2),
        "found two: qform and sform place voxels up to 20.0 mm apart; keep .*set_sform",
    ),
    "left and right exchanged in one of two": (
        lambda p: two_orientations(p / "a.nii.gz", np.diag([-1, 1, 1, 1]), 1),
        "qform and sform place voxels up to 5.0 mm apart, and one mirrors the other",
    ),
    "cut off": (lambda p: cut(nifti(p / "a.nii"), 0.7), r"expected 240 bytes .* found .*cut off"),
    "cut off and compressed": (lambda p: cut(written(p / "a.nii.gz", voxels(), True), 0.7), "was cut off"),
    "cut off NRRD": (lambda p: cut(written(p / "a.nrrd", voxels((9, 30, 30)), True), 0.7), "was cut off"),
    "damaged": (lambda p: damaged(p / "a.nii.gz"), "damaged"),
    "damaged NRRD": (lambda p: damaged(p / "a.nrrd"), "damaged"),
    "larger than memory": (
        lambda p: patched(nifti(p / "a.nii"), 40, "4h", 3, 32000, 32000, 32000),
        r"fits into memory, found one of 32000 x 32000 x 32000 voxels, which takes [0-9.]+ GB",
    ),
    "a size that lies": (lambda p: patched(nifti(p / "a.nii"), 40, "4h", 3, 900, 900, 90), "was cut off"),
    "no voxels beside the header": (
        lambda p: without(written(p / "a.mhd", voxels()), "a.raw"),
        "it is missing: copy it",
    ),
    "another folder's voxels": (
        lambda p: text(written(p / "a.mhd", voxels()), b"a.raw", b"/etc/passwd"),
        "one file in the same folder",
    ),
    "empty": (lambda p: (p / "a.nrrd", (p / "a.nrrd").write_bytes(b""))[0], "found an empty file"),
    "missing": (lambda p: p / "a.nrrd", "does not exist"),
}


def vector(path: Path) -> Path:
    sitk.WriteImage(sitk.GetImageFromArray(np.zeros((3, 4, 5, 3), np.uint8), isVector=True), str(path))
    return path


def two_orientations(path: Path, sform_from_qform: np.ndarray, code: int) -> Path:
    """Of different codes, ITK takes the one and nibabel the other; of equal ones, both take sform."""
    image = nib.Nifti1Image(voxels().T, None)
    image.set_qform(np.diag([0.5, 0.5, 0.5, 1]), 1)
    image.set_sform(sform_from_qform @ np.diag([0.5, 0.5, 0.5, 1]), code)
    nib.save(image, path)
    return path


def big_endian(path: Path, values: np.ndarray) -> Path:
    nib.save(nib.Nifti1Image(values, np.eye(4), nib.Nifti1Header(endianness=">")), path)
    return path


def without(path: Path, name: str) -> Path:
    path.with_name(name).unlink()
    return path


@pytest.mark.parametrize("name", BAD)
def test_bad_files_are_refused_in_a_sentence(tmp_path, name):
    make, expected = BAD[name]
    path = make(tmp_path)
    with pytest.raises(InputError, match=expected):
        read_volume(path)


@pytest.mark.skipif(not (DATA / "head_ct").is_dir(), reason="needs the test data beside the project")
def test_the_head_and_the_temporal_bone_are_read_with_left_on_the_left():
    head = read_volume(DATA / "head_ct/head_crop_int16.nii.gz")
    assert head.grid.size == (280, 300, 121)
    np.testing.assert_allclose(head.grid.spacing_mm, [0.9765625, 0.9765625, 2])
    assert (head.values.min(), head.values.max()) == (-1024, 2970)
    bone = read_volume(DATA / "temporal_bones/LT143_pseudoct_semisynthetic.nii.gz")
    np.testing.assert_allclose(bone.grid.mesh_from_index[:3, 3], 0.0961, atol=1e-3)
    assert not bone.grid.is_left_handed
