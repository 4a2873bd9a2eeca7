"""Colours: the source pose gives the frame back, both modes agree, and nothing unseen is ever painted."""

import numpy as np
import pytest

from oneframe.blender.render.cycles import CyclesScene
from oneframe.blender.render.engines import reference_view_of
from oneframe.camera.pinhole import PinholeCamera
from oneframe.colour.reference_view import (
    ReferenceView,
    colours_of,
    limited_to_incidence,
    unseen_colours_of,
    without_highlights,
)
from oneframe.colour.shading import ColouredSurface
from oneframe.colour.vertex_colours import NEUTRAL
from oneframe.projection.rendered_view import RenderedView
from oneframe.surface.mesh import TriangleMesh
from oneframe.transforms import inverse_rigid, rigid, rotation_from_vector, transform_points

pytestmark = pytest.mark.render
from tests.conftest import grid_mesh

CAMERA = PinholeCamera(160, 120, 800.0, 790.0, 75.5, 62.25)
MODES = ("projective", "vertex")


def plane_mesh(edge: np.ndarray) -> TriangleMesh:
    x, y = np.meshgrid(edge, edge)
    return grid_mesh(x, y, 0 * x)


def rendered_in(
    mode: str, source: ReferenceView, cam_from_model: np.ndarray, *, unseen: str = "neutral"
) -> RenderedView:
    (colour,), _ = colours_of(source, mode)
    with CyclesScene(ColouredSurface(source.mesh, (colour,), unseen_colours_of(source, unseen)), CAMERA) as scene:
        return scene.render(cam_from_model)


def test_source_pose_gives_the_frame_back(bumpy_mesh, oblique_pose, sharp_image, loaded_case):
    image = sharp_image(CAMERA)
    source = reference_view_of(loaded_case(bumpy_mesh, image, oblique_pose, CAMERA))
    view = rendered_in("projective", source, oblique_pose)
    assert view.observed.sum() > 0.85 * view.mask.sum()
    codes = np.rint(view.rgb * 255)
    assert np.abs(codes - image * 255)[view.observed].mean() <= 0.02
    unobserved = view.mask & ~view.observed
    assert np.allclose(view.rgb[unobserved], NEUTRAL, atol=1e-6)
    assert (view.rgb[~view.mask] == 0).all()


def test_vertex_mode_is_exact_where_the_image_is_smooth(bumpy_mesh, frontal_pose, loaded_case):
    v, u = np.mgrid[: CAMERA.height, : CAMERA.width]
    image = np.stack([u / CAMERA.width, v / CAMERA.height, (u + v) / 300], -1).astype(np.float32)
    source = reference_view_of(loaded_case(bumpy_mesh, image, frontal_pose, CAMERA))
    view = rendered_in("vertex", source, frontal_pose)
    assert view.observed.sum() > 0.8 * view.mask.sum()
    # colours are affine in the pixel, the mesh is dense: only perspective inside a triangle is left
    assert np.abs(view.rgb - image)[view.observed].mean() * 255 < 0.05


def test_only_what_the_frame_saw_is_painted(
    stepped_mesh, frontal_pose, oblique_pose, sharp_image, ray_cast, loaded_case
):
    """Against an independent ray cast: a painted point is free to the source camera, a free point is painted."""
    source = reference_view_of(loaded_case(stepped_mesh, sharp_image(CAMERA), frontal_pose, CAMERA))
    for pose in (oblique_pose, frontal_pose @ rigid(rotation_from_vector(np.array([-0.5, 0.3, 0.8])))):
        views = {mode: rendered_in(mode, source, pose) for mode in MODES}
        depth_mm = views["projective"].depth_mm
        rows, columns = np.nonzero(depth_mm)
        rays = CAMERA.rays_cam(np.stack([columns, rows], 1).astype(float))
        points = transform_points(inverse_rigid(pose), rays * depth_mm[rows, columns, None])
        seen_at = CAMERA.project(transform_points(frontal_pose, points))
        first, _ = ray_cast(stepped_mesh, CAMERA, frontal_pose, seen_at)
        own = transform_points(frontal_pose, points)[:, 2]
        free = (np.abs(first - own) < 0.05) & CAMERA.contains(seen_at)
        # a back side is never seen by the frame, which looks down on front sides only
        assert free.mean() > 0.5
        assert (~free).mean() > 0.05
        for mode, view in views.items():
            assert np.array_equal(view.depth_mm, depth_mm), mode
            observed = view.observed[rows, columns]
            assert not (observed & ~free).any(), mode
            # what stays unpainted although it is free: a rim of one frame pixel (projective) or triangle
            rim = 1 if mode != "vertex" else 4
            assert (free & ~observed).mean() < 0.06 * rim, mode


@pytest.mark.parametrize("mode", MODES)
def test_back_sides_are_not_painted(stepped_mesh, frontal_pose, sharp_image, loaded_case, mode):
    source = reference_view_of(loaded_case(stepped_mesh, sharp_image(CAMERA), frontal_pose, CAMERA))
    from_below = frontal_pose @ rigid(rotation_from_vector(np.array([np.pi, 0.0, 0.0])))
    view = rendered_in(mode, source, from_below)
    assert view.mask.mean() > 0.3
    assert not view.observed.any()


def test_projection_is_exact_for_two_huge_triangles(sharp_image, loaded_case):
    """A slanted plane of two triangles gives the same view as the same plane of ten thousand."""
    pose = rigid(np.diag([1.0, -1.0, -1.0]) @ rotation_from_vector(np.array([0.9, 0.3, 0.0])), [0.0, 0.0, 300.0])
    image, views = sharp_image(CAMERA), []
    for cells in (1, 70):
        edge = np.linspace(-60, 60, cells + 1)
        source = reference_view_of(loaded_case(plane_mesh(edge), image, pose, CAMERA))
        views.append(rendered_in("projective", source, pose @ rigid(rotation_from_vector(np.array([0.2, -0.3, 0.1])))))
    both = views[0].observed & views[1].observed
    assert both.sum() > 0.5 * views[0].mask.sum()
    assert np.count_nonzero(views[0].observed != views[1].observed) < 0.01 * both.sum()
    assert np.abs(views[0].rgb - views[1].rgb)[both].max() * 255 < 0.6


def test_a_smaller_angle_of_incidence_counts_less_as_seen(bumpy_mesh, frontal_pose, sharp_image, loaded_case):
    source = reference_view_of(loaded_case(bumpy_mesh, sharp_image(CAMERA), frontal_pose, CAMERA))
    wide, narrow = (
        rendered_in("projective", limited_to_incidence(source, angle), frontal_pose).observed for angle in (87.0, 30.0)
    )
    assert not (narrow & ~wide).any()
    assert 0.1 * wide.sum() < narrow.sum() < 0.9 * wide.sum()


def test_dropped_highlights_are_not_seen_and_nothing_else_changes(bumpy_mesh, frontal_pose, sharp_image, loaded_case):
    image = 0.2 * sharp_image(CAMERA)
    image[40:44, 60:66] = 1.0
    loaded = loaded_case(bumpy_mesh, image, frontal_pose, CAMERA)
    source = reference_view_of(loaded)
    kept, dropped = (
        rendered_in("projective", each, frontal_pose) for each in (source, without_highlights(source, loaded.frames))
    )
    gone = kept.observed & ~dropped.observed
    assert gone[40:44, 60:66].all()
    gone[39:45, 59:67] = False
    assert not gone.any()
    assert np.array_equal(kept.rgb[dropped.observed], dropped.rgb[dropped.observed])
    assert np.array_equal(kept.depth_mm, dropped.depth_mm)
