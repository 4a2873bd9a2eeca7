"""The rule of what the frame saw: nothing is missed at the background, nothing leaks from there or another surface."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from oneframe.camera.pinhole import PinholeCamera
from oneframe.colour.seen_frame import SeenFrame
from oneframe.colour.vertex_colours import colour_vertices
from oneframe.projection.z_buffer import rasterise_depth
from oneframe.surface.mesh import TriangleMesh
from oneframe.transforms import camera_centre, rigid
from tests.conftest import grid_mesh, joined

CAMERA = PinholeCamera(120, 100, 800.0, 790.0, 61.3, 48.7)
CAM_FROM_MODEL = rigid(translation=np.array([0.3, -0.2, 300.0]))
BACKGROUND = (0.0, 0.0, 1.0)


def ball(rows: int, radius: float, centre=(0.0, 0.0, 0.0)) -> TriangleMesh:
    polar, azimuth = np.meshgrid(np.linspace(0.02, np.pi - 0.02, rows + 1), np.linspace(0, 2 * np.pi, 2 * rows + 1))
    unit = np.stack([np.sin(polar) * np.cos(azimuth), np.cos(polar), np.sin(polar) * np.sin(azimuth)], axis=-1)
    mesh = grid_mesh(*np.moveaxis(unit * radius, -1, 0))
    outwards = (mesh.face_cross * mesh.vertices[mesh.faces[:, 0]]).sum() > 0
    return (mesh if outwards else mesh.flipped()).moved(np.asarray(centre))


def seen_from_frame(meshes, colours, valid=None) -> tuple[TriangleMesh, SeenFrame]:
    """The meshes as one, and a frame that shows each in one colour before a blue background."""
    whole = joined(*meshes)
    raster = rasterise_depth(whole, CAMERA, CAM_FROM_MODEL)
    owner = np.repeat(np.arange(len(meshes)), [len(mesh.faces) for mesh in meshes])[raster.face]
    image = np.where((raster.face >= 0)[..., None], np.asarray(colours)[owner], BACKGROUND).astype(np.float32)
    inverse = raster.inverse_depth.astype(np.float32)
    if valid is not None:
        inverse[~valid] = 0
    else:
        valid = np.ones(CAMERA.shape_hw, bool)
    return whole, SeenFrame(image, valid, CAMERA, CAM_FROM_MODEL, inverse_depth=inverse)


class Points:
    """Random points of a mesh, evenly over its area, and their angle from the frame's ray."""

    def __init__(self, mesh, count, rng):
        area = np.linalg.norm(mesh.face_cross, axis=1)
        self.face = rng.choice(len(area), count, p=area / area.sum())
        self.weights = rng.dirichlet([0.7, 0.7, 0.7], count)  # near edges and corners more often
        self.points = np.einsum("nk,nkd->nd", self.weights, mesh.vertices[mesh.faces[self.face]])
        self.normals = mesh.face_normals[self.face]
        towards = camera_centre(CAM_FROM_MODEL) - self.points
        cosine = (towards * self.normals).sum(axis=1) / np.linalg.norm(towards, axis=1)
        self.incidence_deg = np.degrees(np.arccos(np.clip(cosine, -1, 1)))


@pytest.mark.parametrize(("diameter_px", "rows"), [(30, 24), (30, 120), (80, 24)])
def test_a_small_ball_before_the_background_is_seen_up_to_its_outline(diameter_px, rows, rng):
    """Lookups that use background pixels are not lost: those were a quarter of the ball of 30 px."""
    mesh, view = seen_from_frame([ball(rows, diameter_px / 2 * 300 / 800)], [(1.0, 0.0, 0.0)])
    points = Points(mesh, 20000, rng)
    observed = view.observed(points.points, points.normals)
    assert not observed[points.incidence_deg > view.max_incidence_deg].any()
    assert observed[points.incidence_deg < 75].all()
    assert observed[points.incidence_deg < 80].mean() > 0.999
    assert observed[points.incidence_deg < 87].mean() > 0.98
    # and without the background's colour
    np.testing.assert_allclose(view.colours(view.project(points.points[observed])[0])[:, 2], 0, atol=1e-6)


