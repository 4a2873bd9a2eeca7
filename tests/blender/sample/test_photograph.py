"""Photographs of the sample case: exact in geometry, repeatable, well exposed; and the folder that holds them."""

import json
from itertools import pairwise

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from oneframe.blender.sample.photograph import take_photographs
from oneframe.blender.sample.sample_case import check_sample_case, write_sample_case, write_sample_film
from oneframe.case.case_file import read_case
from oneframe.errors import InputError
from oneframe.images.image_reader import read_image
from oneframe.sample.film import DISTURBED
from oneframe.sample.temporal_bone import MICROSCOPE, SampleSurface, frame_pose, held_out_poses, sample_surface
from oneframe.surface.mesh_reader import read_mesh
from oneframe.transforms import rotation_angle_deg
from oneframe.video.film_reader import Film

pytestmark = pytest.mark.render

SMALL = MICROSCOPE.resized(64, 48)


@pytest.fixture(scope="module")
def coarse() -> SampleSurface:
    return sample_surface(spacing_mm=0.8)


def photograph(surface, camera, pose, path, samples=3) -> np.ndarray:
    """(H, W, 3) code values 0..1."""
    assert list(take_photographs(surface, camera, [(pose, path)], samples=samples)) == [path]
    return read_image(path)[0]


def test_photographs_are_repeatable_and_leave_the_blender_file_as_it_was(tmp_path, coarse):
    kinds = ("scenes", "worlds", "objects", "cameras", "lights", "meshes", "materials")
    before = {kind: set(getattr(bpy.data, kind)) for kind in kinds}
    shots = [(frame_pose(), tmp_path / f"{name}.png") for name in ("once", "again {x} ##")]
    for shot in shots:
        list(take_photographs(coarse, SMALL, [shot]))
    (_, once), (_, again) = shots
    assert once.read_bytes() == again.read_bytes()
    assert {kind: set(getattr(bpy.data, kind)) for kind in kinds} == before
    assert {path.name for path in tmp_path.iterdir()} == {"once.png", "again {x} ##.png"}


def test_sample_case_is_read_back_as_written(tmp_path, coarse):
    paths = list(write_sample_case(tmp_path / "case", coarse, camera=SMALL))
    assert paths[-1].name == "case.toml"
    assert {path for path in (tmp_path / "case").rglob("*") if path.is_file()} == set(paths)
    case = read_case(paths[-1])
    assert case.camera == SMALL
    assert case.messages == ()
    np.testing.assert_allclose(case.cam_from_mesh, frame_pose(), atol=1e-9)
    mesh, _ = read_mesh(case.mesh)
    np.testing.assert_allclose(mesh.vertices, coarse.bone.vertices, atol=1e-4)
    np.testing.assert_array_equal(mesh.faces, coarse.bone.faces)
    assert {structure.name for structure in case.structures} == set(coarse.structures)
    listed = json.loads((tmp_path / "case" / "held_out.json").read_text())
    for entry, pose in zip(listed, held_out_poses(), strict=True):
        np.testing.assert_array_equal(entry["cam_from_mesh"], pose)
        assert read_image(tmp_path / "case" / entry["image"])[0].shape == (48, 64, 3)
    # made again, unless it has become another case
    check_sample_case(tmp_path / "case", camera=SMALL)
    paths[-1].write_text(paths[-1].read_text() + "# aligned\n")
    with pytest.raises(InputError, match="found another case"):
        check_sample_case(tmp_path / "case", camera=SMALL)


def test_the_film_shows_its_poses_and_its_faults(tmp_path, coarse):
    camera = MICROSCOPE.resized(64, 48)
    film, listed = write_sample_film(tmp_path, coarse, camera=camera)
    entries, small = json.loads(listed.read_text()), camera.resized(32, 24)
    poses = [np.array(entry["cam_from_mesh"]) for entry in entries]
    steps = [rotation_angle_deg(b[:3, :3] @ a[:3, :3].T) for a, b in pairwise([*poses, poses[0]])]
    # no leap, also not from the last frame to the first
    assert 0 < max(steps) < 8
    with Film(film) as frames:
        shown = [frame.image.astype(float) for frame in frames]
    assert len(shown) == len(entries)
    clear = [number for number, entry in enumerate(entries) if not entry["disturbance"]]
    for number in clear[::20]:
        (path,) = take_photographs(coarse, small, [(poses[number], tmp_path / "again.png")])
        again = 255 * read_image(path)[0]
        assert np.abs(shown[number] - again).mean() < 6
        # the frames beside it show something else
        assert np.abs(shown[number] - again).mean() < np.abs(shown[number - 4] - again).mean()
    assert {entry["disturbance"] for entry in entries} == {"", *DISTURBED}
