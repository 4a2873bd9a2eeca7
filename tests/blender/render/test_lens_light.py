"""Views in the light at the lens: the law on rendered pixels, the engines against each other, the frame given back."""

from contextlib import ExitStack
from dataclasses import replace

import cv2
import numpy as np
import pytest
import trimesh

from oneframe.blender.dataset.view_renderer import ViewRenderer
from oneframe.blender.render.engines import opened_engine, reference_view_of
from oneframe.camera.pinhole import PinholeCamera
from oneframe.colour.lens_shading import LensShading, lens_shading_of
from oneframe.colour.reference_view import colours_of, unseen_colours_of, without_shadows
from oneframe.colour.shading import ColouredSurface
from oneframe.dataset.description import describe
from oneframe.dataset.options import COLOURS, DatasetOptions
from oneframe.errors import InputError
from oneframe.images.pixel_values import linear_from_codes
from oneframe.images.transfer import TRANSFERS
from oneframe.light.lens_light import LensLight
from oneframe.surface.mesh import TriangleMesh
from oneframe.transforms import inverse_rigid, rigid, rotation_from_vector, transform_points
from tests.blender.render.test_ray_tracer import FEW, assert_those_of_cycles
from tests.codes import codes_from_linear
from tests.conftest import grid_mesh

pytestmark = pytest.mark.render

CAMERA = PinholeCamera(64, 48, 320.0, 316.0, 30.2, 24.9)
LIGHT = LensLight((-13.0, 16.0, 2.0), 0.08)
LENS = LensShading(LIGHT, 1e-3)


@pytest.fixture
def lit_case(loaded_case):
    """A case with the lamp :data:`LIGHT`."""

    def make(*given, light=LIGHT):
        loaded = loaded_case(*given)
        return replace(loaded, case=replace(loaded.case, light=light))

    return make


def albedo_of(loaded, engine="raster", *, shadows=False):
    return reference_view_of(loaded, engine, lens_shading_of(loaded, shadows=shadows))


def surface_of(source, mode="projective"):
    return ColouredSurface(source.mesh, tuple(colours_of(source, mode)[0]), light=source.light)


def ball(subdivisions: int) -> TriangleMesh:
    shape = trimesh.creation.icosphere(subdivisions, 20.0)
    return TriangleMesh(np.array(shape.vertices), shape.faces.astype(np.int32))


@pytest.mark.parametrize(
    ("engine", "transfer"),
    [("raster", "srgb"), ("raster", "bt709"), ("raster", "linear"), ("cycles", "srgb"), ("cycles", "linear")],
)
def test_a_grey_ball_is_lit_as_the_law_says(engine, transfer):
    check_light_on_a_ball(engine, LIGHT)
    check_light_on_a_ball(engine, replace(LIGHT, transfer=transfer, vignetting=90.0))
    check_light_on_a_ball(engine, LensLight(None, 1.0, transfer=transfer, vignetting=90.0))


def check_light_on_a_ball(engine: str, light: LensLight) -> None:
    """From the pixels' rays and the ball's equation alone; Eevee shows a point up to a hundredth of a pixel away."""
    lens, curve = replace(LENS, light=light), light.curve
    pose = rigid(rotation_from_vector(np.array([0.4, -1.0, 0.3])), np.array([2.0, -1.0, 250.0]))
    with opened_engine(engine, ColouredSurface(ball(5), light=lens), CAMERA) as render:
        view = render(pose)
    rays = CAMERA.rays_cam(CAMERA.pixel_grid().reshape(-1, 2))
    points = rays * view.depth_mm.reshape(-1, 1)
    normals = (points - pose[:3, 3]) / 20.0
    towards = np.array(LIGHT.lamp_cam_mm) - points
    r = np.linalg.norm(towards, axis=1)
    cosine = np.maximum((normals * towards).sum(axis=1) / r, 0)
    lamp = light.ambient + (light.lamp_cam_mm is not None) * cosine * (np.linalg.norm(pose[:3, 3]) / r) ** 2
    expected = linear_from_codes(0.5, curve) * lamp * np.linalg.norm(rays, axis=1) ** -light.vignetting
    inside = view.mask.ravel() & ((normals * rays).sum(axis=1) / np.linalg.norm(rays, axis=1) < -0.3)
    assert inside.sum() > 500
    off = np.abs(view.rgb.reshape(-1, 3) - codes_from_linear(expected, curve)[:, None])[inside]
    assert off.max() < 1.5 / 255


