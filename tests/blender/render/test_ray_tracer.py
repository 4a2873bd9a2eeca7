"""The engine raster against Cycles and a ray cast: the same surface, the same colours, on meshes of any kind."""

from contextlib import ExitStack

import numpy as np
import pytest
import trimesh

from oneframe.blender.render.engines import opened_engine, reference_view_of
from oneframe.camera.pinhole import PinholeCamera
from oneframe.colour.ray_tracer import RayTracer
from oneframe.colour.reference_view import colours_of, unseen_colours_of
from oneframe.colour.shading import ColouredSurface
from oneframe.projection.rendered_view import RenderedView
from oneframe.projection.z_buffer import rasterise_depth
from oneframe.surface.mesh import TriangleMesh
from oneframe.transforms import rigid, rotation_from_vector
from tests.blender.bridge.test_camera import CAMERAS, EXACT_ENGINES

pytestmark = pytest.mark.render

FRAME = PinholeCamera(160, 120, 800.0, 790.0, 75.5, 62.25)
SMALL = FRAME.resized(64, 48)
FEW = 2
"""Pixels of a view that may differ, at edges, as Cycles' rays are off by up to 0.01 px."""


def assert_those_of_cycles(view: RenderedView, cycles: RenderedView, camera: PinholeCamera) -> None:
    """The same masks, depths within a share of the pixel's footprint, and colours within a code, but for few pixels."""
    assert np.count_nonzero(view.mask != cycles.mask) <= 1
    assert np.count_nonzero(view.observed != cycles.observed) <= FEW
    assert np.count_nonzero(view.near_unseen != cycles.near_unseen) <= FEW
    off_mm = np.abs(view.depth_mm - cycles.depth_mm)
    assert np.count_nonzero(off_mm > 0.05 * cycles.depth_mm / camera.fx) <= FEW
    assert np.count_nonzero(np.abs(view.rgb - cycles.rgb).max(axis=2) > 1 / 255) <= FEW
    assert view.mask.any()


# every two of them together
@pytest.mark.parametrize(
    ("shape", "mode", "unseen", "samples"),
    [
        ("bumpy_mesh", "projective", "neutral", 4),
        ("bumpy_mesh", "vertex", "neutral", 1),
        ("stepped_mesh", "projective", "fill", 1),
        ("stepped_mesh", "vertex", "fill", 4),
    ],
)
def test_views_are_those_of_cycles(
    shape, mode, unseen, samples, request, frontal_pose, oblique_pose, sharp_image, loaded_case
):
    mesh = request.getfixturevalue(shape)
    source = reference_view_of(loaded_case(mesh, sharp_image(FRAME), frontal_pose, FRAME))
    (colour,), _ = colours_of(source, mode)
    surface = ColouredSurface(mesh, (colour,), unseen_colours_of(source, unseen), source.pivot_model)
    nearer = rigid(translation=[4.0, -2.0, -100.0]) @ oblique_pose
    from_behind = oblique_pose @ rigid(rotation_from_vector(np.array([0.0, 2.6, 0.0])))
    for camera in (SMALL,) if samples > 1 else (SMALL, FRAME):
        with ExitStack() as opened:
            raster, cycles = (
                opened.enter_context(opened_engine(engine, surface, camera, samples=samples))
                for engine in ("raster", "cycles")
            )
            for pose in (oblique_pose, nearer, from_behind):
                assert_those_of_cycles(raster(pose), cycles(pose), camera)


def blob(subdivisions: int, radius_mm: float) -> TriangleMesh:
    """A closed surface of 20 x 4^``subdivisions`` faces, with bumps."""
    ball = trimesh.creation.icosphere(subdivisions)
    direction = np.array(ball.vertices)
    bumps = 1 + 0.1 * np.sin(7 * direction).prod(axis=-1) + 0.05 * np.cos(23 * direction).sum(axis=-1)
    return TriangleMesh(radius_mm * bumps[:, None] * direction, ball.faces.astype(np.int32))


