"""Volumes: the voxel that was written is read at the same place, from every format; and what is refused."""

import itertools
import struct
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from oneframe.errors import InputError
from oneframe.transforms import rigid, rotation_from_vector, transform_points
from oneframe.volume.reading.volume_header import read_header
from oneframe.volume.reading.volume_reader import read_volume
from oneframe.volume.volume import Volume
from tests.volume.solids import check_crop

sitk = pytest.importorskip("SimpleITK")
nib = pytest.importorskip("nibabel")

FORMATS = (".nii", ".nii.gz", ".nrrd")
LPS_FROM_RAS = np.diag([-1.0, -1, 1, 1])


def voxels(shape=(5, 4, 6), seed=0) -> np.ndarray:
    return np.random.default_rng(seed).integers(-1024, 3000, shape).astype(np.int16)


def write(path: Path, values: np.ndarray, axes=None, spacing=(0.5, 0.6, 0.7), origin=(1.0, 2, 3), packed=False):
    image = values if isinstance(values, sitk.Image) else sitk.GetImageFromArray(values)
    image.SetSpacing([float(each) for each in spacing])
    image.SetOrigin([float(each) for each in origin])
    image.SetDirection(np.asarray(np.eye(3) if axes is None else axes, float).ravel())
    sitk.WriteImage(image, str(path), packed)
    return image


def nifti(path: Path, values=None, affine=None) -> Path:
    nib.save(nib.Nifti1Image(voxels().T if values is None else values, np.eye(4) if affine is None else affine), path)
    return path


def patched(path: Path, at: int, kind: str, *values) -> Path:
    data = bytearray(path.read_bytes())
    struct.pack_into("<" + kind, data, at, *values)
    path.write_bytes(data)
    return path


def corners(volume: Volume) -> np.ndarray:
    return np.array(list(itertools.product(*[(0.0, count - 1.0) for count in volume.grid.size])))