@pytest.mark.parametrize("mode", COLOURS)
def test_engines_agree_and_the_frame_comes_back(
    mode, bumpy_mesh, stepped_mesh, frontal_pose, oblique_pose, sharp_image, lit_case
):
    for mesh in (bumpy_mesh, stepped_mesh):
        loaded = lit_case(mesh, sharp_image(CAMERA), frontal_pose, CAMERA)
        plain, lit = (reference_view_of(loaded, "raster", light) for light in (None, lens_shading_of(loaded)))
        with ExitStack() as opened:
            unlit, raster, cycles = (
                opened.enter_context(opened_engine(engine, surface_of(source, mode), CAMERA))
                for engine, source in (("raster", plain), ("raster", lit), ("cycles", lit))
            )
            for pose in (frontal_pose, oblique_pose):
                views = unlit(pose), raster(pose), cycles(pose)
                assert_those_of_cycles(views[1], views[2], CAMERA)
                for name in ("depth_mm", "source", "near_unseen"):
                    np.testing.assert_array_equal(getattr(views[0], name), getattr(views[1], name))
            if mode == "projective":
                for render, bound in ((raster, 1e-5), (cycles, 1 / 255)):
                    view = render(frontal_pose)
                    off = np.abs(view.rgb - loaded.frame.image)[view.observed]
                    assert (off.max(axis=1) > bound).sum() <= FEW * (render is cycles)


@pytest.mark.parametrize("transfer", TRANSFERS)
def test_a_lit_frame_shows_another_pose_as_it_is_lit_there(
    transfer, bumpy_mesh, frontal_pose, oblique_pose, sharp_image, lit_case
):
    """From a surface of known albedo, both views are made, and one of them from the other."""
    albedo, light = 0.25 + 0.5 * sharp_image(CAMERA), replace(LIGHT, transfer=transfer)
    loaded = lit_case(bumpy_mesh, albedo, frontal_pose, CAMERA, light=light)
    painted = reference_view_of(loaded, "raster")
    truth = ColouredSurface(painted.mesh, painted.views, light=lens_shading_of(loaded))
    with opened_engine("raster", truth, CAMERA) as render:
        frame, expected = render(frontal_pose), render(oblique_pose)
    seen = albedo_of(lit_case(bumpy_mesh, frame.rgb, frontal_pose, CAMERA, light=light))
    with opened_engine("raster", ColouredSurface(seen.mesh, seen.views, light=seen.light), CAMERA) as render:
        view = render(oblique_pose)
    both = view.observed & expected.observed
    assert both.sum() > 500
    assert np.abs(view.rgb - expected.rgb)[both].max() < 0.01 / 255


def test_shadows_are_where_rays_say_and_the_frame_comes_back(
    stepped_mesh, frontal_pose, oblique_pose, sharp_image, lit_case
):
    """The step hides a strip from a lamp far beside the lens, to the ambient part exactly; so it does by Cycles."""
    light = LensLight((-120.0, 60.0, 0.0), 0.3, vignetting=1.0)
    loaded = lit_case(stepped_mesh, sharp_image(CAMERA), frontal_pose, CAMERA, light=light)
    seen = albedo_of(loaded, shadows=True)
    bare = ColouredSurface(stepped_mesh, light=replace(seen.light, shadows=False))
    with ExitStack() as opened:
        lit, shadowed, cycles, frame = (
            opened.enter_context(opened_engine(engine, surface, CAMERA))
            for engine, surface in (
                ("raster", bare),
                ("raster", replace(bare, light=seen.light)),
                ("cycles", replace(bare, light=seen.light)),
                ("raster", ColouredSurface(seen.mesh, seen.views, light=seen.light)),
            )
        )
        for pose in (frontal_pose, oblique_pose):
            view, full, other = shadowed(pose), lit(pose), cycles(pose)
            assert np.count_nonzero(np.abs(view.rgb - other.rgb).max(axis=2) > 1 / 255) <= 0.01 * view.mask.sum()
            dark = (view.rgb < full.rgb - 1e-4).any(axis=2)
            assert 10 < dark.sum() < 0.7 * view.mask.sum()
            off_axis = np.linalg.norm(CAMERA.rays_cam(CAMERA.pixel_grid()[dark]), axis=1)
            ambient = codes_from_linear(linear_from_codes(0.5) * 0.3 / off_axis)
            np.testing.assert_allclose(view.rgb[dark], ambient[:, None] + np.zeros(3), atol=1e-5)
            np.testing.assert_array_equal(view.rgb[~dark], full.rgb[~dark])
        back = frame(frontal_pose)
    assert np.abs(back.rgb - loaded.frame.image)[back.observed].max() < 1e-5


