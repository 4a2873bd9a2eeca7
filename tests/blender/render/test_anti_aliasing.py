"""Anti-aliased views: close to many samples per pixel, exact where they must be, independent of earlier views."""

import bpy
import numpy as np
import pytest

from pipeline.blender.colour.reference_view import ReferenceView, colour_of, reference_view_of, unseen_colours_of
from pipeline.blender.render.anti_aliasing import EdgeSampler
from pipeline.blender.render.engines import render_view
from pipeline.blender.render.surface_rays import SurfaceRays
from pipeline.blender.render.surface_scene import SurfaceScene
from pipeline.camera.pinhole import PinholeCamera
from pipeline.colour.vertex_colours import NEUTRAL
from pipeline.projection.edge_pixels import edge_pixels
from pipeline.transforms import camera_centre, rigid

pytestmark = pytest.mark.render

FRAME = PinholeCamera(160, 120, 800.0, 790.0, 75.5, 62.25)
VIEW = FRAME.resized(128, 96)
MODES = ("projective", "texture", "vertex")
FARTHER = rigid(translation=np.array([0.0, 0.0, 150.0]))


@pytest.fixture
def photograph(rng):
    """Detail of 3 px and more, as lenses give it."""
    from scipy.ndimage import gaussian_filter

    noise = gaussian_filter(rng.normal(size=(*FRAME.shape_hw, 3)), (1.2, 1.2, 0))
    return np.clip(0.5 + 0.25 * noise / noise.std(), 0, 1).astype(np.float32)


@pytest.fixture
def source_from(loaded_case):
    """Makes the source of a mesh, a frame and its pose."""

    def make(mesh, image, cam_from_model, valid=None) -> ReferenceView:
        return reference_view_of(loaded_case(mesh, image, cam_from_model, FRAME, valid))

    return make


def views_of(source, mode, poses, *, rays=8, camera=VIEW, threads=0):
    colour, _ = colour_of(source, mode)
    with SurfaceScene(source.mesh, camera, colour, filtered=True, threads=threads) as scene:
        sampler = EdgeSampler(scene, source.view, source.pivot_model, colour, camera, rays)
        return [sampler.render(pose) for pose in poses]


def sampled_by_cycles(source, mode, pose, samples, camera=VIEW):
    colour, _ = colour_of(source, mode)
    with SurfaceScene(source.mesh, camera, colour, samples=samples) as scene:
        return render_view(scene, pose)


def rms_codes(rgb: np.ndarray, truth: np.ndarray) -> float:
    return float(np.sqrt(np.mean((rgb - truth) ** 2)) * 255)


@pytest.mark.parametrize(("mode", "codes", "ratio"), [("projective", 2, 0.3), ("texture", 2, 0.3), ("vertex", 3, 0.4)])
@pytest.mark.parametrize("shape", ["bumpy_mesh", "stepped_mesh"])
def test_near_to_many_samples_in_every_pixel(
    shape, mode, codes, ratio, frontal_pose, oblique_pose, photograph, source_from, request
):
    source = source_from(request.getfixturevalue(shape), photograph, frontal_pose)
    truth = sampled_by_cycles(source, mode, oblique_pose, 128).rgb
    exact = sampled_by_cycles(source, mode, oblique_pose, 1)
    (view,) = views_of(source, mode, [oblique_pose])
    assert rms_codes(view.rgb, truth) < codes
    assert rms_codes(view.rgb, truth) < ratio * rms_codes(exact.rgb, truth)
    # what is not colour is that of the pixels' centres
    assert np.array_equal(view.depth_mm, exact.depth_mm)
    assert np.array_equal(view.observed, exact.observed)


def test_structural_similarity_with_many_samples(bumpy_mesh, frontal_pose, oblique_pose, photograph, source_from):
    from skimage.metrics import structural_similarity

    source = source_from(bumpy_mesh, photograph, frontal_pose)
    truth, exact, (view,) = (
        sampled_by_cycles(source, "projective", oblique_pose, 256),
        sampled_by_cycles(source, "projective", oblique_pose, 1),
        views_of(source, "projective", [oblique_pose]),
    )
    codes = [np.rint(np.clip(each.rgb, 0, 1) * 255).astype(np.uint8) for each in (truth, exact, view)]
    before, after = (structural_similarity(codes[0], each, channel_axis=2, data_range=255) for each in codes[1:])
    assert after > 0.999
    assert 1 - after < 0.1 * (1 - before)


def test_more_rays_come_nearer_at_edges(stepped_mesh, frontal_pose, oblique_pose, photograph, source_from):
    source = source_from(stepped_mesh, photograph, frontal_pose)
    truth = sampled_by_cycles(source, "projective", oblique_pose, 256)
    errors = []
    for rays in (2, 8, 64):
        (view,) = views_of(source, "projective", [oblique_pose], rays=rays)
        edges = edge_pixels(view.depth_mm, view.observed, VIEW)
        assert edges.sum() > 300
        errors.append(rms_codes(view.rgb[edges], truth.rgb[edges]))
    assert errors[1] < 0.5 * errors[0]
    assert errors[2] < 0.4 * errors[1]


