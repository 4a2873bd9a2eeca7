"""Coloured surfaces, read by programs that others wrote: ``python foreign_meshes.py READER OUT FILE...``.

Each reader runs in a process of its own: MeshLab and Blender bring libraries that do not go together. It writes corners
and colours of file number N to ``OUT/N.npz``; the exit code is 3 if the reader is not installed.
"""

import importlib
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

NOT_INSTALLED = 3


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
    trimesh = importlib.import_module("trimesh")
    mesh = trimesh.load(path, process=False, force="mesh")
    faces = np.asarray(mesh.faces)
    if mesh.visual.kind == "texture":
        material = mesh.visual.material
        image = material.image if hasattr(material, "image") else material.baseColorTexture
        colours = sampled(np.asarray(image) / 255, mesh.visual.uv[faces].mean(axis=1))
    else:
        colours = mesh.visual.vertex_colors[faces][..., :3].mean(axis=1) / 255
    return Read(np.asarray(mesh.vertices)[faces], colours)


def by_meshlab(path: Path) -> Read:
    """Colours of the image that MeshLab holds: an image of its own if it found no texture."""
    pymeshlab = importlib.import_module("pymeshlab")
    meshes = pymeshlab.MeshSet()
    meshes.load_new_mesh(str(path))
    mesh = meshes.current_mesh()
    faces = mesh.face_matrix()
    if mesh.has_wedge_tex_coord():
        (image,) = mesh.textures().values()
        with tempfile.TemporaryDirectory() as folder:
            image.save(f"{folder}/texture.png")
            pixels = cv2.imread(f"{folder}/texture.png")[..., ::-1] / 255
        colours = sampled(pixels, mesh.wedge_tex_coord_matrix().reshape(-1, 3, 2).mean(axis=1))
    else:
        colours = mesh.vertex_color_matrix()[faces][..., :3].mean(axis=1)
    return Read(mesh.vertex_matrix()[faces], colours)


def by_blender(path: Path) -> Read:
    """Blender shows the vertex colours of a PLY: it reads textures of other formats only."""
    bpy = importlib.import_module("bpy")
    bpy.ops.wm.read_factory_settings(use_empty=True)
    importer = {".obj": bpy.ops.wm.obj_import, ".ply": bpy.ops.wm.ply_import, ".glb": bpy.ops.import_scene.gltf}
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


READERS = {"trimesh": by_trimesh, "MeshLab": by_meshlab, "Blender": by_blender, "BOP": by_bop}


def main(name: str, out: str, *files: str) -> int:
    for number, file in enumerate(files):
        try:
            read = READERS[name](Path(file))
        except ImportError as error:
            print(error)
            return NOT_INSTALLED
        np.savez(Path(out) / f"{number}.npz", corners=read.corners, colours=read.colours)
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
