"""A surface is corrected by frames of it: to where they show it, not where it is right, and not by other frames."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from scipy import sparse

from oneframe.alignment.reprojection import apply_twist
from oneframe.camera.pinhole import PinholeCamera
from oneframe.case.frame import PosedFrame
from oneframe.colour.lens_shading import LensShading
from oneframe.errors import InputError
from oneframe.images.pixel_values import codes_from_linear
from oneframe.light.lens_light import LensLight, shading, working_distance_mm
from oneframe.projection.overlay_scene import smooth_normals
from oneframe.projection.z_buffer import rasterise_depth
from oneframe.surface_correction.control_points import ControlPoints
from oneframe.surface_correction.correct_surface import AGREES_PX, SurfaceChanged, SurfaceCorrection, correct_surface
from oneframe.surface_correction.deviation_map import NOTHING, UNCONFIRMED, deviation_colours, most_of
from oneframe.surface_correction.displacement_fit import Observed, observed
from oneframe.surface_correction.frame_flow import Flow, Surface, SurfaceFrame, SurfaceView
from oneframe.surface_correction.plane_sweep import is_confirmed
from oneframe.surface_correction.surface_change import changed_since
from oneframe.surface_correction.surface_check import FARTHER, NEARER
from oneframe.transforms import inverse_rigid, rigid, rotation_from_vector, transform_points
from tests.conftest import grid_mesh

CAMERA = PinholeCamera(160, 120, fx=740.0, fy=740.0, cx=79.5, cy=59.5)
LAMP = LensLight((-13.0, 17.0, 0.0), 0.08)
AWAY = rigid(translation=np.array([200.0, 0, 0]))
"""To where nothing is seen."""
TURNS = [(0.0, 0.0)] + [(0.3 * np.cos(at), 0.3 * np.sin(at)) for at in np.linspace(0, 2 * np.pi, 10, endpoint=False)]
POSES = [rigid(rotation_from_vector([np.pi, 0, 0]) @ rotation_from_vector([a, b, 0]), [0, 0, 300.0]) for a, b in TURNS]


def surface():
    x, y = np.meshgrid(np.linspace(-36, 36, 90), np.linspace(-28, 28, 70))
    return grid_mesh(x, y, 3 * np.sin(x / 6) * np.cos(y / 7) + 2 * np.sin((x + y) / 9))


def photographs(mesh):
    """In the light of the lens, with noise."""
    rng = np.random.default_rng(0)
    waves, phases = rng.normal(size=(60, 3)) * 1.1, rng.uniform(0, 2 * np.pi, 60)
    return [photograph(mesh, pose, waves, phases, rng) for pose in POSES]


@pytest.fixture(scope="module")
def true_surface():
    return surface()


@pytest.fixture(scope="module")
def frames(true_surface):
    return photographs(true_surface)


def photograph(mesh, pose, waves, phases, rng):
    raster = rasterise_depth(mesh, CAMERA, pose)
    shown = raster.face >= 0
    rays = CAMERA.rays_cam(CAMERA.pixel_grid()[shown])
    points = transform_points(inverse_rigid(pose), rays / raster.inverse_depth[shown][:, None])
    albedo = 0.3 * np.exp(np.cos(points @ waves.T + phases).sum(axis=1) / 12)
    normals = smooth_normals(mesh, mesh.smooth_normals, raster.face[shown], points)
    linear = albedo * shading(LAMP, points, normals, pose, working_distance_mm(pose, np.zeros(3)))
    image = np.zeros((*CAMERA.shape_hw, 3), np.float32)
    codes = codes_from_linear(np.clip(linear, 0, 1)) + rng.normal(0, 0.008, len(linear))
    image[shown] = np.clip(np.rint(255 * codes), 0, 255)[:, None] / 255
    return PosedFrame(image, np.ones(CAMERA.shape_hw, bool), CAMERA, pose)


def bump(mesh, height_mm):
    x, y, _ = mesh.vertices.T
    return height_mm * np.exp(-((x - 4) ** 2 + (y + 3) ** 2) / (2 * 5.0**2))


def corrected(mesh, frames):
    return correct_surface(mesh, frames, LensShading(LAMP, 0.1))


def height_error(mesh, true_surface):
    """Along z, about as far as along the normals; the columns are those of the grid."""
    moved = mesh.vertices - true_surface.vertices
    return (moved * true_surface.vertex_normals).sum(axis=1)


def test_a_bump_is_taken_away_within_its_stated_error(true_surface, frames):
    faces = true_surface.faces.copy()
    # whichever way they are wound
    faces[::2] = faces[::2, ::-1]
    heights = bump(true_surface, 1.2)
    wrong = replace(true_surface, vertices=true_surface.vertices + heights[:, None] * [0, 0, 1], faces=faces)
    found = corrected(wrong, frames)
    changed = found.confirmed & (heights > 0.4)
    assert changed.sum() > 50
    after = np.abs(height_error(found.mesh, true_surface)[changed])
    assert np.median(after) < 0.15
    assert np.mean(after < 2 * found.std_mm[changed]) > 0.85
    # what moved inwards is farther from the lens
    assert (found.deviation_mm[changed] < 0).mean() > 0.99
    assert "was moved, by -" in found.lines[1]
    np.testing.assert_array_equal(found.mesh.faces, faces)


def test_a_true_surface_stays_and_mirrored_frames_are_left_out(true_surface, frames):
    mirrored = [replace(frame, image=frame.image[:, ::-1].copy()) for frame in frames[1:]]
    found = corrected(true_surface, [*frames, mirrored[0]])
    assert (found.frames, found.left_out) == (10, 1)
    off = np.abs(found.deviation_mm[found.confirmed])
    assert found.confirmed.mean() > 0.2
    assert np.median(off) < 0.06
    assert "next to nothing" in found.lines[1]
    assert np.mean(off < 2 * found.std_mm[found.confirmed]) > 0.95
    with pytest.raises(InputError, match="accepted frames that show"):
        corrected(true_surface, [frames[0], *mirrored])


def test_the_map_has_colours_where_a_deviation_means_something(true_surface):
    off_mm = np.linspace(-1, 1, len(true_surface.vertices))
    confirmed, std_mm = np.arange(len(off_mm)) % 3 > 0, np.full(len(off_mm), 0.05)
    found = SurfaceCorrection(true_surface, off_mm, std_mm, confirmed, 12, 0, 30.0, 0.2, later="so much later")
    colours = deviation_colours(found)
    assert (colours[~confirmed] == UNCONFIRMED).all()
    assert (colours[confirmed & (np.abs(off_mm) <= 0.2)] == NOTHING).all()
    for side, full in ((off_mm, NEARER), (-off_mm, FARTHER)):
        assert np.allclose(colours[confirmed & (side >= most_of(found))], full)
    assert found.lines[-1] == "so much later"


def test_relief_finer_than_what_moves_is_not_confirmed_in_the_mean(true_surface, frames):
    x, y, _ = true_surface.vertices.T
    waves = 1.6 * np.sin(2 * np.pi * x / 6) * np.sin(2 * np.pi * y / 6)
    wrong = replace(true_surface, vertices=true_surface.vertices + waves[:, None] * [0, 0, 1])
    source, *others = [SurfaceFrame(frame) for frame in frames]

    def confirmed(mesh):
        view = SurfaceView(Surface(mesh, None), source, POSES[0])
        sweeps = [(view, list(zip(others, POSES[1:], strict=True)))]
        return is_confirmed(true_surface.vertex_normals, sweeps, AGREES_PX * view.pixel_mm)

    assert confirmed(true_surface).mean() > 0.4
    assert confirmed(wrong)[np.abs(height_error(wrong, true_surface)) > 0.6].mean() < 0.3


@pytest.mark.parametrize(("longer", "rough_mm"), [(0.94, 0.0), (1.06, 0.0), (1.06, 1.2)])
def test_a_wrong_k_is_not_taken_for_a_wrong_surface(true_surface, frames, longer, rough_mm):
    camera = replace(CAMERA, fx=longer * CAMERA.fx, fy=longer * CAMERA.fy)
    x, y, _ = true_surface.vertices.T
    waves = rough_mm * np.sin(x / 1.7) * np.sin(y / 1.9)
    mesh = replace(true_surface, vertices=true_surface.vertices + waves[:, None] * [0, 0, 1])
    with pytest.raises(InputError, match="The case's pose or K is wrong"):
        corrected(mesh, [replace(frame, camera=camera) for frame in frames])


def test_a_surface_that_changes_between_frames_is_noticed(true_surface):
    deeper = replace(true_surface, vertices=true_surface.vertices - bump(true_surface, 2.0)[:, None] * [0, 0, 1])
    before, after = photographs(true_surface), photographs(deeper)
    for since in (5, 7):
        with pytest.raises(SurfaceChanged) as raised:
            corrected(true_surface, [*before[:since], *after[since:]])
        assert raised.value.since == since


def test_places_that_change_count_together_not_scattered(true_surface):
    points = ControlPoints.of(true_surface, np.ones(len(true_surface.vertices), bool), 2.5)
    count, since, many = 12, 7, len(points.places)
    frames = np.stack([np.zeros(count * many, int), np.repeat(np.arange(1, count + 1), many)], axis=1)
    nothing = np.zeros((len(frames), 2))
    known = Observed(frames, nothing, nothing, sparse.vstack([sparse.identity(many, format="csr")] * count), nothing)
    nearest = np.argsort(np.linalg.norm(points.places - points.places[many // 2], axis=1))
    for places, expected in ((nearest[:30], since), (nearest[:: many // 30], None)):
        left_px = np.full((count, many), 0.1)
        left_px[since - 1 :, places] = 1.0
        assert changed_since(points, known, left_px.ravel(), count + 1) == expected


def tissue_moved(frame, seed, amount_px=2.0):
    """The picture bent by a smooth random displacement, another one in each frame."""
    shape, rng = CAMERA.shape_hw, np.random.default_rng(seed)
    bent = [cv2.GaussianBlur(rng.normal(size=shape), (0, 0), 12) for _ in range(2)]
    u, v = (
        axis + amount_px / np.std(bent) * by
        for axis, by in zip(np.moveaxis(CAMERA.pixel_grid(), -1, 0), bent, strict=True)
    )
    return replace(frame, image=cv2.remap(frame.image, u.astype(np.float32), v.astype(np.float32), cv2.INTER_LINEAR))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda frames: [tissue_moved(each, seed) for seed, each in enumerate(frames)], "does tissue move"),
        (
            lambda frames: [
                frames[0],
                *(replace(each, cam_from_model=AWAY @ each.cam_from_model) for each in frames[1:]),
            ],
            "found 0 of 10",
        ),
        (lambda frames: frames[:6], "at least 10 accepted frames"),
        (lambda frames: [frames[0]] * 12, "at least 15°"),
        (lambda frames: [replace(each, image=0 * each.image + 0.4) for each in frames], "texture"),
    ],
)
def test_frames_that_do_not_tell_are_refused(true_surface, frames, change, words):
    with pytest.raises(InputError, match=words):
        corrected(true_surface, change(frames))


def test_too_coarse_a_surface_is_refused(frames):
    x, y = np.meshgrid(np.linspace(-36, 36, 6), np.linspace(-28, 28, 6))
    with pytest.raises(InputError, match="subdivide"):
        corrected(grid_mesh(x, y, 0 * x), frames)


def test_the_linearised_flow_is_that_of_moved_points_and_poses(true_surface, frames):
    points = ControlPoints.of(true_surface, np.ones(len(true_surface.vertices), bool), 4.0)
    rng, pair, pivot = np.random.default_rng(1), (0, 3), np.array([1.0, -2.0, 0.5])
    bare = [SurfaceFrame(frame) for frame in frames[:4]]

    def placed(heights, twists, pixels):
        surface = Surface(points.moved(heights), None)
        poses = [apply_twist(twist, frame.start, pivot) for twist, frame in zip(twists, bare, strict=True)]
        views = [SurfaceView(surface, *each) for each in zip(bare, poses, strict=True)]
        u, v = pixels.T
        at = views[pair[0]].points[v, u]
        return views, CAMERA.project(transform_points(poses[pair[1]], at))

    pixels = np.stack(np.meshgrid(np.arange(35, 125, 5), np.arange(30, 90, 5)), axis=-1).reshape(-1, 2)
    still = np.zeros(len(points.places)), np.zeros((4, 6))
    views, before = placed(*still, pixels)
    known = observed(points, pivot, views, pair, Flow(pixels, before, before, 1.0))
    assert len(known.residuals) == len(pixels)
    heights, twists = rng.normal(0, 0.01, len(points.places)), rng.normal(0, 1, (4, 6)) * ([0.01] * 3 + [1e-4] * 3)
    _, after = placed(heights, twists, pixels)
    told = known.by_height * (known.weights @ heights)[:, None] + known.by_poses @ np.concatenate(twists[list(pair)])
    np.testing.assert_allclose(told, after - before, atol=0.004)
