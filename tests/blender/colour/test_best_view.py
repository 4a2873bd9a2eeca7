"""Views coloured from two frames: every pixel has the colour of the one that sees its surface least foreshortened."""

from dataclasses import replace

import numpy as np
import pytest

from oneframe.blender.colour.reference_view import reference_views_of
from oneframe.blender.dataset.view_renderer import ViewRenderer
from oneframe.camera.pinhole import PinholeCamera
from oneframe.dataset.options import DatasetOptions
from oneframe.projection.z_buffer import rasterise_depth
from oneframe.transforms import camera_centre, inverse_rigid, rigid, rotation_from_vector, transform_points

pytestmark = pytest.mark.render

CAMERA = PinholeCamera(160, 120, 800.0, 790.0, 75.5, 62.25)
RED, BLUE = (0.8, 0.2, 0.1), (0.1, 0.2, 0.8)


@pytest.mark.parametrize("engine", ["cycles", "raster"])
def test_the_least_foreshortened_frame_colours_a_pixel(bumpy_mesh, frontal_pose, loaded_case, engine):
    poses = [frontal_pose @ rigid(rotation_from_vector(np.array([0.0, turn, 0.0]))) for turn in (-0.4, 0.4)]
    red, blue = (
        loaded_case(bumpy_mesh, np.full((*CAMERA.shape_hw, 3), colour, np.float32), pose, CAMERA)
        for colour, pose in zip((RED, BLUE), poses, strict=True)
    )
    views = []
    for case in (red, blue, replace(red, frames=(red.frame, blue.frame))):
        options = DatasetOptions(engine=engine)
        with ViewRenderer(case, reference_views_of(case, engine), options, frontal_pose[None]) as renderer:
            views.append(renderer.render(frontal_pose))
    first, second, joined = views
    np.testing.assert_array_equal(joined.observed, first.observed | second.observed)
    np.testing.assert_array_equal(joined.depth_mm, first.depth_mm)
    for alone, other in ((first, second), (second, first)):
        np.testing.assert_array_equal(
            joined.rgb[alone.observed & ~other.observed], alone.rgb[alone.observed & ~other.observed]
        )
    # of what both saw, by the faces' own normals
    both = first.observed & second.observed
    face = rasterise_depth(bumpy_mesh, CAMERA, frontal_pose).face[both]
    rays = CAMERA.rays_cam(CAMERA.pixel_grid())[both]
    points = transform_points(inverse_rigid(frontal_pose), rays * joined.depth_mm[both, None])
    cosines = []
    for pose in poses:
        towards = camera_centre(pose) - points
        towards /= np.linalg.norm(towards, axis=1, keepdims=True)
        cosines.append((towards * bumpy_mesh.face_normals[face]).sum(axis=1))
    is_red = joined.rgb[both][:, 0] > 0.5
    assert 0.1 < is_red.mean() < 0.9
    assert (is_red == (cosines[0] > cosines[1])).mean() > 0.97
