import numpy as np
import pytest

from oneframe.camera.pinhole import PinholeCamera
from oneframe.colour.source_view import SourceView
from oneframe.colour.texture_atlas import bake_atlas, classify_faces
from oneframe.colour.vertex_colours import NEUTRAL
from oneframe.projection.z_buffer import rasterise_depth
from oneframe.surface.mesh import TriangleMesh
from oneframe.transforms import camera_centre, rigid, rotation_from_vector, transform_points
from tests.colour.test_source_view import Points, ball
from tests.conftest import grid_mesh, joined

CAMERA = PinholeCamera(160, 120, 500.0, 510.0, 78.3, 60.9)
CAM_FROM_MODEL = rigid(translation=np.array([0, 0, 200.0]))


def height_field(columns, rows, half_width, half_height, z_of_xy):
    """A height field over the model's xy plane, its front towards -z (towards the camera)."""
    x, y = np.meshgrid(
        np.linspace(-half_width, half_width, columns + 1), np.linspace(-half_height, half_height, rows + 1)
    )
    mesh = grid_mesh(x, y, z_of_xy(x, y))
    return TriangleMesh(mesh.vertices, mesh.faces[:, [0, 2, 1]])


def microscope_like(camera, rng):
    """Smooth shading, noise of a few pixels, and sharp edges."""
    u, v = camera.pixel_grid()[..., 0], camera.pixel_grid()[..., 1]
    noise = rng.normal(0, 1, (*camera.shape_hw, 3))
    for axis in (0, 1):
        noise = sum(np.roll(noise, shift, axis) for shift in (-2, -1, 0, 1, 2)) / np.sqrt(5)
    vessels = ((np.sin(u / 9 + np.sin(v / 17)) > 0.8) | (np.cos(v / 13 + u / 40) > 0.9))[..., None] * [0.3, -0.2, -0.2]
    shading = 0.5 + 0.2 * np.cos((u - 70) / 90)[..., None] * np.cos((v - 50) / 70)[..., None]
    return np.clip(shading + vessels + 0.04 * noise, 0, 1).astype(np.float32)


def bilinear(image, x, y):
    """Independent of the code under test; coordinates must be inside."""
    j, i = np.floor(y).astype(int), np.floor(x).astype(int)
    j, i = np.clip(j, 0, image.shape[0] - 2), np.clip(i, 0, image.shape[1] - 2)
    s, t = x - i, y - j
    weights = (((1 - s) * (1 - t), 0, 0), (s * (1 - t), 0, 1), ((1 - s) * t, 1, 0), (s * t, 1, 1))
    return sum(w.reshape(-1, *[1] * (image.ndim - 2)) * image[j + dj, i + di] for w, dj, di in weights)


class SurfacePoints(Points):
    def look_up(self, atlas):
        """What a renderer shows: colour and flag at the UV interpolated in single precision."""
        corners = atlas.uv.astype(np.float32)[self.face].astype(np.float64)
        u, v = np.einsum("nk,nkd->nd", self.weights, corners).T
        height, width = atlas.observed.shape
        x, y = u * width - 0.5, (1 - v) * height - 0.5
        return bilinear(atlas.image, x, y), bilinear(atlas.observed.astype(float), x, y) >= 1 - 1e-4

    def sampled_directly(self, image, camera, cam_from_model):
        pixels = camera.project(transform_points(cam_from_model, self.points))
        inside = ((pixels >= 0) & (pixels <= np.array(camera.size_wh) - 1)).all(axis=1)
        colour = np.full((len(pixels), image.shape[2]), np.nan)
        colour[inside] = bilinear(image, *pixels[inside].T)
        return colour, inside


def facing_rule(camera, cam_from_model):
    """In the frame and turned to it: visibility on a surface that does not hide itself."""

    def observed(points, normals):
        with np.errstate(invalid="ignore"):
            pixels = camera.project(transform_points(cam_from_model, points))
            inside = ((pixels >= -1e-6) & (pixels <= np.array(camera.size_wh) - 1 + 1e-6)).all(axis=1)
        to_camera = camera_centre(cam_from_model) - points
        cosine = (to_camera * normals).sum(axis=1) / np.linalg.norm(to_camera, axis=1)
        return inside & (cosine > 0.1)

    return observed


def bake(mesh, image, observed, camera=CAMERA, cam_from_model=CAM_FROM_MODEL, **options):
    class Ruled(SourceView):
        def observed(self, points_model, normals_model):
            return observed(points_model, normals_model)

    everywhere = np.ones(camera.shape_hw, np.float32)
    view = Ruled(image, everywhere > 0, camera, cam_from_model, inverse_depth=everywhere)
    seen = classify_faces(mesh, camera, cam_from_model, observed)
    atlas = bake_atlas(mesh, [view], [seen], **options)
    assert atlas.uv.shape == (len(mesh.faces), 3, 2)
    assert atlas.uv.min() >= 0
    assert atlas.uv.max() <= 1
    assert np.isfinite(atlas.image).all()
    assert atlas.image.dtype == np.float32
    assert (atlas.image[~atlas.observed] == np.float32(NEUTRAL)).all()
    assert sum(atlas.faces_seen) == len(mesh.faces)
    return atlas, seen


def test_fronto_parallel_plane_is_lossless():
    rng = np.random.default_rng(1)
    image = rng.uniform(0, 1, (*CAMERA.shape_hw, 3)).astype(np.float32)
    mesh = height_field(90, 70, 40, 30, lambda x, y: 0 * x)  # larger than the frame
    observed = facing_rule(CAMERA, CAM_FROM_MODEL)
    atlas, seen = bake(mesh, image, observed)
    assert atlas.separate_charts == 0
    points = SurfacePoints(mesh, 30000, rng)
    colour, flag = points.look_up(atlas)
    expected, inside = points.sampled_directly(image, CAMERA, CAM_FROM_MODEL)
    np.testing.assert_array_equal(flag, inside)
    # single-precision UV: 1e-5 px on noise of full contrast
    np.testing.assert_allclose(colour[inside], expected[inside], atol=2e-5)
    assert set(np.unique(seen)) == {0, 1, 2}