@pytest.mark.parametrize("shadows", [False, True])
def test_what_lies_in_the_lamps_shadow_is_filled_and_colours_nothing(shadows, stepped_mesh, frontal_pose, lit_case):
    """Grey steps whose shadow and edges are bright, of light between walls and a backdrop, are grey out of sight."""
    light = LensLight((-120.0, 60.0, 0.0), 0.3)
    loaded = lit_case(stepped_mesh, np.zeros((48, 64, 3), np.float32), frontal_pose, CAMERA, light=light)
    lens = lens_shading_of(loaded, shadows=True)
    looks = [ColouredSurface(stepped_mesh, light=each) for each in (lens, replace(lens, shadows=False))]
    with ExitStack() as opened:
        shadowed, lit = (opened.enter_context(opened_engine("raster", each, CAMERA))(frontal_pose) for each in looks)
    depth = shadowed.depth_mm.astype(np.float32)
    edge = cv2.dilate(depth, np.ones((3, 3))) - cv2.erode(depth, np.ones((3, 3))) > 0.1 * depth.max()
    assert edge.any()
    bright = (shadowed.rgb < lit.rgb - 1e-4) | edge[..., None]
    image = np.where(bright, np.float32(0.9), shadowed.rgb)
    seen = albedo_of(replace(loaded, frames=(replace(loaded.frame, image=image),)), shadows=shadows)
    np.testing.assert_allclose(unseen_colours_of(without_shadows(seen), "fill"), 0.5, atol=1e-3)
    options = DatasetOptions(engine="raster", unseen="fill", light="shadows" if shadows else "lens")
    with ViewRenderer(loaded, seen, options, None) as renderer:
        view = renderer.render(frontal_pose)
    expected = (shadowed if shadows else lit).rgb
    np.testing.assert_allclose(view.rgb[~edge], expected[~edge], atol=2e-3)
    np.testing.assert_array_equal(view.observed[~edge], (shadowed.mask & ~bright[..., 0])[~edge])


def test_a_steep_wall_is_no_edge(frontal_pose, lit_case):
    """At 85 degrees to the rays, less than what counts as seen, it keeps its own colour beside a plate of another."""
    x, y = np.meshgrid([*np.linspace(-20, 0, 21), *np.linspace(0.5, 6, 12)], np.linspace(-15, 15, 31))
    mesh = grid_mesh(x, y, -np.tan(np.radians(85)) * np.maximum(x, 0))
    image = np.full((48, 64, 3), 0.5, np.float32)
    image[:, 31:, 0] = 0.1
    filled = unseen_colours_of(albedo_of(lit_case(mesh, image, frontal_pose, CAMERA)), "fill")
    wall = np.isclose(x, 3).ravel() & (np.abs(y) < 10).ravel()
    assert (filled[wall, 0] < 0.5 * filled[wall, 1]).all()


def test_flipped_faces_are_shaded_as_those_around_them(bumpy_mesh, oblique_pose, rng):
    flipped = bumpy_mesh.faces.copy()
    some = rng.random(len(flipped)) < 0.05
    flipped[some] = flipped[some, ::-1]
    views = []
    for mesh in (bumpy_mesh, bumpy_mesh.flipped(), replace(bumpy_mesh, faces=flipped)):
        with opened_engine("raster", ColouredSurface(mesh, light=LENS), CAMERA) as render:
            views.append(render(oblique_pose).rgb)
    assert np.abs(views[0] - views[1]).max() < 1e-5
    assert np.quantile(np.abs(views[0] - views[2]), 0.9) < 10 / 255


def test_nothing_is_divided_by_less_than_noise_allows(bumpy_mesh, frontal_pose, sharp_image, lit_case, rng):
    dark = LensLight(LIGHT.lamp_cam_mm, 0.0)
    smooth = np.full((*CAMERA.shape_hw, 3), 0.5, np.float32)
    for noise, least in ((0.0, 0.1), (3.6 / 255, 0.147), (0.2, 0.2)):
        image = (smooth + rng.normal(0, noise, smooth.shape)).astype(np.float32)
        found = albedo_of(lit_case(bumpy_mesh, image, frontal_pose, CAMERA, light=dark))
        assert found.light.least == pytest.approx(least, rel=0.25)


def test_what_makes_a_poor_albedo_is_said(bumpy_mesh, frontal_pose, lit_case):
    image = np.full((*CAMERA.shape_hw, 3), 0.5, np.float32)
    assert albedo_of(lit_case(bumpy_mesh, image, frontal_pose, CAMERA)).messages == ()
    image[:, :32] = 1
    said = albedo_of(lit_case(ball(0), image, frontal_pose, CAMERA)).messages
    assert any("% of the surface is saturated" in each for each in said)
    assert any("use a finer surface" in each for each in said)


