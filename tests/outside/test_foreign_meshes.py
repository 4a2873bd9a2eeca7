"""Coloured surfaces in the eyes of readers that others wrote: Blender, trimesh, BOP's rules."""

import json
import re
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import pytest
import trimesh

from oneframe.images.png import encode_png
from oneframe.surface.mesh import TriangleMesh
from oneframe.surface.mesh_writer import texture_path, write_obj, write_ply
from tests.conftest import grid_mesh
from tests.outside.foreign_datasets import scenes

STEMS = (
    "bone", "Schädel 1", "bone#1 [left]", "two  spaces", "bone (1)", "100%", "it's", 'a "b"', "a&b, c;d", "a.b", "-v",
    "頭骨", "trailing ", "$HOME", "a'b`c", "ÀÉÎ", "e\u0301",
)  # fmt: skip
SIZE = np.array([96, 64])
"""Texels, (width, height)."""


def surface() -> TriangleMesh:
    x, y = np.meshgrid(np.linspace(-3, 3, 13), np.linspace(-2, 2, 9))
    return grid_mesh(x, y, np.sin(x) * np.cos(y))


def picture() -> np.ndarray:
    """``(H, W, 3)`` uint8, a linear ramp in each direction: it does not matter how a reader samples it."""
    v, u = np.mgrid[: SIZE[1], : SIZE[0]]
    return np.stack([2 * u + 20, 3 * v + 10, 0 * u + 90], -1).astype(np.uint8)


def colours_at(points: np.ndarray) -> np.ndarray:
    """Colour 0..1 of points of the surface: the picture is spread over it, its first row at the largest y."""
    uv = (points[..., :2] + [3, 2]) / [6, 4] * 0.9 + 0.05
    u, v = uv[..., 0] * SIZE[0] - 0.5, (1 - uv[..., 1]) * SIZE[1] - 0.5
    return np.stack([2 * u + 20, 3 * v + 10, 0 * u + 90], -1) / 255


def uv_of(mesh: TriangleMesh) -> np.ndarray:
    """Clear of the picture's edges, where readers differ."""
    return ((mesh.vertices[:, :2] + [3, 2]) / [6, 4] * 0.9 + 0.05)[mesh.faces]


def write(path: Path) -> Path:
    """Write the surface with its texture, as ``export_coloured_surface`` does."""
    mesh, image = surface(), texture_path(path)
    image.write_bytes(encode_png(picture()))
    if path.suffix == ".obj":
        write_obj(path, mesh, uv=uv_of(mesh), texture=image.name)
    else:
        rgb = np.rint(255 * np.clip(colours_at(mesh.vertices), 0, 1)).astype(np.uint8)
        write_ply(path, mesh, colours=rgb, normals=mesh.vertex_normals, uv=uv_of(mesh), texture=image.name)
    return path


@dataclass(frozen=True)
class Read:
    """What a reader found: ``(F, 3, 3)`` corners, and ``(F, 3)`` colours 0..1 at the middle of the faces."""

    corners: np.ndarray
    colours: np.ndarray


def sampled(image: np.ndarray, uv: np.ndarray) -> np.ndarray:
    """Colours of an ``(H, W, C)`` image, first row on top, at ``(F, 2)`` coordinates with the origin at the bottom."""
    x, y = uv[:, 0] * image.shape[1] - 0.5, (1 - uv[:, 1]) * image.shape[0] - 0.5
    left = np.clip(np.floor([x, y]).astype(int), 0, np.array([[image.shape[1] - 2], [image.shape[0] - 2]]))
    (dx, dy), (i, j) = np.array([x, y]) - left, left
    top = (1 - dx)[:, None] * image[j, i, :3] + dx[:, None] * image[j, i + 1, :3]
    bottom = (1 - dx)[:, None] * image[j + 1, i, :3] + dx[:, None] * image[j + 1, i + 1, :3]
    return (1 - dy)[:, None] * top + dy[:, None] * bottom


