"""The raster engine against Cycles and against a ray cast: the same surface, the same colours, in any process."""

import dataclasses

import numpy as np
import pytest

from pipeline.blender.colour.reference_view import reference_view_of, unseen_colours_of
from pipeline.blender.render.engines import check_engine, render_view
from pipeline.blender.render.raster import check_raster
from pipeline.blender.render.surface_scene import SurfaceScene
from pipeline.camera.pinhole import PinholeCamera
from pipeline.errors import InputError, RunError
from pipeline.transforms import rigid, rotation_from_vector

pytestmark = [pytest.mark.render, pytest.mark.gl]

CAMERA = PinholeCamera(160, 120, 800.0, 790.0, 75.5, 62.25)


@pytest.fixture(autouse=True, scope="module")
def opengl():
    try:
        check_engine("raster")
    except InputError as error:
        pytest.skip(str(error))


def test_the_frames_own_pose_gives_the_frame_back(bumpy_mesh, oblique_pose, sharp_image, loaded_case):
    image = sharp_image(CAMERA)
    source = reference_view_of(loaded_case(bumpy_mesh, image, oblique_pose, CAMERA))
    with SurfaceScene(source.mesh, CAMERA, source.view, engine="raster") as scene:
        view = render_view(scene, oblique_pose)
    assert view.observed.sum() > 0.85 * view.mask.sum()
    assert (np.rint(view.rgb * 255) == np.rint(image * 255))[view.observed].all()
    assert (view.rgb[~view.mask] == 0).all()


@pytest.mark.parametrize(("turn_deg", "unseen"), [(0, "neutral"), (12, "fill"), (25, "neutral"), (25, "fill")])
def test_views_are_those_of_cycles(stepped_mesh, frontal_pose, sharp_image, loaded_case, turn_deg, unseen):
    source = reference_view_of(loaded_case(stepped_mesh, sharp_image(CAMERA), frontal_pose, CAMERA))
    pose = frontal_pose @ rigid(rotation_from_vector(np.radians([0.3 * turn_deg, turn_deg, 5])))
    views = {}
    for engine in ("cycles", "raster"):
        colours = unseen_colours_of(source, unseen)
        with SurfaceScene(source.mesh, CAMERA, source.view, engine=engine, unseen=colours) as scene:
            views[engine] = render_view(scene, pose)
    cycles, raster = views["cycles"], views["raster"]
    assert np.count_nonzero(cycles.mask != raster.mask) <= 2
    assert np.count_nonzero(cycles.observed != raster.observed) <= 2
    both = cycles.observed & raster.observed
    assert both.mean() > 0.1
    assert np.quantile(np.abs(cycles.depth_mm - raster.depth_mm)[both], 0.999) < 1e-3
    assert np.quantile(np.abs(cycles.rgb - raster.rgb)[both] * 255, 0.999) < 0.25
    neither = cycles.mask & raster.mask & ~cycles.observed & ~raster.observed
    assert neither.any() or turn_deg == 0
    assert np.abs(cycles.rgb - raster.rgb)[neither].max(initial=0) * 255 < 0.25


def test_a_camera_inside_the_surfaces_sphere_sees_what_a_ray_cast_sees(bumpy_mesh, ray_cast):
    """Where a depth buffer would resolve little: near and far parts of the surface in one view."""
    camera = PinholeCamera(120, 90, 60.0, 61.0, 60.2, 44.7)
    pose = rigid(rotation_from_vector(np.array([2.2, 0.1, 0.2])), np.array([0.5, 2.0, 6.0]))
    with SurfaceScene(bumpy_mesh, camera, None, engine="raster") as scene:
        view = render_view(scene, pose)
    depth, _ = ray_cast(bumpy_mesh, camera, pose, camera.pixel_grid().reshape(-1, 2))
    depth = depth.reshape(camera.shape_hw)
    assert (depth > 0).mean() > 0.2
    assert np.count_nonzero((depth > 0) != view.mask) <= 2
    both = (depth > 0) & view.mask
    assert np.quantile(np.abs(view.depth_mm - depth)[both], 0.999) < 1e-3


def test_a_driver_that_draws_something_else_is_refused(bumpy_mesh, oblique_pose, sharp_image, loaded_case):
    source = reference_view_of(loaded_case(bumpy_mesh, sharp_image(CAMERA), oblique_pose, CAMERA))
    check_raster(source.mesh, source.view)
    # as if the driver drew the image upside down
    other = dataclasses.replace(source.view, inverse_depth=np.ascontiguousarray(source.view.inverse_depth[::-1]))
    with pytest.raises(RunError, match="use --engine cycles"):
        check_raster(source.mesh, other)
