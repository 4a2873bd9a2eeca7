"""Photographs of the sample case: exact in geometry, repeatable, well exposed; and the folder that holds them."""

import json
from itertools import pairwise

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from oneframe.blender.sample.photograph import take_photographs
from oneframe.blender.sample.sample_case import check_sample_case, write_sample_case, write_sample_film
from oneframe.camera.pinhole import PinholeCamera
from oneframe.case.case_file import read_case
from oneframe.errors import InputError
from oneframe.images.image_reader import read_image
from oneframe.sample.film import DISTURBED
from oneframe.sample.temporal_bone import MICROSCOPE, SampleSurface, frame_pose, held_out_poses, sample_surface
from oneframe.surface.mesh import TriangleMesh
from oneframe.surface.mesh_reader import read_mesh
from oneframe.transforms import rigid, rotation_angle_deg, rotation_from_vector, transform_points
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


def test_silhouette_agrees_with_projection(tmp_path):
    """A bright convex polygon far from the origin: its photograph covers the pixels that the projection says."""
    centre = np.array([60.0, -150.0, 1040.0])
    corners = centre + np.array([[-9, -7, 0], [10, -6, 1.5], [8, 7, 0], [-6, 9, -1.5]])
    bone = TriangleMesh(corners, np.array([[0, 1, 2], [0, 2, 3]], np.int32))
    tissue = dict.fromkeys(("drilled", "nerve", "air_cell", "mucosa", "canal_skin", "soft_tissue", "pool"), np.zeros(4))
    # front sides (+z) toward the camera
    camera = PinholeCamera(40, 64, 415.0, 330.0, 15.1, 37.4)
    rotation = rotation_from_vector(np.array([-0.2, 0.15, -0.5])) @ np.diag([1.0, -1.0, -1.0])
    pose = rigid(rotation, np.array([-1.0, 1.0, 300.0]) - rotation @ centre)
    image = photograph(SampleSurface(bone, {}, tissue), camera, pose, tmp_path / "photograph.png", samples=16)

    outline = camera.project(transform_points(pose, corners))
    covered = coverage(outline, camera)
    brightness = image.mean(axis=2)
    seen = brightness > (np.median(brightness[covered == 1]) + np.median(brightness[covered == 0])) / 2
    assert 300 < (covered == 1).sum() < 0.8 * covered.size
    # the photograph's pixel filter reaches one pixel beyond the edge
    around = np.lib.stride_tricks.sliding_window_view(np.pad(covered, 1, mode="edge"), (3, 3))
    assert seen[around.min(axis=(2, 3)) == 1].all()
    assert not seen[around.max(axis=(2, 3)) == 0].any()
    # to a fraction of a pixel: of outlines moved by quarters of a pixel, the one that was not moved fits best
    shifts = np.stack(np.meshgrid(*[np.linspace(-0.5, 0.5, 5)] * 2), axis=-1).reshape(-1, 2)
    fits = [np.corrcoef(coverage(outline + shift, camera).ravel(), brightness.ravel())[0, 1] for shift in shifts]
    np.testing.assert_array_equal(shifts[np.argmax(fits)], [0, 0])


def coverage(outline: np.ndarray, camera: PinholeCamera) -> np.ndarray:
    """(H, W) part of each pixel's square within a convex outline (N, 2), from 25 points a pixel."""
    ahead = np.roll(outline, -1, axis=0) - outline
    steps = np.linspace(-0.4, 0.4, 5)
    points = camera.pixel_grid() + np.stack(np.meshgrid(steps, steps), axis=-1).reshape(25, 1, 1, 2)
    away = points[..., None, :] - outline
    sides = ahead[:, 0] * away[..., 1] - ahead[:, 1] * away[..., 0]
    return ((sides > 0).all(axis=-1) | (sides < 0).all(axis=-1)).mean(axis=0)


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
