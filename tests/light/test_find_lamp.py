"""The lamp at the lens is found where there is one: from what frames show of points, and from whole frames."""

from dataclasses import replace

import numpy as np
import pytest

from oneframe.camera.pinhole import PinholeCamera
from oneframe.case.frame import PosedFrame
from oneframe.errors import InputError
from oneframe.images.transfer import TRANSFERS
from oneframe.light.find_lamp import find_lamp, lamp_of
from oneframe.light.lens_light import LensLight, shading, working_distance_mm
from oneframe.light.shaded_points import ShadedPoints
from oneframe.projection.z_buffer import rasterise_depth, seen_normals
from oneframe.transforms import inverse_rigid, rigid, rotation_from_vector, transform_points
from tests.codes import codes_from_linear
from tests.conftest import grid_mesh

CAMERA = PinholeCamera(160, 120, fx=600.0, fy=600.0, cx=79.5, cy=59.5)
POSES = tuple(
    rigid(rotation_from_vector(np.array([np.pi, 0, 0])) @ rotation_from_vector(np.array([a, b, roll])), [x, 2.0, z])
    for a, b, roll, x, z in (
        (0, 0, 0, 0, 300.0),
        (0.3, 0.1, 0.2, 3, 310.0),
        (-0.2, 0.3, 0, -3, 290.0),
        (0, -0.3, 0.4, 0, 305.0),
    )
)
LAMP = LensLight((-13.0, 17.0, 0.0), 0.08)


def hills():
    x, y = np.meshgrid(np.linspace(-35, 35, 42), np.linspace(-28, 28, 34))
    return grid_mesh(x, y, 3 * np.sin(x / 6) * np.cos(y / 7) + 2 * np.sin((x + y) / 9))


def albedo_of(points):
    """It varies with the place, by more than the light does."""
    x, y, _ = points.T
    return np.exp(0.5 * np.sin(x / 2) * np.sin(y / 2.5) + 0.4 * np.cos((x - 2 * y) / 11))


def lit_by(light):
    return lambda points, normals, pose: shading(light, points, normals, pose, working_distance_mm(pose, np.zeros(3)))


def wet(points, normals, pose):
    """A lamp whose light is less away from the axis, on a surface that has highlights."""
    points_cam = transform_points(pose, points)
    towards_lamp, towards_lens = (
        each / np.linalg.norm(each, axis=1, keepdims=True) for each in (LAMP.lamp_cam_mm - points_cam, -points_cam)
    )
    half = (towards_lamp + towards_lens) / np.linalg.norm(towards_lamp + towards_lens, axis=1, keepdims=True)
    mirrored = np.maximum(np.einsum("nk,nk->n", half, normals @ pose[:3, :3].T), 0) ** 25
    off_axis = (points_cam[:, :2] ** 2).sum(axis=1) / points_cam[:, 2] ** 2
    return (lit_by(LAMP)(points, normals, pose) + 0.15 * mirrored) * np.exp(-30 * off_axis)


def sun(points, normals, pose):
    """A light of the room: it stands still."""
    return 0.1 + np.maximum(normals @ np.array([0.3, 0.2, 0.933]), 0)


def sightings(mesh, law, gains=(1.0, 1.0, 1.0, 1.0), poses=POSES, albedo=albedo_of):
    points, normals = mesh.vertices, mesh.vertex_normals
    count = len(points)
    shown = [
        np.log(gain * albedo(points) * law(points, normals, pose)) for gain, pose in zip(gains, poses, strict=False)
    ]
    each = len(poses)
    return ShadedPoints(
        point=np.tile(np.arange(count), each), frame=np.repeat(np.arange(each), count),
        points=np.tile(points, (each, 1)), normals=np.tile(normals, (each, 1)),
        log_light=np.concatenate(shown[:each]), poses=tuple(poses),
    )  # fmt: skip


def photograph(mesh, law, pose, transfer="srgb"):
    raster = rasterise_depth(mesh, CAMERA, pose)
    shown = raster.face >= 0
    uv = CAMERA.pixel_grid()[shown]
    points = transform_points(inverse_rigid(pose), CAMERA.rays_cam(uv) / raster.inverse_depth[shown][:, None])
    image = np.zeros((*CAMERA.shape_hw, 3), np.float32)
    linear = (
        0.25 * albedo_of(points) ** 0.3 * law(points, seen_normals(mesh, CAMERA, pose, raster.face[shown], uv), pose)
    )
    image[shown] = np.rint(255 * codes_from_linear(np.clip(linear, 0, 1), TRANSFERS[transfer]))[:, None] / 255
    return PosedFrame(image, np.ones(CAMERA.shape_hw, bool), CAMERA, pose)


def assert_lamp(found, atol):
    assert not found.objection
    np.testing.assert_allclose(found.light.lamp_cam_mm, LAMP.lamp_cam_mm, atol=atol)
    np.testing.assert_allclose(found.light.ambient, LAMP.ambient, atol=atol / 100)


def test_a_known_lamp_is_found_to_rounding_whatever_the_albedo():
    mesh = hills()
    found = lamp_of(sightings(mesh, lit_by(LAMP)), mesh)
    assert_lamp(found, 1e-3)
    assert found.explained > 0.999999


def test_highlights_and_the_lamps_profile_move_it_little():
    mesh = hills()
    assert_lamp(lamp_of(sightings(mesh, wet), mesh), 3.0)