@pytest.mark.parametrize(
    ("shape", "camera", "distance_mm"),
    [
        ((6, 30.0), PinholeCamera(160, 120, 700.0, 700.0, 79.5, 59.5), 300.0),
        ((4, 2.5), PinholeCamera(160, 120, 9000.0, 9000.0, 79.5, 59.5), 400.0),
        ((4, 2.5), PinholeCamera(64, 48, 32_000.0, 32_000.0, 31.5, 23.5), 4000.0),
    ],
    ids=["many faces", "5 mm", "5 mm from far away"],
)
def test_large_meshes_and_small_objects_are_those_of_a_z_buffer(shape, camera, distance_mm, sharp_image, loaded_case):
    mesh = blob(*shape)
    pose = rigid(rotation_from_vector(np.array([2.4, 0.3, -0.4])), [0.0, 0.0, distance_mm])
    source = reference_view_of(loaded_case(mesh, sharp_image(camera), pose, camera), "raster")
    view = RayTracer(ColouredSurface(source.mesh, source.views), camera).render(
        pose @ rigid(rotation_from_vector(np.array([0.1, 0.2, 0.1])))
    )
    assert 0.2 < view.mask.mean() < 0.95
    assert view.observed.sum() > 0.7 * view.mask.sum()
    shown = RayTracer(ColouredSurface(mesh), camera).render(pose)
    nearness = rasterise_depth(mesh, camera, pose).inverse_depth
    assert np.count_nonzero((nearness > 0) != shown.mask) <= 2
    both = (nearness > 0) & shown.mask
    off_px = np.abs(shown.depth_mm * nearness - 1)[both] * camera.fx
    assert np.quantile(off_px, 0.999) < 0.01


LONG = 8200
"""Cycles renders views of more than 8192 px in parts."""
CLIPPED = "cycles", "inside"
"""Its clip planes leave out what is nearest."""
TURNED = rigid(rotation_from_vector(np.array([2.2, 0.1, 0.2])), np.array([0.5, 2.0, 6.0]))
CASTS = {
    "from near": (CAMERAS["landscape"].resized(320, 240), lambda _, oblique: rigid(translation=[0, 0, -180]) @ oblique),
    "long lens": (CAMERAS["long lens"].resized(320, 240), lambda _, oblique: oblique),
    # nearly as far from square pixels as is allowed, so that the short side shows the surface too
    "wide": (PinholeCamera(LONG, 24, 4 * LONG, 4 * LONG / 150, LONG / 2 - 0.5, 11.5), lambda frontal, _: frontal),
    "tall": (PinholeCamera(24, LONG, 4 * LONG / 150, 4 * LONG, 11.5, LONG / 2 - 0.5), lambda frontal, _: frontal),
    # near and far parts of the surface in one view, and parts behind the camera
    "inside": (PinholeCamera(120, 90, 60.0, 61.0, 60.2, 44.7), lambda *_: TURNED),
}


@pytest.mark.parametrize(
    ("engine", "name"), [(engine, name) for engine in EXACT_ENGINES for name in CASTS if (engine, name) != CLIPPED]
)
def test_a_view_is_that_of_a_ray_cast(engine, name, bumpy_mesh, frontal_pose, oblique_pose, ray_cast):
    camera, pose_of = CASTS[name]
    pose, some = pose_of(frontal_pose, oblique_pose), slice(None, None, 97 if max(camera.size_wh) == LONG else 1)
    with opened_engine(engine, ColouredSurface(bumpy_mesh), camera) as render:
        shown = render(pose).depth_mm.reshape(-1)[some]
    depth, _ = ray_cast(bumpy_mesh, camera, pose, camera.pixel_grid().reshape(-1, 2)[some])
    assert (depth > 0).mean() > 0.1
    assert np.count_nonzero((depth > 0) != (shown > 0)) <= 1
    error = np.abs(shown - depth)[(shown > 0) & (depth > 0)]
    # a ray through the very rim of a hill may pass it in single precision
    assert np.quantile(error, 0.9999) < 1e-3
    assert max(camera.size_wh) == LONG or np.median(error) < 1e-4
