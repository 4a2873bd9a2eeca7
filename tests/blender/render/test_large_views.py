"""Views that an engine renders in several parts."""

import numpy as np
import pytest

from oneframe.blender.render.engines import opened_engine
from oneframe.camera.pinhole import PinholeCamera
from oneframe.colour.shading import ColouredSurface

pytestmark = pytest.mark.render


@pytest.mark.parametrize(("engine", "size"), [("cycles", (8200, 24)), ("cycles", (24, 8200)), ("raster", (24, 8200))])
def test_a_long_view_is_that_of_a_ray_cast_in_all_its_parts(bumpy_mesh, frontal_pose, ray_cast, engine, size):
    """Cycles splits views of more than 8192 px."""
    width, height = size
    # nearly as far from square pixels as is allowed, so that the short side shows the surface too
    fx, fy = (4 * width, 4 * width / 150) if width > height else (4 * height / 150, 4 * height)
    camera = PinholeCamera(width, height, fx, fy, (width - 1) / 2, (height - 1) / 2)
    with opened_engine(engine, ColouredSurface(bumpy_mesh), camera) as render:
        view = render(frontal_pose)
    pixels = camera.pixel_grid().reshape(-1, 2)[::97]
    depth, _ = ray_cast(bumpy_mesh, camera, frontal_pose, pixels)
    shown = view.depth_mm.reshape(-1)[::97]
    assert (depth > 0).mean() > 0.1
    assert np.count_nonzero((depth > 0) != (shown > 0)) <= 2
    both = (depth > 0) & (shown > 0)
    assert np.abs(depth - shown)[both].max() < 0.01