@settings(max_examples=10)
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
    np.testing.assert_allclose(read_header(path).grid.mesh_from_index, LPS_FROM_RAS @ affine, rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("unit", [1, 0.001])
def test_nifti_of_nibabel_with_left_and_right_as_it_says_in_mm_and_metres(tmp_path, unit):
    """Index x grows to the right here, so LPS x falls."""
    affine = np.diag([0.5 * unit, 0.5 * unit, 0.8 * unit, 1.0])
    affine[:3, 3] = np.array([-30.0, 10, 5]) * unit
    # a fourth dimension of one, and numbers that slope and intercept turn into HU
    image = nib.Nifti1Image((voxels().T[..., None] + 1024).astype(np.uint16), affine)
    image.header.set_xyzt_units("mm" if unit == 1 else "meter")
    nib.save(image, tmp_path / "ct.nii")
    # nibabel writes what it scales itself
    volume = read_volume(patched(tmp_path / "ct.nii", 112, "2f", 1.0, -1024.0))
    np.testing.assert_array_equal(volume.values, voxels())
    np.testing.assert_allclose(volume.grid.mesh_from_index[:3, 3], [30, -10, 5], atol=1e-5)
    np.testing.assert_allclose(volume.grid.mesh_from_index[:3, :3], np.diag([-0.5, -0.5, 0.8]), atol=1e-6)
    assert not volume.grid.is_left_handed


@pytest.mark.parametrize("zooms", [(1, 1, 1), (0.5, 0.55, 0.6), (0, 0, 0), (-1, 2, np.nan)])
def test_the_sform_alone_says_where_voxels_lie(tmp_path, zooms):
    """ITK takes the spacing of pixdim, which nibabel's set_zooms leaves at odds with it."""
    affine = rigid(rotation_from_vector(np.array([0.3, -0.2, 2.0])), [10, 20, 30]) @ np.diag([0.5, -0.55, 0.6, 1])
    path = patched(patched(nifti(tmp_path / "ct.nii", None, affine), 80, "3f", *zooms), 252, "2h", 0, 2)
    grid = read_volume(path).grid
    np.testing.assert_allclose(grid.mesh_from_index, LPS_FROM_RAS @ affine, atol=1e-5)


@pytest.mark.parametrize(("slope", "intercept"), [(0, -1024), (np.nan, 5), (np.inf, 1), (1, np.nan)])
def test_a_scale_that_programs_read_in_different_ways_is_refused(tmp_path, slope, intercept):
    path = patched(nifti(tmp_path / "ct.nii"), 112, "2f", slope, intercept)
    with pytest.raises(InputError, match="expected a scale of the voxels, found scl_slope"):
        read_volume(path)


@pytest.mark.parametrize("suffix", [".nii.gz", ".nrrd"])
def test_a_crop_keeps_every_voxel_in_its_place(tmp_path, suffix):
    values = voxels((12, 11, 10))
    write(tmp_path / f"ct{suffix}", values, rotation_from_vector(np.array([0.3, -0.2, 0.5])), packed=True)
    whole = read_volume(tmp_path / f"ct{suffix}")
    middle = whole.grid.bounds_mm.mean(axis=0)
    part = read_volume(tmp_path / f"ct{suffix}", crop_mm=np.stack([middle - 0.8, middle + 0.6]))
    check_crop(whole, part)
    assert 0 < part.values.size < values.size
    with pytest.raises(InputError, match="expected a box in the volume"):
        read_volume(tmp_path / f"ct{suffix}", crop_mm=np.array([[900.0] * 3, [910.0] * 3]))


def cut(path: Path) -> Path:
    path.write_bytes(path.read_bytes()[: path.stat().st_size * 7 // 10])
    return path


def text(path: Path, old: bytes, new: bytes) -> Path:
    data = written(path).read_bytes()
    assert old in data
    path.write_bytes(data.replace(old, new, 1))
    return path


def written(path: Path, values=None, packed: bool = False) -> Path:
    write(path, voxels() if values is None else values, packed=packed)
    return path


def damaged(path: Path) -> Path:
    """Bytes inside the compressed stream changed: ITK reads other voxels without a word."""
    data = bytearray(written(path, voxels((20, 30, 40)), packed=True).read_bytes())
    for at in range(len(data) // 2, len(data) // 2 + 40):
        data[at] ^= 0x55
    path.write_bytes(data)
    return path


def two_orientations(path: Path, sform_from_qform: np.ndarray, code: int) -> Path:
    """Of different codes, ITK takes the one and nibabel the other; of equal ones, both take sform."""
    image = nib.Nifti1Image(voxels().T, None)
    image.set_qform(np.diag([0.5, 0.5, 0.5, 1]), 1)
    image.set_sform(sform_from_qform @ np.diag([0.5, 0.5, 0.5, 1]), code)
    nib.save(image, path)
    return path


def empty(path: Path) -> Path:
    path.touch()
    return path


BAD = {
    "a label map": (
        "a.nrrd",
        lambda p: written(p, np.eye(9, dtype=np.uint8)[None].repeat(3, 0)),
        "found values from 0 to 1: labels",
    ),
    "raw numbers": ("a.nrrd", lambda p: written(p, (voxels() + 1024).astype(np.uint16)), "subtract"),
    "beyond 16 bits": ("a.nrrd", lambda p: written(p, voxels().astype(np.int32) * 99), "beyond 16 bits"),
    "NaN": ("a.nrrd", lambda p: written(p, np.where(voxels() > 0, np.nan, voxels())), "NaN or infinity"),
    "infinity in NIfTI": ("a.nii", lambda p: nifti(p, np.where(voxels().T > 0, np.inf, voxels().T)), "NaN or infinity"),
    "two dimensions": ("a.nii", lambda p: written(p, voxels((1, 8, 8))), "at least 2 voxels"),
    "four dimensions": ("a.nii", lambda p: nifti(p, np.zeros((4, 5, 6, 3), np.int16)), "of 3 dimensions, found 4"),
    "colour": ("a.nrrd", lambda p: written(p, sitk.GetImageFromArray(np.zeros((3, 4, 5, 3)), True)), "found several"),
    "no orientation": ("a.nii", lambda p: patched(nifti(p), 252, "2h", 0, 0), "left and right are unknown"),
    "no orientation in NRRD": (
        *("a.nrrd", lambda p: text(p, b"space: left-posterior-superior\n", b"space dimension: 3\n")),
        "left and right are unknown",
    ),
    "other units": ("a.nrrd", lambda p: text(p, b"kinds:", b'space units: "um" "um" "um"\nkinds:'), "lengths in mm"),
    "metres that are not stated": ("a.nii", lambda p: nifti(p, None, np.diag([4e-4, 4e-4, 4e-4, 1])), "another unit"),
    "sheared": ("a.nrrd", lambda p: text(p, b"(0,0.5", b"(0.1,0.5"), "found them sheared"),
    "two orientations": (
        *("a.nii", lambda p: two_orientations(p, np.eye(4) + np.outer([20, 0, 0, 0], [0, 0, 0, 1]), 2)),
        "qform and sform place voxels up to 20.0 mm apart",
    ),
    "left and right exchanged in one of two": (
        *("a.nii.gz", lambda p: two_orientations(p, np.diag([-1, 1, 1, 1]), 1)),
        "one mirrors the other",
    ),
    "cut off": ("a.nii", lambda p: cut(nifti(p)), "cut off"),
    "cut off and compressed": ("a.nii.gz", lambda p: cut(written(p, packed=True)), "cut off"),
    "cut off NRRD": ("a.nrrd", lambda p: cut(written(p, voxels((9, 30, 30)), packed=True)), "cut off"),
    "damaged": ("a.nii.gz", damaged, "damaged"),
    "damaged NRRD": ("a.nrrd", damaged, "damaged"),
    "larger than memory": ("a.nii", lambda p: patched(nifti(p), 40, "4h", 3, 32000, 32000, 32000), "fits into memory"),
    "voxels elsewhere": ("a.nrrd", lambda p: text(p, b"kinds:", b"data file: a.raw\nkinds:"), "behind the header"),
    "MetaImage": ("a.mha", written, "convert it to NIfTI or NRRD"),
    "empty": ("a.nrrd", empty, "empty file"),
    "missing": ("a.nrrd", lambda p: p, "does not exist"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_files_are_refused_in_a_sentence(tmp_path, name):
    file, make, expected = BAD[name]
    path = make(tmp_path / file)
    with pytest.raises(InputError, match=expected):
        read_volume(path)
