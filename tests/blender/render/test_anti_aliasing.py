"""Anti-aliased views: close to many samples per pixel, exact where they must be, independent of earlier views."""

import sys

import numpy as np
import pytest
from scipy.ndimage import binary_erosion, gaussian_filter

from oneframe.blender.render.cycles import CyclesScene
from oneframe.blender.render.engines import opened_engine, reference_view_of
from oneframe.blender.render.surface_tree import BlenderRays
from oneframe.camera.pinhole import PinholeCamera
from oneframe.colour.reference_view import ReferenceView, colours_of, unseen_colours_of
from oneframe.colour.shading import ColouredSurface
from oneframe.colour.vertex_colours import NEUTRAL
from oneframe.projection.edge_pixels import edge_pixels
from oneframe.projection.rays import MeshRays
from oneframe.transforms import camera_centre, rigid
from scripts.benchmarks.rendering.converged_view import converged_view

pytestmark = pytest.mark.render

FRAME = PinholeCamera(160, 120, 800.0, 790.0, 75.5, 62.25)
VIEW = FRAME.resized(128, 96)
MODES = ("projective", "texture", "vertex")
FARTHER = rigid(translation=np.array([0.0, 0.0, 150.0]))
FINE = 4


@pytest.fixture
def scene(rng):
    """What the frame shows, at FINE times its resolution: detail of 3 frame pixels and more, as lenses give it."""
    noise = gaussian_filter(rng.normal(size=(FINE * FRAME.height, FINE * FRAME.width, 3)), (FINE, FINE, 0))
    return np.clip(0.5 + 0.15 * noise / noise.std(), 0, 1).astype(np.float32)


@pytest.fixture
def photograph(scene):
    """The scene as a sensor sees it: means over pixels."""
    return scene.reshape(FRAME.height, FINE, FRAME.width, FINE, 3).mean(axis=(1, 3))


@pytest.fixture
def source_from(loaded_case):
    """Makes the source of a mesh, a frame and its pose."""

    def make(mesh, image, cam_from_model, valid=None) -> ReferenceView:
        camera = FRAME.resized(image.shape[1], image.shape[0])
        return reference_view_of(loaded_case(mesh, image, cam_from_model, camera, valid))

    return make


def views_of(source, mode, poses, *, rays=8, camera=VIEW, threads=0, unseen=None):
    (colour,), _ = colours_of(source, mode)
    surface = ColouredSurface(source.mesh, (colour,), unseen, source.pivot_model)
    with opened_engine("cycles", surface, camera, samples=rays, threads=threads) as render:
        return [render(pose) for pose in poses]


def exact_view(source, mode, pose, camera=VIEW):
    (colour,), _ = colours_of(source, mode)
    with CyclesScene(ColouredSurface(source.mesh, (colour,)), camera) as scene:
        return scene.render(pose)


def converged(source, mode, pose, camera=VIEW, *, constant=True):
    (colour,), _ = colours_of(source, mode)
    return converged_view(source.mesh, colour, camera, pose, along=11, constant=constant)


def rms_codes(rgb: np.ndarray, truth: np.ndarray) -> float:
    return float(np.sqrt(np.mean((rgb - truth) ** 2)) * 255)


@pytest.mark.parametrize(("size", "ratio"), [((64, 48), 0.5), ((32, 24), 0.35)])
@pytest.mark.parametrize("shape", ["bumpy_mesh", "stepped_mesh"])
def test_reduced_views_are_near_to_the_means_of_the_scene(
    shape, size, ratio, frontal_pose, oblique_pose, scene, photograph, source_from, request
):
    mesh, camera = request.getfixturevalue(shape), FRAME.resized(*size)
    source = source_from(mesh, photograph, frontal_pose)
    truth = converged(source_from(mesh, scene, frontal_pose), "projective", oblique_pose, camera, constant=False)
    exact = exact_view(source, "projective", oblique_pose, camera)
    (view,) = views_of(source, "projective", [oblique_pose], camera=camera)
    # at the border of the observed region, the finer frame sees a little more
    seen = binary_erosion(exact.observed)
    error, before = (rms_codes(rgb[seen], truth[seen]) for rgb in (view.rgb, exact.rgb))
    assert error < ratio * before
    # what is not colour is that of the pixels' centres
    assert np.array_equal(view.depth_mm, exact.depth_mm)
    assert np.array_equal(view.observed, exact.observed)