def test_a_case_without_a_lamp_before_its_surface_is_refused(bumpy_mesh, frontal_pose, sharp_image, lit_case):
    given = bumpy_mesh, sharp_image(CAMERA), frontal_pose, CAMERA
    with pytest.raises(InputError, match=r"case.toml: expected the lamp at the lens.*--light none"):
        albedo_of(lit_case(*given, light=None))
    depth = float(transform_points(frontal_pose, bumpy_mesh.vertices)[:, 2].min())
    with pytest.raises(InputError, match="expected a lamp at the lens, at most a quarter of the way to the surface"):
        lens_shading_of(lit_case(*given, light=LensLight((0.0, 0.0, 0.3 * depth), 0.0)))
    with pytest.raises(InputError, match=r"expected lamp_cam_mm for shadows, found vignetting alone; use --light lens"):
        lens_shading_of(lit_case(*given, light=LensLight(None, 1.0, vignetting=4.0)), shadows=True)
    before = lit_case(*given, light=LensLight((0.0, 0.0, 0.2 * depth), 0.0))
    assert lens_shading_of(before).light == before.case.light
    nearer = replace(before.frame, cam_from_model=rigid(translation=np.array([0, 0, -depth / 2])) @ frontal_pose)
    with pytest.raises(InputError, match="at most a quarter of the way"):
        lens_shading_of(replace(before, frames=(before.frame, nearer)))
    around = rigid(translation=np.array([0, 0, -2 * depth])) @ frontal_pose
    lens_shading_of(lit_case(*given[:2], around, CAMERA))  # the lens is within the surface, the lamp beside it


def test_the_working_distance_is_that_of_what_the_frame_shows(bumpy_mesh, frontal_pose, oblique_pose, lit_case):
    """What else there is of a skull, and where its middle is, change nothing."""
    image, far = np.full((*CAMERA.shape_hw, 3), 0.5, np.float32), np.array([800.0, 0.0, 0.0])
    moved = rigid(translation=far)
    skull = TriangleMesh(
        np.concatenate([bumpy_mesh.vertices + far, bumpy_mesh.vertices + 3 * far]),
        np.concatenate([bumpy_mesh.faces, bumpy_mesh.faces + len(bumpy_mesh.vertices)]),
    )
    alone = lens_shading_of(lit_case(bumpy_mesh, image, frontal_pose, CAMERA))
    part = lens_shading_of(lit_case(skull, image, frontal_pose @ inverse_rigid(moved), CAMERA))
    for pose in (frontal_pose, oblique_pose):
        light, distance_mm = part.at(pose @ inverse_rigid(moved))
        assert light == alone.light
        assert distance_mm == pytest.approx(alone.at(pose)[1])


@pytest.mark.parametrize("part", [0.5, 0.2, 0.06])
def test_however_near_the_lens_is_its_lamp_lights_what_it_sees(part, bumpy_mesh, frontal_pose, lit_case):
    image = np.full((*CAMERA.shape_hw, 3), 0.5, np.float32)
    light = LensLight((-60.0, 40.0, 0.2 * transform_points(frontal_pose, bumpy_mesh.vertices)[:, 2].min()), 0.02)
    seen = albedo_of(lit_case(bumpy_mesh, image, frontal_pose, CAMERA, light=light))
    middle_cam = transform_points(frontal_pose, np.array([seen.light.middle_model]))[0]
    near = rigid(translation=-(1 - part) * middle_cam) @ frontal_pose
    with opened_engine("raster", ColouredSurface(bumpy_mesh, light=seen.light), CAMERA) as render:
        there, here = (linear_from_codes(render(pose).rgb[20:28, 26:34]).mean() for pose in (frontal_pose, near))
    assert here == pytest.approx(there, rel=0.35)


def test_the_light_belongs_to_a_datasets_identity_if_it_is_asked_for(bumpy_mesh, frontal_pose, sharp_image, lit_case):
    def described(light, asked):
        loaded = lit_case(bumpy_mesh, sharp_image(CAMERA), frontal_pose, CAMERA, light=light)
        return describe(loaded, DatasetOptions(light=asked), None, hashes={}, blender="")

    plain, lit = described(LIGHT, "none"), described(LIGHT, "lens")
    assert plain == described(None, "none")
    assert lit["light"] == {"lamp_cam_mm": LIGHT.lamp_cam_mm, "ambient": 0.08, "falloff": 2.0}
    assert lit["options"] == {**plain["options"], "light": "lens"}
