"""Intrinsics through Blender: rendered pixels of every engine."""

import gc

import bpy
import numpy as np
import pytest

from oneframe.blender.bridge.data_blocks import data_blocks
from oneframe.blender.render.engines import opened_engine
from oneframe.camera.pinhole import PinholeCamera
from oneframe.colour.shading import ColouredSurface
from oneframe.errors import InputError
from oneframe.surface.mesh import TriangleMesh
from oneframe.transforms import rigid, rotation_from_vector

CAMERAS = {
    "landscape": PinholeCamera(640, 480, 900.0, 880.0, 333.3, 221.7),
    "portrait": PinholeCamera(300, 400, 1800.0, 2100.0, 120.5, 260.25),
    "square, far off centre": PinholeCamera(256, 256, 1500.0, 1500.0, 20.0, 300.0),
    "long lens": PinholeCamera(640, 480, 12_800.0, 12_790.0, 300.0, 250.0),
    "short lens": PinholeCamera(320, 240, 60.0, 61.0, 150.0, 130.0),
}


EXACT_ENGINES = ("cycles", "raster")


@pytest.mark.render
@pytest.mark.parametrize("name", CAMERAS)
@pytest.mark.parametrize("engine", EXACT_ENGINES)
def test_edges_of_a_rendered_triangle_are_where_k_says(engine, name):
    """Eevee's are in tests/blender/render/test_eevee.py."""
    check_edges_of_a_triangle(engine, CAMERAS[name])


def check_edges_of_a_triangle(engine: str, camera: PinholeCamera) -> None:
    """Every pixel centre more than 0.01 px from an edge is on the right side of it; the closed scene leaves nothing."""
    z = 300.0
    pixels = np.array([[0.11, 0.07], [0.93, 0.21], [0.37, 0.95]]) * camera.size_wh
    corners_cam = camera.rays_cam(pixels) * np.array([[z], [1.1 * z], [0.9 * z]])
    mesh = TriangleMesh(corners_cam, np.array([[0, 2, 1]], np.int32))
    cam_from_model = rigid(rotation_from_vector(np.array([0.3, -0.2, 0.1])), corners_cam.mean(axis=0))
    mesh = TriangleMesh((corners_cam - cam_from_model[:3, 3]) @ cam_from_model[:3, :3], np.array([[0, 2, 1]], np.int32))
    before = set(data_blocks())
    with opened_engine(engine, ColouredSurface(mesh), camera) as render:
        rendered = render(cam_from_model)
    assert set(data_blocks()) == before
    grid = camera.pixel_grid()
    signed = []
    for start, end in ((0, 1), (1, 2), (2, 0)):
        along = pixels[end] - pixels[start]
        normal = np.array([-along[1], along[0]]) / np.linalg.norm(along)
        signed.append((grid - pixels[start]) @ normal)
    distance = np.min(signed, axis=0)
    clear = np.abs(distance) > 0.01
    assert (rendered.mask == (distance > 0))[clear].all()
    # depth: the plane's, everywhere
    a, b, c = corners_cam
    normal = np.cross(b - a, c - a)
    exact = (normal @ a) / (camera.rays_cam(grid.reshape(-1, 2)) @ normal).reshape(camera.shape_hw)
    error = np.abs(rendered.depth_mm - exact)[rendered.mask & clear]
    # a rasteriser's depth buffer has 24 bits for the whole clip range
    assert error.max() < (1e-3 if engine in EXACT_ENGINES else 0.2)


@pytest.mark.render
def test_a_view_of_too_many_pixels_is_refused(bumpy_mesh):
    with pytest.raises(InputError, match="million pixels"):
        opened_engine(
            "cycles", ColouredSurface(bumpy_mesh), PinholeCamera(16384, 8192, 14000.0, 14000.0, 8191.5, 4095.5)
        )


@pytest.mark.render
def test_a_closed_scene_leaves_no_engine_behind(bumpy_mesh, frontal_pose):
    """An engine that outlives its scene reads freed memory when anything is removed later."""
    with opened_engine("cycles", ColouredSurface(bumpy_mesh), CAMERAS["square, far off centre"]) as render:
        render(frontal_pose)
        assert engines_of("CYCLES")
    gc.collect()
    assert not engines_of("CYCLES")


def engines_of(name: str) -> list[bpy.types.RenderEngine]:
    """Blender's own instances of a render engine that is written in Python."""
    kinds = {kind for kind in bpy.types.RenderEngine.__subclasses__() if getattr(kind, "bl_idname", None) == name}
    # isinstance would ask the objects themselves, of which some are left of operators that are gone
    return [found for found in gc.get_objects() if type(found) in kinds]
