"""What surrounds the surface is what the frame shows there; the shadow of instruments is where rays say."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from oneframe.camera.pinhole import PinholeCamera
from oneframe.colour.lens_shading import LensShading, shifted_codes, shown_codes
from oneframe.colour.seen_frame import SeenFrame
from oneframe.light.lens_light import LensLight
from oneframe.occlusion.compositing import LitSurface
from oneframe.occlusion.instruments import hook
from oneframe.occlusion.shadow import Shadow
from oneframe.occlusion.surroundings import MARGIN_PX, Surroundings
from oneframe.projection.rendered_view import RenderedView
from oneframe.projection.visible_surface import pixel_points
from oneframe.projection.z_buffer import rasterise_depth, seen_normals
from oneframe.surface.mesh import TriangleMesh
from oneframe.transforms import camera_centre, rigid, rotation_from_vector, transform_points
from tests.conftest import grid_mesh

CAMERA = PinholeCamera(161, 121, fx=460.0, fy=440.0, cx=81.3, cy=58.8)
LIGHT = LensShading(LensLight((-13.0, 16.0, 2.0), 0.1), 0.1)


def white(mesh: TriangleMesh, pose: np.ndarray, light: LensShading | None = None, grey: float = 0.8) -> RenderedView:
    """A view of a surface of one colour."""
    raster = rasterise_depth(mesh, CAMERA, pose)
    depth_mm, shown = raster.depth_mm.astype(np.float32), raster.face >= 0
    rgb = np.zeros((*shown.shape, 3), np.float32)
    rgb[shown] = grey
    if light is not None:
        rgb[shown] = shown_codes(shifted_codes(rgb[shown]), factors(mesh, raster.face, depth_mm, shown, pose))
    return RenderedView(rgb, depth_mm, shown.astype(np.uint8), np.zeros_like(shown))


def factors(mesh, face, depth_mm, pixels, pose, lit=None) -> np.ndarray:
    points = pixel_points(depth_mm, np.nonzero(pixels), CAMERA, pose)
    normals = seen_normals(mesh, CAMERA, pose, face[pixels], CAMERA.pixel_grid()[pixels])
    return LIGHT.factors(points, normals, pose, lit)


def frame(image: np.ndarray, seen: RenderedView, pose: np.ndarray) -> SeenFrame:
    inverse = np.divide(1, seen.depth_mm, out=np.zeros_like(seen.depth_mm), where=seen.mask)
    return SeenFrame(image, np.ones(CAMERA.shape_hw, bool), CAMERA, pose, inverse_depth=inverse)


@pytest.mark.parametrize("light", [None, LIGHT], ids=["as it is", "lens"])
def test_at_its_own_pose_the_frame_is_whole_again(bumpy_mesh, oblique_pose, sharp_image, light):
    """Beside the surface, and the surface is as it was."""
    seen, image = white(bumpy_mesh, oblique_pose), sharp_image(CAMERA)
    view = Surroundings.of(frame(image, seen, oblique_pose), light, light).behind(seen, CAMERA, oblique_pose)
    assert (view.surround == ~seen.mask).all()
    assert (view.visible == seen.mask).all()
    np.testing.assert_array_equal(view.rgb[seen.mask], seen.rgb[seen.mask])
    np.testing.assert_array_equal(view.seen_mm, seen.depth_mm)
    beside = cv2.erode((~seen.mask).astype(np.uint8), np.ones((2 * MARGIN_PX + 1,) * 2)) > 0
    assert 0.2 < beside.mean() < 0.8
    np.testing.assert_allclose(view.rgb[beside], image[beside], atol=2e-4)


def test_around_a_plane_the_sheet_is_that_plane(frontal_pose):
    """What lies on the plane of the surface is seen where it is, from elsewhere too."""
    x, y = np.meshgrid(np.linspace(-9, 9, 10), np.linspace(-9, 9, 10))
    plane = grid_mesh(x, y, 0 * x)

    def pattern(pose: np.ndarray) -> np.ndarray:
        rays, centre = CAMERA.rays_cam(CAMERA.pixel_grid()) @ pose[:3, :3], camera_centre(pose)
        at = centre - rays * (centre[2] / rays[..., 2:])
        return 0.5 + 0.4 * np.sin(at / [9.0, 11.0, 1.0] + [0.0, 1.0, 2.0]).astype(np.float32)

    pose = frontal_pose @ rigid(rotation_from_vector(np.array([0.5, -0.2, 0.1])))
    around = Surroundings.of(frame(pattern(pose), white(plane, pose), pose))
    for turn in ([0.1, 0.2, 0.3], [0.6, -0.4, 0.0]):
        other = frontal_pose @ rigid(rotation_from_vector(np.array(turn)))
        view = around.behind(white(plane, other), CAMERA, other)
        beside = cv2.erode(view.surround.astype(np.uint8), np.ones((13, 13))) > 0
        pixels = around.view.project(points_of(other, beside))[0]
        inside = (pixels > 1).all(axis=1) & (pixels < np.array(CAMERA.size_wh) - 2).all(axis=1)
        assert inside.sum() > 3000
        np.testing.assert_allclose(view.rgb[beside][inside], pattern(other)[beside][inside], atol=0.01)


def points_of(pose: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    rays, centre = CAMERA.rays_cam(CAMERA.pixel_grid()[pixels]) @ pose[:3, :3], camera_centre(pose)
    return centre - rays * (centre[2] / rays[:, 2:])


@pytest.mark.parametrize("own", [False, True], ids=["lens", "shadows"])
def test_a_shadow_is_where_rays_from_the_lamp_end(bumpy_mesh, oblique_pose, own, ray_cast):
    """And leaves no more than the ambient part; the rest of the surface is as it was."""
    tool = hook(np.random.default_rng(1)).parts(60.0)[0][0]
    held = rigid(rotation_from_vector(np.array([0.0, 0.9, 0.4])), [2.0, 1.0, 6.0])
    tool = TriangleMesh(transform_points(held, tool.vertices), tool.faces)
    seen, raster = white(bumpy_mesh, oblique_pose, LIGHT), rasterise_depth(bumpy_mesh, CAMERA, oblique_pose)
    shadow = Shadow(tool, LIGHT, CAMERA, oblique_pose)
    light = replace(LIGHT, shadows=own)
    view = LitSurface(bumpy_mesh, light).shaded(seen, shadow)
    points = pixel_points(seen.depth_mm, np.nonzero(seen.mask), CAMERA, oblique_pose)
    lamp_from_model = rigid(translation=-np.array(LIGHT.light.lamp_cam_mm)) @ oblique_pose
    points_lamp = transform_points(lamp_from_model, points)
    depth, _ = ray_cast(tool, CAMERA, lamp_from_model, CAMERA.project(points_lamp))
    dark = np.zeros(seen.mask.shape, np.uint8)
    dark[seen.mask] = (depth > 0) & (depth < points_lamp[:, 2])
    covered = shadow.covers(seen.depth_mm)
    assert covered.sum() > 100
    # texels are as large as pixels
    assert not (covered & ~(cv2.dilate(dark, np.ones((3, 3))) > 0)).any()
    assert not ((cv2.erode(dark, np.ones((3, 3))) > 0) & ~covered).any()
    np.testing.assert_array_equal(view.rgb[~covered], seen.rgb[~covered])
    if not own:
        nothing = np.zeros(covered.sum(), np.float32)
        ambient = factors(bumpy_mesh, raster.face, seen.depth_mm, covered, oblique_pose, nothing)
        expected = shown_codes(shifted_codes(np.full((covered.sum(), 3), 0.8)), ambient)
        np.testing.assert_allclose(view.rgb[covered], expected, atol=1e-4)
    assert (view.rgb <= seen.rgb + 1e-6).all()