def test_large_slanted_triangles_keep_perspective():
    rng = np.random.default_rng(4)
    image = microscope_like(CAMERA, rng)
    mesh = height_field(1, 1, 30, 14, lambda x, y: 1.5 * x)
    points = SurfacePoints(mesh, 30000, rng)
    atlas, _ = bake(mesh, image, facing_rule(CAMERA, CAM_FROM_MODEL))
    assert atlas.separate_charts == 2
    colour, flag = points.look_up(atlas)
    expected, inside = points.sampled_directly(image, CAMERA, CAM_FROM_MODEL)
    assert flag[inside].mean() > 0.97
    error = np.abs(colour - expected)[flag & inside].mean()
    # the naive map: UV = projected corners, interpolated affinely
    pixels = CAMERA.project(transform_points(CAM_FROM_MODEL, mesh.vertices))[mesh.faces[points.face]]
    affine = np.einsum("nk,nkd->nd", points.weights, pixels)
    usable = flag & inside & ((affine >= 0) & (affine <= np.array(CAMERA.size_wh) - 1)).all(axis=1)
    naive = np.abs(bilinear(image, *affine[usable].T) - expected[usable]).mean()
    assert error < 0.6 / 255
    assert naive > 40 * error


@pytest.mark.parametrize("cells", [(150, 120), (1, 1)], ids=["fine", "two triangles"])
def test_flags_follow_the_visibility_rule_of_the_project(cells):
    """Atlas flags are never wider than the rule at the point itself, and narrower only within a pixel of a rim."""
    rng = np.random.default_rng(6)
    pose = rigid(rotation_from_vector(np.array([0.3, -0.4, 0.1])), np.array([0, 0, 200.0]))
    plane = height_field(*cells, 40, 30, lambda x, y: 1.5 * np.sin(x / 3) * np.cos(y / 4))
    mesh = joined(plane, ball(60, 6.0, [3, -2, -45]))
    inverse = rasterise_depth(mesh, CAMERA, pose).inverse_depth.astype(np.float32)
    image = microscope_like(CAMERA, rng)
    source = SourceView(image, np.ones(CAMERA.shape_hw, bool), CAMERA, pose, inverse_depth=inverse)
    atlas, _ = bake(mesh, image, source.observed, cam_from_model=pose)
    points = SurfacePoints(mesh, 40000, rng)
    colour, flag = points.look_up(atlas)
    expected, inside = points.sampled_directly(image, CAMERA, pose)
    rule = source.observed(points.points, points.normals)
    assert 0.3 < rule.mean() < 0.9
    assert (flag & ~rule).mean() < 2e-4
    assert (rule & ~flag).mean() < 0.02
    assert np.abs(colour - expected)[flag & rule & inside].mean() < 0.5 / 255


@pytest.mark.parametrize("slope", [-2.5, 2.5])
def test_no_seam_along_a_crease_between_separate_charts(slope):
    """Two large faces of a ridge or valley: texels beyond the crease leave the surface, lookups at it stay observed."""
    rng = np.random.default_rng(9)
    mesh = height_field(2, 1, 10, 9, lambda x, y: slope * np.abs(x))
    across = np.abs(CAMERA.rays_cam(CAMERA.pixel_grid())[..., 0])
    inverse_depth = ((1 - slope * across) / 200).astype(np.float32)
    image = microscope_like(CAMERA, rng)
    source = SourceView(image, np.ones(CAMERA.shape_hw, bool), CAMERA, CAM_FROM_MODEL, inverse_depth=inverse_depth)
    atlas, seen = bake(mesh, image, source.observed)
    assert atlas.separate_charts == 4
    assert seen.all()
    points = SurfacePoints(mesh, 40000, rng)
    colour, flag = points.look_up(atlas)
    rule = source.observed(points.points, points.normals)
    at_crease = rule & (np.abs(points.points[:, 0]) < 0.3) & (np.abs(points.points[:, 1]) < 8)
    assert at_crease.sum() > 300
    assert flag[at_crease].mean() > 0.95
    expected, _ = points.sampled_directly(image, CAMERA, CAM_FROM_MODEL)
    assert np.abs(colour - expected)[flag & at_crease].mean() < 1 / 255


def test_floor_that_passes_under_the_camera():
    """Corners behind the camera have no projection: the chart is the unfolded face."""
    rng = np.random.default_rng(8)
    vertices = np.array([[-900.0, 120, -600], [900, 120, -600], [900, 120, 900], [-900, 120, 900]])
    mesh = TriangleMesh(vertices, np.array([[0, 1, 2], [0, 2, 3]], np.int32))
    camera = PinholeCamera(160, 120, 100.0, 100.0, 80, 20)
    u = camera.pixel_grid()[..., :1] / 160
    image = np.concatenate([u, 1 - u, 0.5 * u], axis=-1).astype(np.float32)  # smooth: survives coarse texels
    atlas, seen = bake(mesh, image, facing_rule(camera, CAM_FROM_MODEL), camera)
    assert (seen == 1).all()
    points = SurfacePoints(mesh, 30000, rng)
    colour, flag = points.look_up(atlas)
    expected, inside = points.sampled_directly(image, camera, CAM_FROM_MODEL)
    assert flag[inside].mean() > 0.5
    assert not flag[~inside].any()
    assert np.abs(colour - expected)[flag].max() < 3 / 255
