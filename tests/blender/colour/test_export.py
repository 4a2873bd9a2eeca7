"""Exported surfaces, read by another library: geometry in the given frame, colours as in the frame's photograph."""

import json
import struct
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from oneframe.blender.colour.export import export_coloured_surface
from oneframe.camera.pinhole import PinholeCamera
from oneframe.case.loaded_case import LoadedCase
from oneframe.images.pixel_values import sample_bilinear
from oneframe.surface.mesh_reader import stated_space
from oneframe.surface.mesh_writer import write_ply
from oneframe.transforms import rigid, transform_points

trimesh = pytest.importorskip("trimesh")
pytestmark = pytest.mark.render

CAMERA = PinholeCamera(160, 120, 800.0, 790.0, 75.5, 62.25)


@pytest.fixture
def loaded(bumpy_mesh, frontal_pose, loaded_case) -> LoadedCase:
    v, u = np.mgrid[: CAMERA.height, : CAMERA.width]
    image = np.stack([u / 160, v / 120, 0.5 + 0.4 * np.sin((u + v) / 9)], -1).astype(np.float32)
    mesh_from_model = rigid(translation=np.array([100.0, -50.0, 30.0]))
    loaded = loaded_case(bumpy_mesh, image, frontal_pose, CAMERA, mesh_from_model=mesh_from_model, mm_per_unit=1000.0)
    write_ply(loaded.case.mesh, bumpy_mesh, space="RAS")
    return loaded


def glb_colours(path: Path) -> np.ndarray:
    """``(V, 3)`` COLOR_0 of the only primitive, straight from the buffer (trimesh drops it if there is a material)."""
    data = path.read_bytes()
    (length,) = struct.unpack_from("<I", data, 12)
    tables, start = json.loads(data[20 : 20 + length]), 28 + length
    accessor = tables["accessors"][tables["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"]]
    view = tables["bufferViews"][accessor["bufferView"]]
    dtype = {5121: np.uint8, 5123: np.uint16, 5126: np.float32}[accessor["componentType"]]
    channels = {"VEC3": 3, "VEC4": 4}[accessor["type"]]
    values = np.frombuffer(data, dtype, accessor["count"] * channels, start + view.get("byteOffset", 0))
    return values.reshape(-1, channels)[:, :3]


@pytest.mark.parametrize(("name", "colour"), [("s.obj", "texture"), ("s.glb", "vertex"), ("s.ply", "vertex")])
def test_points_of_the_file_have_the_colours_of_the_frame(loaded, tmp_path, name, colour):
    path = tmp_path / "out" / name
    export_coloured_surface(loaded, path, colour=colour)
    assert name != "s.ply" or stated_space(path) == "RAS"
    read = trimesh.load(path, force="mesh", process=False)
    given = np.asarray(read.vertices)
    # GLB: metres with y up
    given = 1000 * (given[:, [0, 2, 1]] * [1, -1, 1] if name.endswith(".glb") else given)
    model = given - loaded.surface.mesh_from_model[:3, 3]
    pixels = CAMERA.project(transform_points(loaded.frame.cam_from_model, model))
    inside = ((pixels > 1) & (pixels < [158, 118])).all(axis=1)
    expected = sample_bilinear(loaded.frame.image, np.where(inside[:, None], pixels, 0))
    if colour == "texture":
        picture = np.asarray(read.visual.material.image.convert("RGB"))
        texels = read.visual.uv * [1, -1] * picture.shape[1::-1] + [-0.5, picture.shape[0] - 0.5]
        found = sample_bilinear(picture.astype(float), texels) / 255
    else:
        glb = name.endswith(".glb")
        stored = glb_colours(path) if glb else np.asarray(read.visual.vertex_colors)[:, :3]
        found = stored / (np.iinfo(stored.dtype).max if stored.dtype.kind == "u" else 1)
        if glb:
            found = np.where(found <= 0.0031308, found * 12.92, 1.055 * found ** (1 / 2.4) - 0.055)
    assert inside.mean() > 0.3
    error = np.abs(found - expected)[inside].max(axis=1)
    # neutral where a hill hides the point; else the frame's colour, to the precision of 8 bits (dark linear ones: less)
    assert (error < 0.02).mean() > 0.9
    assert np.abs(model - loaded.surface.mesh.vertices.mean(axis=0)).max() < 60


def test_a_filled_surface_has_no_grey(loaded, tmp_path):
    """The frame in shades far from grey; what a hill hides and what is outside the frame has them too."""
    frame = replace(loaded.frame, image=(0.75 + 0.2 * loaded.frame.image).astype(np.float32))
    lowest = {}
    for unseen in ("neutral", "fill"):
        path = tmp_path / unseen / "s.ply"
        export_coloured_surface(replace(loaded, frames=(frame,)), path, colour="vertex", unseen=unseen)
        read = trimesh.load(path, force="mesh", process=False)
        lowest[unseen] = np.asarray(read.visual.vertex_colors)[:, :3].min() / 255
    assert lowest["neutral"] < 0.6
    assert lowest["fill"] > 0.7
