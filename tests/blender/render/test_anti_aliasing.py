"""Anti-aliased views: close to many samples per pixel, exact where they must be, independent of earlier views."""

import numpy as np
import pytest
from scipy.ndimage import binary_erosion, gaussian_filter

from oneframe.blender.render.cycles import CyclesScene
from oneframe.blender.render.engines import opened_engine, reference_view_of
from oneframe.camera.pinhole import PinholeCamera
from oneframe.colour.reference_view import ReferenceView, colours_of, unseen_colours_of
from oneframe.colour.shading import ColouredSurface
from oneframe.colour.vertex_colours import NEUTRAL
from oneframe.projection.edge_pixels import edge_pixels
from oneframe.transforms import rigid
from scripts.benchmarks.rendering.converged_view import converged_view

pytestmark = pytest.mark.render

FRAME = PinholeCamera(160, 120, 800.0, 790.0, 75.5, 62.25)
VIEW = FRAME.resized(128, 96)
MODES = ("projective", "vertex")
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


def converged(source, pose, camera):
    (colour,), _ = colours_of(source, "projective")
    return converged_view(source.mesh, colour, camera, pose, along=11, constant=False)


def rms_codes(rgb: np.ndarray, truth: np.ndarray) -> float:
    return float(np.sqrt(np.mean((rgb - truth) ** 2)) * 255)


@pytest.mark.parametrize(("shape", "size", "ratio"), [("stepped_mesh", (64, 48), 0.5), ("bumpy_mesh", (32, 24), 0.35)])
def test_reduced_views_are_near_to_the_means_of_the_scene(
    shape, size, ratio, frontal_pose, oblique_pose, scene, photograph, source_from, request
):
    mesh, camera = request.getfixturevalue(shape), FRAME.resized(*size)
    source = source_from(mesh, photograph, frontal_pose)
    truth = converged(source_from(mesh, scene, frontal_pose), oblique_pose, camera)
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
def test_the_source_pose_gives_the_frame_back(mode, stepped_mesh, frontal_pose, photograph, source_from):
    source = source_from(stepped_mesh, photograph, frontal_pose)
    exact = exact_view(source, mode, frontal_pose, FRAME)
    (view,) = views_of(source, mode, [frontal_pose], camera=FRAME)
    assert exact.observed.sum() > 10_000
    different = np.abs(view.rgb - exact.rgb).max(axis=2) * 255
    edges = edge_pixels(exact.depth_mm, exact.observed, FRAME)
    assert different[~edges].max() < 0.3
    # vertex colours are no frame: at edges they are means
    assert mode == "vertex" or np.quantile(different[edges], 0.98) < 0.3


@pytest.mark.parametrize("mode", MODES)
def test_nothing_mixes_with_what_the_masks_exclude(stepped_mesh, frontal_pose, oblique_pose, source_from, mode):
    """Of a plain frame, the masks say the colour of every pixel: no rim of black or grey, and none if it is filled."""
    plain = np.full((*FRAME.shape_hw, 3), 0.125, np.float32)
    source = source_from(stepped_mesh, plain, frontal_pose)
    poses = oblique_pose, FARTHER @ oblique_pose
    views = zip(
        poses,
        views_of(source, mode, poses),
        views_of(source, mode, poses, unseen=unseen_colours_of(source, "fill")),
        strict=True,
    )
    for pose, view, filled in views:
        exact = exact_view(source, mode, pose)
        assert np.array_equal(view.mask, exact.mask)
        assert np.array_equal(view.observed, exact.observed)
        assert view.mask.any()
        assert not view.mask.all()
        unseen = view.mask & ~view.observed
        assert unseen.sum() > 100
        assert not view.rgb[~view.mask].any()
        assert np.allclose(view.rgb[unseen], NEUTRAL, atol=1e-5)
        assert np.allclose(view.rgb[view.observed], 0.125, atol=1e-5)
        assert np.array_equal(filled.observed, view.observed)
        assert np.array_equal(filled.depth_mm, view.depth_mm)
        # within the frame's range, which has no neutral grey
        assert np.allclose(filled.rgb[filled.mask], 0.125, atol=1e-4)


def test_a_view_depends_on_its_pose_alone(bumpy_mesh, frontal_pose, oblique_pose, photograph, source_from):
    """Other threads, other views before it, filters for other distances in between."""
    source = source_from(bumpy_mesh, photograph, frontal_pose)
    poses = [frontal_pose, FARTHER @ oblique_pose, oblique_pose, FARTHER @ frontal_pose, frontal_pose]
    views = views_of(source, "projective", poses, threads=1)
    again = views_of(source, "projective", poses[2:4], threads=2)
    assert np.array_equal(views[0].rgb, views[4].rgb)
    assert np.array_equal(views[2].rgb, again[0].rgb)
    assert np.array_equal(views[3].rgb, again[1].rgb)
