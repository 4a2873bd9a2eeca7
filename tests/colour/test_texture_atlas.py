"""The texture: frames' own pixels on faces that a frame saw whole, and nothing of a frame on others."""

import numpy as np
import pytest

from oneframe.camera.pinhole import PinholeCamera
from oneframe.colour.seen_frame import SeenFrame
from oneframe.colour.texture_atlas import bake_atlas
from oneframe.colour.vertex_colours import NEUTRAL
from oneframe.errors import InputError
from oneframe.images.pixel_values import sample_bilinear
from oneframe.projection.z_buffer import rasterise_depth
from oneframe.transforms import rigid, rotation_from_vector
from tests.colour.test_seen_frame import Points, ball
from tests.conftest import grid_mesh, joined

CAMERA = PinholeCamera(160, 120, 500.0, 510.0, 78.3, 60.9)
POSE = rigid(rotation_from_vector(np.array([0.3, -0.4, 0.1])), np.array([0, 0, 200.0]))


def height_field(columns, rows, half_width, half_height, z_of_xy):
    """A height field over the model's xy plane, its front towards -z (towards the camera)."""
    x, y = np.meshgrid(
        np.linspace(-half_width, half_width, columns + 1), np.linspace(-half_height, half_height, rows + 1)
    )
    return grid_mesh(x, y, z_of_xy(x, y)).flipped()


def view_of(mesh, pose, rng) -> SeenFrame:
    """A frame of noise that sees a mesh."""
    inverse = rasterise_depth(mesh, CAMERA, pose).inverse_depth.astype(np.float32)
    image = rng.uniform(0, 1, (*CAMERA.shape_hw, 3)).astype(np.float32)
    return SeenFrame(image, np.ones(CAMERA.shape_hw, bool), CAMERA, pose, inverse_depth=inverse)


def looked_up(atlas, points: Points) -> np.ndarray:
    """What other programs show at points."""
    height, width = atlas.observed.shape
    uv = np.einsum("nk,nkd->nd", points.weights, atlas.uv[points.face])
    return sample_bilinear(atlas.image, uv * [width, -height] + [-0.5, height - 0.5])


@pytest.mark.parametrize("cells", [(150, 120), (12, 9)], ids=["fine", "coarse"])
def test_faces_seen_whole_have_the_frame_s_pixels_and_others_nothing_of_it(cells, rng):
    """Behind a ball and beyond the frame too; what the rule sees is left out at borders only, by whole faces."""
    plane = height_field(*cells, 40, 30, lambda x, y: 0.2 * x)
    mesh = joined(plane, ball(60, 6.0, [3, -2, -45]))
    view = view_of(mesh, POSE, rng)
    atlas = bake_atlas(mesh, [view])
    assert atlas.uv.shape == (len(mesh.faces), 3, 2)
    assert atlas.uv.min() >= 0
    assert atlas.uv.max() <= 1
    assert (atlas.image[~atlas.observed] == np.float32(NEUTRAL)).all()
    points = Points(mesh, 40000, rng)
    rule, seen, colours = (
        view.observed(points.points, points.normals),
        atlas.seen[points.face],
        looked_up(atlas, points),
    )
    assert 0.3 < rule.mean() < 0.9
    assert (seen & ~rule).mean() < 2e-4
    assert (rule & ~seen).mean() < (0.05 if cells[0] == 150 else 0.35)
    expected = view.colours(view.project(points.points[seen & rule])[0])
    # full contrast from pixel to pixel
    assert np.abs(colours[seen & rule] - expected).mean() < atlas.bent_px + 1e-3
    np.testing.assert_allclose(colours[~seen], NEUTRAL)


def test_a_plane_seen_from_the_front_is_lossless(rng):
    mesh, pose = height_field(45, 35, 40, 30, lambda x, y: 0 * x), rigid(translation=np.array([0, 0, 200.0]))
    view, points = view_of(mesh, pose, rng), Points(mesh, 30000, rng)
    atlas = bake_atlas(mesh, [view])
    assert len(atlas.messages()) == 1
    seen = atlas.seen[points.face]
    expected = view.colours(view.project(points.points[seen])[0])
    np.testing.assert_allclose(looked_up(atlas, points)[seen], expected, atol=2e-5)


def test_large_faces_are_said_to_be_bent_by_perspective(rng):
    mesh, pose = height_field(1, 1, 20, 14, lambda x, y: 1.5 * x), rigid(translation=np.array([0, 0, 200.0]))
    atlas = bake_atlas(mesh, [view_of(mesh, pose, rng)])
    assert atlas.seen.all()
    # the middle of the upper edge, 30 mm nearer and farther at its ends
    ends = [CAMERA.project(np.array([[x, 0.0, 200 + 1.5 * x]]))[0, 0] for x in (-20.0, 0.0, 20.0)]
    assert atlas.bent_px >= abs((ends[0] + ends[2]) / 2 - ends[1]) > 5
    assert "not bent by perspective" in atlas.messages()[1]


def test_what_no_frame_saw_has_the_colours_that_are_given(rng):
    mesh = height_field(20, 16, 60, 40, lambda x, y: 0 * x)
    atlas = bake_atlas(mesh, [view_of(mesh, POSE, rng)], unseen=mesh.vertices / 200 + 0.5)
    points = Points(mesh, 5000, rng)
    other = ~atlas.seen[points.face]
    assert other.any()
    np.testing.assert_allclose(looked_up(atlas, points)[other], points.points[other] / 200 + 0.5, atol=1e-5)


def test_a_texture_beyond_the_limit_is_refused(rng):
    mesh = height_field(4, 4, 30, 20, lambda x, y: 0 * x)
    with pytest.raises(
        InputError, match=r"texture: expected at most 50x50 texels, found \d+x\d+ .*; use vertex colours"
    ):
        bake_atlas(mesh, [view_of(mesh, POSE, rng)], max_size=50)