def by_trimesh(path: Path) -> Read:
    mesh = trimesh.load(path, process=False, force="mesh")
    faces = np.asarray(mesh.faces)
    if mesh.visual.kind == "texture":
        material = mesh.visual.material
        image = material.image if hasattr(material, "image") else material.baseColorTexture
        colours = sampled(np.asarray(image) / 255, mesh.visual.uv[faces].mean(axis=1))
    else:
        colours = mesh.visual.vertex_colors[faces][..., :3].mean(axis=1) / 255
    return Read(np.asarray(mesh.vertices)[faces], colours)


def by_blender(path: Path) -> Read:
    """Blender shows the vertex colours of a PLY: it reads textures of other formats only."""
    bpy = pytest.importorskip("bpy")
    bpy.ops.wm.read_factory_settings(use_empty=True)
    importer = {".obj": bpy.ops.wm.obj_import, ".ply": bpy.ops.wm.ply_import}
    options = {".obj": {"forward_axis": "Y", "up_axis": "Z"}}
    importer[path.suffix](filepath=str(path), **options.get(path.suffix, {}))
    (item,) = (item for item in bpy.data.objects if item.type == "MESH")
    mesh = item.data
    mesh.calc_loop_triangles()
    loops = np.array([triangle.loops for triangle in mesh.loop_triangles])
    faces = np.array([triangle.vertices for triangle in mesh.loop_triangles])
    points = np.array([item.matrix_world @ vertex.co for vertex in mesh.vertices])
    if mesh.uv_layers:
        (image,) = (image for image in bpy.data.images if image.type == "IMAGE")
        pixels = np.reshape(image.pixels[:], (image.size[1], image.size[0], 4))[::-1]
        uv = np.array([entry.uv for entry in mesh.uv_layers.active.data])[loops].mean(axis=1)
        colours = sampled(pixels, uv)
    else:
        # code values: the importer takes those of a PLY for sRGB
        stored = np.array([entry.color_srgb for entry in mesh.color_attributes[0].data])
        colours = stored[faces][..., :3].mean(axis=1)
    return Read(points[faces], colours)


def by_bop(path: Path) -> Read:
    """As ``load_ply`` of bop_toolkit_lib/inout.py: four types, no escapes, the last word of a line is the name."""
    data = path.read_bytes()
    end = data.index(b"end_header\n") + len(b"end_header\n")
    header = data[:end].decode().splitlines()
    types = {"float": "<f4", "double": "<f8", "int": "<i4", "uchar": "u1"}
    counts, fields, element, image = {}, {"vertex": [], "face": []}, "", None
    for line in header:
        words = line.split()
        if line.startswith("comment TextureFile"):
            image = words[-1]
        elif words[0] == "element":
            element, counts[words[1]] = words[1], int(words[2])
        elif words[:2] == ["property", "list"]:
            length = {"vertex_indices": 3, "texcoord": 6}[words[-1]]
            fields[element] += [(f"n_{words[-1]}", types[words[2]]), (words[-1], types[words[3]], length)]
        elif words[0] == "property":
            fields[element].append((words[-1], types[words[-2]]))
    vertices = np.frombuffer(data, fields["vertex"], counts["vertex"], end)
    faces = np.frombuffer(data, fields["face"], counts["face"], end + vertices.nbytes)
    assert end + vertices.nbytes + faces.nbytes == len(data)
    corners = np.stack([vertices[axis] for axis in "xyz"], axis=1)[faces["vertex_indices"]]
    assert {"nx", "ny", "nz"} <= set(vertices.dtype.names)
    if image is None:
        rgb = np.stack([vertices[channel] for channel in ("red", "green", "blue")], axis=1) / 255
        return Read(corners, rgb[faces["vertex_indices"]].mean(axis=1))
    pixels = cv2.imread(str(path.parent / image))[..., ::-1] / 255
    return Read(corners, sampled(pixels, faces["texcoord"].reshape(-1, 3, 2).mean(axis=1)))