@pytest.mark.parametrize("mode", MODES)
def test_a_plain_frame_changes_at_edges_only(stepped_mesh, frontal_pose, oblique_pose, source_from, mode):
    plain = np.full((*FRAME.shape_hw, 3), 0.75, np.float32)
    source = source_from(stepped_mesh, plain, frontal_pose)
    exact = sampled_by_cycles(source, mode, oblique_pose, 1)
    (view,) = views_of(source, mode, [oblique_pose])
    changed = np.abs(view.rgb - exact.rgb).max(axis=2) > 1e-5
    edges = edge_pixels(exact.depth_mm, exact.observed, VIEW)
    assert np.count_nonzero(changed) > 50
    assert not (changed & ~edges & ~view.near_unseen).any()
    # what is mixed there are these three colours
    assert view.rgb.min() >= 0
    assert view.rgb.max() < 0.75 + 1e-5
    inside = exact.mask & ~edges & ~view.near_unseen
    assert np.isin(np.round(view.rgb[inside], 4), [NEUTRAL, 0.75]).all()


@pytest.mark.parametrize("mode", MODES)
def test_rays_see_what_the_renderer_sees(stepped_mesh, frontal_pose, oblique_pose, photograph, source_from, mode):
    """Geometry Nodes and Cycles shade the same points alike, front, back and background."""
    source = source_from(stepped_mesh, photograph, frontal_pose)
    colour, _ = colour_of(source, mode)
    for pose in (oblique_pose, oblique_pose @ rigid(np.diag([1.0, -1.0, -1.0]))):
        with SurfaceScene(source.mesh, VIEW, colour) as scene:
            rendered = render_view(scene, pose).rgb
            directions = VIEW.rays_cam(VIEW.pixel_grid().reshape(-1, 2)) @ pose[:3, :3]
            seen = SurfaceRays(scene, colour).colours(camera_centre(pose), directions).reshape(rendered.shape)
        different = np.abs(seen - rendered).max(axis=2) * 255 > 0.5
        # a pixel's centre may lie on an edge to the last bit
        assert np.count_nonzero(different) <= 5


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


@pytest.mark.parametrize(("scale", "ratio"), [(0.3, 0.3), (2.0, 0.65)])
def test_filter_fits_reduced_and_enlarged_views(
    bumpy_mesh, frontal_pose, oblique_pose, photograph, source_from, scale, ratio
):
    source = source_from(bumpy_mesh, photograph, frontal_pose)
    camera = FRAME.resized(round(FRAME.width * scale), round(FRAME.height * scale))
    truth = sampled_by_cycles(source, "projective", oblique_pose, 64, camera).rgb
    exact = sampled_by_cycles(source, "projective", oblique_pose, 1, camera).rgb
    (view,) = views_of(source, "projective", [oblique_pose], camera=camera)
    inside = ~edge_pixels(view.depth_mm, view.observed, camera)
    assert rms_codes(view.rgb[inside], truth[inside]) < ratio * rms_codes(exact[inside], truth[inside])


def test_nothing_is_left_in_blender(bumpy_mesh, frontal_pose, photograph, source_from):
    kinds = ("scenes", "objects", "meshes", "cameras", "materials", "images", "node_groups")

    def counts() -> list[int]:
        return [len(getattr(bpy.data, kind)) for kind in kinds]

    source = source_from(bumpy_mesh, photograph, frontal_pose)
    views_of(source, "vertex", [frontal_pose])  # Blender keeps an image of its own from the first render on
    before = counts()
    views_of(source, "projective", [frontal_pose, FARTHER @ frontal_pose])
    assert counts() == before


def test_nothing_in_view_is_no_error(bumpy_mesh, frontal_pose, photograph, source_from):
    source = source_from(bumpy_mesh, photograph, frontal_pose)
    aside = rigid(translation=np.array([500.0, 0.0, 0.0])) @ frontal_pose
    (view,) = views_of(source, "projective", [aside])
    assert not view.rgb.any()
    assert not view.mask.any()


@pytest.mark.parametrize("mode", MODES)
def test_filled_views_change_where_the_frame_saw_nothing(stepped_mesh, frontal_pose, oblique_pose, source_from, mode):
    """A dark frame and its fill: there is no grey at any edge, and masks are those of neutral views."""
    dark = np.full((*FRAME.shape_hw, 3), 0.125, np.float32)
    source = source_from(stepped_mesh, dark, frontal_pose)
    (neutral,) = views_of(source, mode, [oblique_pose])
    colour, _ = colour_of(source, mode)
    unseen = unseen_colours_of(source, "fill")
    with SurfaceScene(source.mesh, VIEW, colour, unseen=unseen, filtered=True) as scene:
        filled = EdgeSampler(scene, source.view, source.pivot_model, colour, VIEW, 8).render(oblique_pose)
    assert np.array_equal(filled.observed, neutral.observed)
    assert np.array_equal(filled.depth_mm, neutral.depth_mm)
    assert neutral.rgb.max() > 0.49
    assert filled.rgb.max() < 0.125 + 1e-4