def test_where_no_lamp_shows_vignetting_is_found():
    """Two frames of four are foretold from the others; walls that light one another leave nothing of a lamp."""
    mesh, alone = hills(), LensLight(None, 1.0, vignetting=80.0)
    for count in (2, 4):
        found = lamp_of(sightings(mesh, lit_by(alone), (0.2, 3.0, 1.0, 0.7), POSES[:count]), mesh)
        assert not found.objection
        assert found.light.lamp_cam_mm is None
        assert found.light.vignetting == pytest.approx(80, rel=1e-6)
    both = lamp_of(sightings(mesh, lit_by(replace(LAMP, vignetting=40.0))), mesh)
    assert_lamp(both, 0.1)
    assert both.light.vignetting == pytest.approx(40, rel=0.05)


def test_a_microscope_and_an_endoscope_are_the_same_picture():
    """All lengths a fifteenth: so is the lamp."""
    mesh = hills()
    seen = sightings(mesh, lit_by(LAMP))
    poses = tuple(rigid(pose[:3, :3], pose[:3, 3] / 15) for pose in seen.poses)
    small = lamp_of(replace(seen, points=seen.points / 15, poses=poses), replace(mesh, vertices=mesh.vertices / 15))
    assert not small.objection
    np.testing.assert_allclose(np.multiply(small.light.lamp_cam_mm, 15), LAMP.lamp_cam_mm, atol=0.05)


def test_exposures_cancel_and_the_order_of_frames_means_nothing():
    mesh = hills()
    noise = np.random.default_rng(0).normal(0, 0.02, 4 * len(mesh.vertices))
    one, other = (sightings(mesh, lit_by(LAMP), gains) for gains in ((1, 1, 1, 1), (0.2, 3.0, 1.0, 0.7)))
    founds = [lamp_of(replace(each, log_light=each.log_light + noise), mesh) for each in (one, other)]
    order = np.array([2, 0, 3, 1])
    turned = replace(one, log_light=one.log_light + noise, frame=np.argsort(order)[one.frame])
    founds.append(lamp_of(replace(turned, poses=tuple(POSES[at] for at in order)), mesh))
    for found in founds[1:]:
        np.testing.assert_allclose(found.light.lamp_cam_mm, founds[0].light.lamp_cam_mm, atol=0.02)
        np.testing.assert_allclose(found.explained, founds[0].explained, atol=1e-5)


def test_it_is_as_far_off_as_it_states():
    mesh = hills()
    truth, off = np.array(LAMP.lamp_cam_mm[:2]), []
    for seed in range(6):
        noise = np.random.default_rng(seed).normal(0, 0.05, 4 * len(mesh.vertices))
        clean = sightings(mesh, lit_by(LAMP))
        found = lamp_of(replace(clean, log_light=clean.log_light + noise), mesh)
        off.append((np.array(found.light.lamp_cam_mm[:2]) - truth) / found.deviation_mm[:2])
    # its depth, which is right here, is part of what it states
    assert np.mean(np.abs(off) < 2) >= 0.9


@pytest.mark.parametrize("count", [1, 4])
def test_a_light_that_stands_still_is_refused(count):
    mesh = hills()
    found = find_lamp(mesh, [photograph(mesh, sun, pose) for pose in POSES[:count]])
    assert found.objection.startswith("one frame does not tell" if count == 1 else "no lamp at the lens")
    assert "do not tell" in replace(found, frames=4, strength_deviation=1.0).objection


@pytest.mark.parametrize("transfer", TRANSFERS)
def test_frames_of_a_lamp_show_it(transfer):
    mesh = hills()
    found = find_lamp(mesh, [photograph(mesh, lit_by(LAMP), pose, transfer) for pose in POSES], transfer)
    assert found.light.transfer == transfer
    assert_lamp(found, 1.5)
    # one alone tells it less well, or says so
    alone = find_lamp(mesh, [photograph(mesh, lit_by(LAMP), POSES[0], transfer)], transfer)
    if not alone.objection:
        off = np.abs(np.subtract(alone.light.lamp_cam_mm, LAMP.lamp_cam_mm))[:2]
        assert (off < 3 * np.array(alone.deviation_mm[:2])).all()


def test_all_channels_count_alike():
    """Red light goes from wall to wall, so red alone falls off less than a view that has all three."""
    mesh, powers = hills(), np.array([0.8, 0.9, 1.0])
    frames = [photograph(mesh, lit_by(LAMP), pose) for pose in POSES]
    walls = [replace(each, image=(each.image**powers).astype(np.float32)) for each in frames]
    one, other = (find_lamp(mesh, each) for each in (walls, [replace(w, image=w.image[..., ::-1]) for w in walls]))
    np.testing.assert_allclose(one.light.lamp_cam_mm, other.light.lamp_cam_mm, atol=1e-6)
    assert one.light.ambient == pytest.approx(other.light.ambient, abs=1e-8)


def test_a_saturated_or_dark_frame_says_what_is_missing():
    mesh = hills()
    frame = photograph(mesh, lit_by(LAMP), POSES[0])
    for image in (np.ones_like(frame.image), np.zeros_like(frame.image)):
        with pytest.raises(InputError, match=r"expected at least 200 points .* found 0; .*saturated or dark"):
            find_lamp(mesh, [replace(frame, image=image)])
