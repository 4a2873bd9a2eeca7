"""How the camera view shows surface and frame: drawings agree with K, and no view operator moves an object."""

import bpy
import numpy as np
import pytest
from mathutils import Matrix
from scipy.spatial import KDTree

from blender_addon.ui.frame_view import FrameView
from blender_addon.ui.keymap import MASK_TOOL, PIN_TOOL, binding
from blender_addon.view.overlay import Composite, frame_image_of
from blender_addon.view.overlay_passes import HIDDEN_ALPHA, STRUCTURE_ALPHA, Projection, SurfacePicture
from oneframe.blender.bridge.data_blocks import absolute_path
from oneframe.camera.pinhole import PinholeCamera
from oneframe.images.image_reader import read_image
from tests.codes import codes_from_linear

CAMERA = PinholeCamera(200, 150, 1500.0, 1480.0, 104.5, 70.25)
OPERATORS = ("cycle_opacity", "zoom_frame", "fit_frame")


@pytest.fixture
def gpu_context(addon):
    """Enables drawing without a window."""
    import gpu

    if not hasattr(gpu, "init"):
        pytest.skip("this Blender draws only with a window; see tests/window")
    gpu.init()


def projection_through(camera: PinholeCamera, times: int = 1):
    width, height, near, far = camera.width, camera.height, 1.0, 10_000.0
    clip_from_view = Matrix(
        (
            (2 * camera.fx / width, 0, 1 - 2 * (camera.cx + 0.5) / width, 0),
            (0, 2 * camera.fy / height, 2 * (camera.cy + 0.5) / height - 1, 0),
            (0, 0, -(far + near) / (far - near), -2 * far * near / (far - near)),
            (0, 0, -1, 0),
        )
    )
    return Projection(times * width, times * height, Matrix.Identity(4), clip_from_view, 1 / camera.fx)


def drawn(surface, projection):
    """``(H, W)`` depth in mm, and ``(H, W, 4)`` lines, 0..1, top row first."""
    picture = SurfacePicture(projection.width, projection.height)
    picture.draw(projection, surface, contour=True)
    shape = (projection.height, projection.width, 4)
    geometry, lines = (np.array(each.read(), float).reshape(shape)[::-1] for each in (picture.geometry, picture.lines))
    return geometry[..., 3], lines / 255


def new_object(build):
    import bmesh

    mesh = bpy.data.meshes.new("shape")
    shape = bmesh.new()
    build(shape)
    shape.to_mesh(mesh)
    shape.free()
    found = bpy.data.objects.new("shape", mesh)
    bpy.context.scene.collection.objects.link(found)
    return found


def ball(radius):
    import bmesh

    return new_object(lambda shape: bmesh.ops.create_icosphere(shape, subdivisions=6, radius=radius))


@pytest.mark.gl
def test_contour_of_a_ball_is_its_outline(gpu_context):
    times, radius, centre_cam = 6, 5.0, np.array([0.8, -0.6, 150.0])
    found = ball(radius)
    found.matrix_world = Matrix.Translation(centre_cam * [1, -1, -1])
    depth_mm, lines = drawn(found, projection_through(CAMERA, times))
    v, u = np.mgrid[: times * CAMERA.height, : times * CAMERA.width]
    pixels = (np.stack([u, v], -1) + 0.5) / times - 0.5
    rays = CAMERA.rays_cam(pixels.reshape(-1, 2))
    # angle between ray and the ball's centre, as a distance in pixels from the outline
    along = rays / np.linalg.norm(rays, axis=1, keepdims=True)
    distance = np.linalg.norm(centre_cam)
    inside = np.arcsin(radius / distance) - np.arccos(along @ centre_cam / distance)
    inside_px = (inside * CAMERA.fx * times).reshape(v.shape)
    covered = depth_mm > 0
    assert covered[inside_px > 0.6].all()
    assert not covered[inside_px < -0.6].any()
    line = lines[..., :2].max(axis=-1) > 0.5
    assert (np.abs(inside_px[line]) < 1.6).all()
    # closed: every direction from the middle meets it
    rows, columns = np.nonzero(line)
    angles = np.arctan2(rows - v[covered].mean(), columns - u[covered].mean())
    assert len(np.unique((angles * 50 / np.pi).astype(int))) == 100 - 1


@pytest.mark.gl
def test_creases_of_a_box_are_its_edges(gpu_context):
    import bmesh

    times, half = 6, 4.0
    found = new_object(lambda shape: bmesh.ops.create_cube(shape, size=2 * half))
    rotation = Matrix.Rotation(0.6, 4, "X") @ Matrix.Rotation(0.75, 4, "Y")
    found.matrix_world = Matrix.Translation((0.3, -0.5, -150.0)) @ rotation
    _, lines = drawn(found, projection_through(CAMERA, times))
    edges = [
        np.array([[vertex[axis] for axis in range(3)] for vertex in ends])
        for ends in (
            [found.matrix_world @ found.data.vertices[i].co for i in edge.vertices] for edge in found.data.edges
        )
    ]
    rows, columns = np.nonzero(lines[..., :2].max(axis=-1) > 0.3)
    pixels = (np.stack([columns, rows], -1) + 0.5) / times - 0.5
    steps = np.linspace(0, 1, 400)[:, None]
    on_edges = np.concatenate([(a + steps * (b - a)) for a, b in edges]) * [1, -1, -1]
    seen = CAMERA.project(on_edges)
    nearest, _ = KDTree(seen).query(pixels)
    assert np.percentile(nearest, 98) * times < 1.5
    # the edge nearest to the camera is an inner crease: it is drawn along its whole length, except for its ends
    depth = [-edge[:, 2].mean() for edge in edges]
    inner = CAMERA.project(
        (edges[int(np.argmin(depth))] * [1, -1, -1])[0]
        + steps[80:-80] * np.diff(edges[int(np.argmin(depth))] * [1, -1, -1], axis=0)
    )
    gaps, _ = KDTree(pixels).query(inner)
    assert gaps.max() * times < 2.0


