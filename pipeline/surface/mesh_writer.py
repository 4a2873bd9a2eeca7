"""Write triangle meshes as PLY (the model format of BOP) and OBJ.

Texture coordinates are per face corner, ``(F, 3, 2)``, with (0, 0) at the *bottom left* of the image and (1, 1) at its
top right, as in OBJ and in Blender: the centre of pixel (row, column) of an h x w image is
``((column + 0.5) / w, 1 - (row + 0.5) / h)``.
"""

import hashlib
import re
import unicodedata
from pathlib import Path

import numpy as np

from ..files.writing import write_bytes_atomically
from .mesh import TriangleMesh

SAFE_NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]*")
"""Names that every reader finds inside an OBJ, MTL or PLY: MeshLab and bop_toolkit end a name at a space, MeshLab reads
only ASCII in a PLY, Open3D takes a leading hyphen for an option, and Blender drops quotation marks."""

MATERIAL = """\
newmtl surface
Ka 0 0 0
Kd 1 1 1
Ks 0 0 0
illum 1
map_Kd {texture}
"""
"""Without highlights; Blender warns of a material without light (``illum 0``)."""


def texture_path(path: Path) -> Path:
    """The image of a textured OBJ or PLY, named by :func:`safe_name`."""
    return Path(path).with_name(f"{safe_name(Path(path).stem)}.png")


def material_path(path: Path) -> Path:
    """The .mtl file of a textured OBJ, named by :func:`safe_name`."""
    return Path(path).with_name(f"{safe_name(Path(path).stem)}.mtl")


def safe_name(name: str) -> str:
    """The name for a file, without suffix: the same if every reader finds that, or else a similar one of its own."""
    name = unicodedata.normalize("NFC", name)
    if SAFE_NAME.fullmatch(name):
        return name
    # the digest keeps "bone 1" and "bone_1" apart
    digest = hashlib.sha256(name.encode(errors="surrogatepass")).hexdigest()[:8]
    letters = unicodedata.normalize("NFKD", name).encode("ascii", "ignore").decode()
    return "_".join([*re.findall("[A-Za-z0-9]+", letters[:100]), digest])


def write_ply(
    path: Path,
    mesh: TriangleMesh,
    *,
    colours: np.ndarray | None = None,
    normals: np.ndarray | None = None,
    uv: np.ndarray | None = None,
    texture: str | None = None,
    space: str | None = None,
) -> None:
    """Write a binary little endian PLY; the parameters are those of :func:`encoded_ply`.

    Raises
    ------
    OSError
        The file cannot be written.
    """
    data = encoded_ply(mesh, colours=colours, normals=normals, uv=uv, texture=texture, space=space)
    write_bytes_atomically(path, data)


def encoded_ply(
    mesh: TriangleMesh,
    *,
    colours: np.ndarray | None = None,
    normals: np.ndarray | None = None,
    uv: np.ndarray | None = None,
    texture: str | None = None,
    space: str | None = None,
) -> bytes:
    """The bytes of a binary little endian PLY with float32 coordinates, as BOP stores its models (in mm), signed.

    Parameters
    ----------
    colours
        ``(V, 3)`` uint8 RGB, written as ``red green blue``.
    normals
        ``(V, 3)`` unit normals, written as ``nx ny nz``.
    uv
        ``(F, 3, 2)`` texture coordinates, bottom left origin, written per face as ``list uchar float texcoord``.
    texture
        Name of the image in the same folder, written as ``comment TextureFile`` (MeshLab's convention); needs ``uv``
        and a :data:`SAFE_NAME`. Readers without textures, such as Blender and Open3D, show ``colours``.
    space
        "LPS" or "RAS", patient coordinates, written as 3D Slicer does.
    """
    vertex_count, face_count = len(mesh.vertices), len(mesh.faces)
    vertex_fields: list[tuple[str, str] | tuple[str, str, int]] = [("xyz", "<f4", 3)]
    header = ["ply", "format binary_little_endian 1.0"]
    if texture is not None:
        header.append(f"comment TextureFile {texture}")
    if space is not None:
        header.append(f"comment SPACE={space}")
    header += [f"element vertex {vertex_count}", *(f"property float {axis}" for axis in ("x", "y", "z"))]
    if normals is not None:
        vertex_fields.append(("normal", "<f4", 3))
        header += [f"property float {axis}" for axis in ("nx", "ny", "nz")]
    if colours is not None:
        vertex_fields.append(("rgb", "u1", 3))
        header += [f"property uchar {channel}" for channel in ("red", "green", "blue")]
    face_fields = [("count", "u1"), ("indices", "<i4", 3)]
    header += [f"element face {face_count}", "property list uchar int vertex_indices"]
    if uv is not None:
        face_fields += [("uv_count", "u1"), ("uv", "<f4", 6)]
        header.append("property list uchar float texcoord")
    header.append("end_header\n")

    vertices = np.empty(vertex_count, vertex_fields)
    vertices["xyz"] = mesh.vertices
    if normals is not None:
        vertices["normal"] = normals
    if colours is not None:
        vertices["rgb"] = colours
    faces = np.empty(face_count, face_fields)
    faces["count"], faces["indices"] = 3, mesh.faces
    if uv is not None:
        faces["uv_count"], faces["uv"] = 6, uv.reshape(-1, 6)
    return "\n".join(header).encode() + vertices.tobytes() + faces.tobytes()


def write_obj(
    path: Path,
    mesh: TriangleMesh,
    *,
    uv: np.ndarray | None = None,
    texture: str | None = None,
) -> None:
    """Write an OBJ with 9 significant digits per number; with ``texture`` also an .mtl file with an unlit material.

    Parameters
    ----------
    uv
        ``(F, 3, 2)`` texture coordinates, bottom left origin, rounded to float32; equal ones share a line ``vt``.
    texture
        Name of the image in the same folder (``map_Kd``); needs ``uv`` and a :data:`SAFE_NAME`.

    Raises
    ------
    OSError
        A file cannot be written.
    """
    path = Path(path)
    parts: list[str] = []
    if texture is not None:
        material = material_path(path)
        # the mesh comes second, so that it never refers to a missing material
        write_bytes_atomically(material, MATERIAL.format(texture=texture).encode())
        parts += [f"mtllib {material.name}\n", "usemtl surface\n"]
    parts.append(_format_rows("v %.9g %.9g %.9g\n", mesh.vertices))
    corners = mesh.faces + 1
    if uv is None:
        parts.append(_format_rows("f %d %d %d\n", corners))
    else:
        pairs = np.ascontiguousarray(uv.reshape(-1, 2), dtype=np.float32).view(np.uint64)  # one key per (u, v)
        distinct, index = np.unique(pairs.ravel(), return_inverse=True)
        parts.append(_format_rows("vt %.9g %.9g\n", distinct.view(np.float32).reshape(-1, 2)))
        texcoords = index.reshape(-1, 3) + 1
        parts.append(_format_rows("f %d/%d %d/%d %d/%d\n", np.stack([corners, texcoords], axis=2)))
    write_bytes_atomically(path, "".join(parts).encode())


def _format_rows(line_format: str, rows: np.ndarray) -> str:
    """Format all rows in one call, several times faster than row by row."""
    return (line_format * len(rows)) % tuple(rows.ravel().tolist())