@pytest.mark.parametrize("mode", MODES)
def test_near_to_many_samples_at_edges(mode, stepped_mesh, frontal_pose, oblique_pose, photograph, source_from):
    source = source_from(stepped_mesh, photograph, frontal_pose)
    truth, exact = converged(source, mode, oblique_pose), exact_view(source, mode, oblique_pose)
    errors = []
    for rays in (2, 8, 64):
        (view,) = views_of(source, mode, [oblique_pose], rays=rays)
        edges = edge_pixels(view.depth_mm, view.observed, VIEW) & view.mask
        errors.append(rms_codes(view.rgb[edges], truth[edges]))
    assert errors[1] < 0.8 * rms_codes(exact.rgb[edges], truth[edges])
    assert errors[2] < 0.7 * errors[1] < 0.7 * errors[0]


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("shape", ["bumpy_mesh", "stepped_mesh"])
def test_the_source_pose_gives_the_frame_back(mode, shape, frontal_pose, photograph, source_from, request):
    source = source_from(request.getfixturevalue(shape), photograph, frontal_pose)
    exact = exact_view(source, mode, frontal_pose, FRAME)
    (view,) = views_of(source, mode, [frontal_pose], camera=FRAME)
    assert exact.observed.sum() > 10_000
    different = np.abs(view.rgb - exact.rgb).max(axis=2) * 255
    edges = edge_pixels(exact.depth_mm, exact.observed, FRAME)
    assert different[~edges].max() < 0.3
    # vertex colours are no frame: at edges they are means
    assert mode == "vertex" or np.quantile(different[edges], 0.98) < 0.3


def test_stripes_seen_from_farther_away_are_grey(stepped_mesh, frontal_pose, source_from):
    stripes = np.where(np.arange(FRAME.width) % 2 == 0, 0.0, 1.0).astype(np.float32)
    frame = np.broadcast_to(stripes[None, :, None], (*FRAME.shape_hw, 3)).copy()
    source = source_from(stepped_mesh, frame, frontal_pose)
    distance = (frontal_pose @ [*source.pivot_model, 1])[2]
    twice = rigid(translation=np.array([0.0, 0.0, distance])) @ frontal_pose
    (view,) = views_of(source, "projective", [twice], camera=FRAME)
    exact = exact_view(source, "projective", twice, FRAME)
    inside = view.observed & ~edge_pixels(view.depth_mm, view.observed, FRAME)
    assert exact.rgb[inside].std() > 0.2
    # steps of the surface lie at other distances than the pivot
    assert np.abs(view.rgb[inside] - 0.5).mean() < 0.02


@pytest.mark.parametrize("mode", MODES)
def test_nothing_mixes_with_what_the_masks_exclude(stepped_mesh, frontal_pose, oblique_pose, source_from, mode):
    """Of a plain frame, the masks say the colour of every pixel: there is no rim of black or grey."""
    plain = np.full((*FRAME.shape_hw, 3), 0.75, np.float32)
    source = source_from(stepped_mesh, plain, frontal_pose)
    for pose in (oblique_pose, FARTHER @ oblique_pose):
        (view,) = views_of(source, mode, [pose])
        exact = exact_view(source, mode, pose)
        assert np.array_equal(view.mask, exact.mask)
        assert np.array_equal(view.observed, exact.observed)
        assert view.mask.any()
        assert not view.mask.all()
        unseen = view.mask & ~view.observed
        assert unseen.sum() > 100
        assert not view.rgb[~view.mask].any()
        assert np.allclose(view.rgb[unseen], NEUTRAL, atol=1e-5)
        assert np.allclose(view.rgb[view.observed], 0.75, atol=1e-5)