@pytest.mark.gl
def test_frame_is_drawn_with_its_own_code_values(gpu_context, opened):
    import gpu

    image, _ = read_image(frame_path(opened))
    height, width = image.shape[:2]
    camera = PinholeCamera(width, height, 320.0, 318.0, 30.0, 25.5)
    seen = FrameView(camera, np.array([1.0, -1.0]), np.array([0.5, height - 0.5]))
    target = gpu.types.GPUTexture((width, height), format="RGBA32F")
    buffer = gpu.types.GPUFrameBuffer(color_slots=(target,))
    picture = SurfacePicture(width, height)
    with buffer.bind():
        composite = Composite(picture, seen, frame_image_of(opened), 1.0, everywhere=True)
        composite.draw(opened.oneframe_view, (0, 0), (width, height))
    shown = np.array(target.read(), float).reshape(height, width, 4)[::-1, :, :3]
    # the outermost pixels are mixed with the opposite border by some cards' anisotropic filters
    codes = 255 * codes_from_linear(shown)
    np.testing.assert_allclose(codes[1:-1, 1:-1], image[1:-1, 1:-1] * 255, atol=1.01)


def frame_path(scene):
    return absolute_path(scene.oneframe.frame_path)


@pytest.mark.gl
def test_structures_are_fainter_where_the_bone_hides_them(gpu_context):
    """A ball that sticks out of a plate at half its height; its outline is that of K."""
    import bmesh

    plate = new_object(lambda shape: bmesh.ops.create_grid(shape, size=10.0))
    plate.matrix_world = Matrix.Translation((-10.0, 0, -140))
    inside = ball(3.0)
    inside.parent, inside.show_in_front, inside.color = plate, True, (0.0, 1.0, 1.0, 1.0)
    # behind the right edge of the plate
    inside.matrix_basis = Matrix.Translation((10.0, 0, -5.0))
    bpy.context.view_layer.update()
    inside.hide_set(True)
    plate.location.y = 0.5
    bpy.context.view_layer.update()
    projection = projection_through(CAMERA)
    picture = SurfacePicture(projection.width, projection.height)

    def alpha():
        picture.draw(projection, plate, contour=False)
        shape = (projection.height, projection.width, 4)
        return np.array(picture.structures.read(), float).reshape(shape)[::-1] / 255

    found = alpha()
    edge = CAMERA.project(np.array([[0.0, -0.5, 140.0]]))[0, 0]
    v, u = np.mgrid[: CAMERA.height, : CAMERA.width]
    rays = CAMERA.rays_cam(np.stack([u, v], -1).reshape(-1, 2))
    centre = np.array([0.0, -0.5, 145.0])
    along = rays / np.linalg.norm(rays, axis=1, keepdims=True) @ (centre / np.linalg.norm(centre))
    inside_px = ((np.arcsin(3 / np.linalg.norm(centre)) - np.arccos(along)) * CAMERA.fx).reshape(v.shape)
    well_inside = inside_px > 1.0
    np.testing.assert_allclose(found[well_inside & (u < edge - 1), 3], HIDDEN_ALPHA, atol=0.01)
    np.testing.assert_allclose(found[well_inside & (u > edge + 1), 3], STRUCTURE_ALPHA, atol=0.01)
    assert (found[inside_px < -1.0, 3] == 0).all()
    assert (well_inside & (u < edge - 1)).sum() > 1000
    inside.show_in_front = False
    assert (alpha()[well_inside & (u < edge - 1), 3] == 0).all()


def test_view_operators_are_disabled_in_other_views(opened, in_view):
    in_view.region_3d.view_perspective = "PERSP"
    for operator in OPERATORS:
        assert not getattr(bpy.ops.oneframe, operator).poll()
    assert bpy.ops.oneframe.show_frame() == {"FINISHED"}
    assert all(getattr(bpy.ops.oneframe, operator).poll() for operator in OPERATORS)
    opacities = [bpy.ops.oneframe.cycle_opacity() and round(opened.oneframe_view.opacity, 3) for _ in range(8)]
    assert opacities[:4] == opacities[4:]
    assert len(set(opacities)) > 1
    opened.oneframe.surface = None
    assert not any(getattr(bpy.ops.oneframe, operator).poll() for operator in (*OPERATORS, "show_frame"))


def test_a_hint_shows_what_would_act_now(opened, in_view):
    bpy.ops.wm.tool_set_by_id(name="builtin.select_box")
    assert not binding("oneframe.refine")
    bpy.ops.wm.tool_set_by_id(name=PIN_TOOL)
    assert binding("oneframe.refine") == "F"
    assert binding("oneframe.fit_frame") == "Home"
    assert not binding("oneframe.case_frame"), "it is in view"
    in_view.region_3d.view_perspective = "PERSP"
    assert not binding("oneframe.fit_frame")
    bpy.ops.wm.tool_set_by_id(name=MASK_TOOL)
    assert not binding("oneframe.refine")
    opened.oneframe.surface = None
    bpy.ops.wm.tool_set_by_id(name=PIN_TOOL)
    assert not binding("oneframe.refine")