READERS = {"trimesh": by_trimesh, "Blender": by_blender, "BOP": by_bop}

COMPLAINT = re.compile(r"(?i)warn|error|fail|cannot")


@pytest.fixture
def readings(capfd):
    """What a reader finds in files; the test fails if the reader complains."""

    def read(reader: str, files: list[Path]) -> list[Read]:
        found = [READERS[reader](file) for file in files]
        complaints = [line for line in "".join(capfd.readouterr()).splitlines() if COMPLAINT.search(line)]
        assert not complaints
        return found

    return read


@pytest.mark.parametrize("reader", READERS)
def test_textured_surfaces_are_read_with_their_colours(tmp_path, reader, readings):
    """The same triangles, and the same colours to 8 bits, whatever the name."""
    suffixes = (".ply",) if reader == "BOP" else (".obj", ".ply")
    files = []
    for number, stem in enumerate(STEMS):
        (folder := tmp_path / str(number)).mkdir()
        files += [write(folder / f"{stem}{suffix}") for suffix in suffixes]
        assert {file.stem for file in folder.iterdir()} == {stem, texture_path(files[-1]).stem}
    mesh = surface()
    for file, read in zip(files, readings(reader, files), strict=True):
        assert_same_faces(read, mesh.vertices[mesh.faces])
        error = np.abs(read.colours - colours_at(read.corners.mean(axis=1)))
        assert error.max() < 0.02, file


def assert_same_faces(read: Read, corners: np.ndarray) -> None:
    """The same triangles, whatever their order and first corner."""
    assert read.corners.shape == corners.shape

    def key(triangles: np.ndarray) -> np.ndarray:
        first = np.lexsort(np.moveaxis(np.round(triangles, 3), -1, 0)[::-1], axis=-1)[:, 0]
        turned = np.stack([np.roll(one, -start, axis=0) for one, start in zip(triangles, first, strict=True)])
        return turned[np.lexsort(np.round(turned.reshape(len(turned), -1), 3).T[::-1])]

    np.testing.assert_allclose(key(read.corners), key(corners), atol=1e-4)


@pytest.mark.parametrize("reader", READERS)
def test_models_of_a_dataset_are_read_with_their_colours(rendered_dataset, reader, readings):
    """The colours of ``models/`` are those of the views: a point has in the RGB the colour of its vertices."""
    (read,) = readings(reader, [rendered_dataset / "models" / "obj_000001.ply"])
    ((_, scene),) = scenes(rendered_dataset)
    views = by_view(scene)
    k, pose = views["3"]
    middle = read.corners.mean(axis=1) @ pose[:3, :3].T + pose[:3, 3]
    pixels = np.rint((middle @ k.T)[:, :2] / middle[:, 2:]).astype(int)
    rgb = cv2.imread(str(scene / "rgb" / "000003.png"))[..., ::-1] / 255
    inside = ((pixels > 1) & (pixels < [rgb.shape[1] - 2, rgb.shape[0] - 2])).all(axis=1)
    assert inside.sum() > 500
    found = rgb[pixels[inside, 1], pixels[inside, 0]]
    assert np.median(np.abs(found - read.colours[inside])) < 0.02
    assert np.percentile(np.abs(found - read.colours[inside]), 90) < 0.1


def by_view(scene: Path) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """K and ``cam_from_model`` (3x4) of each view."""
    tables = {name: json.loads((scene / f"scene_{name}.json").read_text()) for name in ("camera", "gt")}
    views = {}
    for image, (truth,) in tables["gt"].items():
        pose = np.column_stack([np.reshape(truth["cam_R_m2c"], (3, 3)), truth["cam_t_m2c"]])
        views[image] = np.reshape(tables["camera"][image]["cam_K"], (3, 3)), pose
    return views
