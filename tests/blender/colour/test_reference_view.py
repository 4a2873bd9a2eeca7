"""The reference view from a z-buffer is that of a render, up to the rounding of single precision."""

import numpy as np
import pytest

from oneframe.blender.render.engines import opened_engine, reference_view_of
from oneframe.camera.pinhole import PinholeCamera
from oneframe.colour.reference_view import reference_view
from oneframe.colour.shading import ColouredSurface
from oneframe.colour.texture_atlas import seen_faces
from oneframe.colour.vertex_colours import colour_vertices
from oneframe.transforms import rigid

pytestmark = pytest.mark.render

CAMERA = PinholeCamera(320, 240, 1600.0, 1580.0, 151.5, 122.25)


@pytest.mark.parametrize(("surface", "flipped"), [("bumpy_mesh", True), ("stepped_mesh", False)])
def test_depths_differ_by_rounding_and_colours_not_at_all(
    surface, flipped, oblique_pose, sharp_image, loaded_case, request
):
    mesh = request.getfixturevalue(surface)
    case = loaded_case(mesh.flipped() if flipped else mesh, sharp_image(CAMERA), oblique_pose, CAMERA)
    rendered, rasterised = reference_view_of(case), reference_view(case)
    expected, found = rendered.view.inverse_depth, rasterised.view.inverse_depth
    assert found.dtype == expected.dtype
    far = ~np.isclose(found, expected, rtol=2e-5, atol=0)
    # only where the centre lies on an outline to that rounding does a render show the surface behind it
    assert not (far & ~beside_a_step(expected)).any()
    assert far.mean() < 1e-4
    assert rasterised.messages == rendered.messages
    assert len(rendered.messages) == flipped
    assert np.array_equal(rasterised.mesh.faces, rendered.mesh.faces)
    np.testing.assert_allclose(rasterised.pivot_model, rendered.pivot_model, atol=0.01)

    vertices, same = colour_vertices(rasterised.mesh, rasterised.views), colour_vertices(rendered.mesh, rendered.views)
    both = vertices.observed & same.observed
    assert both.mean() > 0.3
    assert np.array_equal(vertices.rgb[both], same.rgb[both])
    assert (vertices.observed != same.observed).mean() < 1e-3
    faces = np.arange(len(mesh.faces))
    seen = [seen_faces(source.mesh, faces, source.view) for source in (rasterised, rendered)]
    assert (seen[0] != seen[1]).mean() < 1e-3
    with opened_engine("cycles", ColouredSurface(rendered.mesh, rendered.views), CAMERA) as render:
        view = render(oblique_pose)
    assert rasterised.coverage()[0] == pytest.approx(view.observed.sum() / view.mask.sum(), rel=2e-3)


def beside_a_step(inverse_depth):
    """Pixels with a neighbour of which the depth differs by more than a percent, or that has none."""
    around = np.pad(inverse_depth, 1, mode="edge")
    steps = np.zeros(inverse_depth.shape, dtype=bool)
    for rows in (slice(0, -2), slice(1, -1), slice(2, None)):
        for columns in (slice(0, -2), slice(1, -1), slice(2, None)):
            steps |= np.abs(around[rows, columns] - inverse_depth) > 0.01 * inverse_depth.max()
    return steps


def test_a_surface_that_reaches_behind_the_camera_is_rendered(bumpy_mesh, sharp_image, loaded_case):
    """The z-buffer has no near plane: it would leave out faces that the frame shows."""
    wide = PinholeCamera(64, 48, 40.0, 40.0, 31.5, 23.5)
    turned = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
    # the camera is 10 mm above the middle of the surface, and looks along it
    above = rigid(turned, np.array([0, 10.0, 0.0]))
    source = reference_view(loaded_case(bumpy_mesh, sharp_image(wide), above, wide))
    assert (source.view.inverse_depth > 0).mean() > 0.1