def test_blender_s_rays_are_those_of_embree(stepped_mesh, oblique_pose):
    """Front, back and background; the places in the faces too."""
    for pose in (oblique_pose, oblique_pose @ rigid(np.diag([1.0, -1.0, -1.0]))):
        directions = (VIEW.rays_cam(VIEW.pixel_grid().reshape(-1, 2)) @ pose[:3, :3]).astype(np.float32)
        origins = np.broadcast_to(camera_centre(pose), directions.shape).astype(np.float32)
        found, expected = (rays(stepped_mesh).first_hits(origins, directions) for rays in (BlenderRays, MeshRays))
        same = found.face == expected.face
        # a pixel's centre may lie on an edge to the last bit
        assert np.count_nonzero(~same) <= 5
        hit = same & (found.face >= 0)
        assert hit.any()
        assert np.array_equal(found.front[hit], expected.front[hit])
        np.testing.assert_allclose(found.distance[hit], expected.distance[hit], rtol=1e-5)
        for name in ("second", "third"):
            np.testing.assert_allclose(getattr(found, name)[hit], getattr(expected, name)[hit], atol=1e-2)


def test_views_without_embree(stepped_mesh, frontal_pose, oblique_pose, photograph, source_from, monkeypatch):
    source = source_from(stepped_mesh, photograph, frontal_pose)
    (view,) = views_of(source, "projective", [oblique_pose])
    monkeypatch.setitem(sys.modules, "embreex.mesh_construction", None)
    (other,) = views_of(source, "projective", [oblique_pose])
    assert np.count_nonzero(np.abs(view.rgb - other.rgb).max(axis=2) > 1 / 255) <= 5


def test_colours_that_the_frame_does_not_show_never_bleed_in(bumpy_mesh, frontal_pose, photograph, source_from):
    v, u = np.mgrid[: FRAME.height, : FRAME.width]
    valid = (u - 80) ** 2 + (v - 60) ** 2 < 45**2
    views = []
    for outside in (0.0, 50.0):
        image = np.where(valid[..., None], photograph, np.float32(outside))
        source = source_from(bumpy_mesh, image, frontal_pose, valid)
        views += views_of(source, "projective", [frontal_pose])
    assert views[0].observed.sum() > 1000
    assert np.array_equal(views[0].rgb, views[1].rgb)


@pytest.mark.parametrize("mode", MODES)
def test_a_view_depends_on_its_pose_alone(bumpy_mesh, frontal_pose, oblique_pose, photograph, source_from, mode):
    """Other threads, other views before it, filters for other distances in between."""
    source = source_from(bumpy_mesh, photograph, frontal_pose)
    poses = [frontal_pose, FARTHER @ oblique_pose, oblique_pose, FARTHER @ frontal_pose, frontal_pose]
    views = views_of(source, mode, poses, threads=1)
    again = views_of(source, mode, poses[2:4], threads=2)
    assert np.array_equal(views[0].rgb, views[4].rgb)
    assert np.array_equal(views[2].rgb, again[0].rgb)
    assert np.array_equal(views[3].rgb, again[1].rgb)


@pytest.mark.gl
def test_a_rasteriser_s_samples_do_not_mix_with_the_background(stepped_mesh, frontal_pose, oblique_pose, source_from):
    plain = np.full((*FRAME.shape_hw, 3), 0.75, np.float32)
    source = source_from(stepped_mesh, plain, frontal_pose)
    with opened_engine("eevee", ColouredSurface(source.mesh, source.views), VIEW, samples=8) as render:
        view = render(FARTHER @ oblique_pose)
    assert not view.rgb[~view.mask].any()
    # where the frame saw the surface, some samples may be grey, but none black
    assert view.rgb[view.mask].min() > NEUTRAL - 0.01


@pytest.mark.parametrize("mode", MODES)
def test_filled_views_change_where_the_frame_saw_nothing(stepped_mesh, frontal_pose, oblique_pose, source_from, mode):
    """A dark frame and its fill: there is no grey at any edge, and masks are those of neutral views."""
    dark = np.full((*FRAME.shape_hw, 3), 0.125, np.float32)
    source = source_from(stepped_mesh, dark, frontal_pose)
    (neutral,) = views_of(source, mode, [oblique_pose])
    (filled,) = views_of(source, mode, [oblique_pose], unseen=unseen_colours_of(source, "fill"))
    assert np.array_equal(filled.observed, neutral.observed)
    assert np.array_equal(filled.depth_mm, neutral.depth_mm)
    assert neutral.rgb.max() > 0.49
    assert filled.rgb.max() < 0.125 + 1e-4