@settings(max_examples=10)
@given(seed=st.integers(0, 2**32 - 1))
def test_no_colour_leaks_from_background_or_occluder(seed):
    """Balls of one colour each, apart in depth, the first hiding parts of the second."""
    rng = np.random.default_rng(seed)
    depths = (-40.0, 0.0)
    centres = [(*rng.uniform(-9, 9, 2), depth) for depth in depths]
    balls = [ball(int(rng.integers(12, 60)), rng.uniform(4, 9), centre) for centre in centres]
    colours = [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0)]
    mesh, view = seen_from_frame(balls, colours)
    start, nearer = 0, []
    vertices = colour_vertices(mesh, [view])
    for each, colour, centre in zip(balls, colours, centres, strict=True):
        points = Points(each, 4000, rng)
        observed = view.observed(points.points, points.normals)
        found = view.colours(view.project(points.points[observed])[0])
        # a pixel of another surface passes with the weight a, if a times the relative step is below the tolerance
        slack = 1.5 * view.depth_tolerance * 300 / 20
        assert np.abs(found - colour).max(initial=0) <= slack
        # what a nearer ball hides by more than a pixel was not seen
        hidden = np.zeros(len(points.points), bool)
        for middle, radius in nearer:
            rays = points.points - camera_centre(CAM_FROM_MODEL)
            rays /= np.linalg.norm(rays, axis=1)[:, None]
            to = np.asarray(middle) - camera_centre(CAM_FROM_MODEL)
            gap = np.linalg.norm(to - (rays @ to)[:, None] * rays, axis=1)
            hidden |= gap < radius - 1.5 * 300 / 790 - 0.05 * radius
        assert not (observed & hidden).any()
        nearer.append((centre, np.linalg.norm(each.vertices - centre, axis=1).max()))
        own = slice(start, start + len(each.vertices))
        start = own.stop
        covered = vertices.covered[own]
        assert np.abs(vertices.rgb[own][covered] - colour).max(initial=0) <= slack


def test_masked_pixels_are_no_background(rng):
    """Lookups beside a mask stay refused: the point itself may be under the instrument."""
    valid = CAMERA.pixel_grid()[..., 0] < 60
    mesh, view = seen_from_frame([ball(60, 12.0)], [(1.0, 0.0, 0.0)], valid)
    points = Points(mesh, 20000, rng)
    observed = view.observed(points.points, points.normals)
    pixels, _ = view.project(points.points)
    assert not (observed & (pixels[:, 0] > 59.001)).any()
    inside = (points.incidence_deg < 75) & (pixels[:, 0] < 59)
    assert observed[inside].all()
    assert inside.sum() > 1000


def test_a_vertex_beside_a_step_gets_the_colour_of_its_own_surface():
    """A wall of fine triangles behind a ball: every vertex in the open is covered, by the wall's colour."""
    edge = np.linspace(-20, 20, 401)
    x, y = np.meshgrid(edge, edge)
    wall = grid_mesh(x, y, 40 + 0 * x).flipped()
    front = ball(60, 6.0)
    mesh, view = seen_from_frame([wall, front], [(0.0, 1.0, 0.0), (1.0, 0.0, 0.0)])
    found = colour_vertices(mesh, [view])
    of_wall = slice(0, len(wall.vertices))
    pixels, _ = view.project(wall.vertices)
    inside = ((pixels > 0) & (pixels < np.array(CAMERA.size_wh) - 1)).all(axis=1)
    middle, _ = view.project(np.zeros((1, 3)))
    clear = inside & (np.linalg.norm(pixels - middle, axis=1) > 6.0 * 800 / 300 * 1.01 + 0.5)
    assert not found.observed[of_wall][clear].all()
    assert found.covered[of_wall][clear].all()
    np.testing.assert_allclose(found.rgb[of_wall][clear], np.tile([0, 1, 0], (clear.sum(), 1)), atol=0.02)
