"""Meshes on the GPU: uploaded once, so that moving the object changes only a matrix.

Blender reports when a mesh may have changed (edits, undo, opening a file); it is then uploaded again.
"""

from dataclasses import dataclass

import bpy
import gpu
import numpy as np
from bpy.app.handlers import persistent
from gpu_extras.batch import batch_for_shader

from ..class_registration import at_end, listening
from .overlay_shaders import surface_shader

SHARP = np.cos(np.radians(40.0))
"""Cosine of an angle: corners whose face normal differs by more from the vertex normal get the face normal."""


@dataclass(frozen=True)
class DrawnMesh:
    """A mesh on the GPU, its batch for :func:`.surface_shader`, and the median length of its edges, mm."""

    batch: gpu.types.GPUBatch
    edge_mm: float


_drawn: dict[int, DrawnMesh] = {}


def drawn_mesh(mesh: bpy.types.Mesh) -> DrawnMesh | None:
    """The mesh on the GPU, uploaded if necessary; ``None`` for a mesh without faces."""
    key = mesh.session_uid
    # Edit mode works on a copy: this mesh is unchanged, and cannot be read
    if key not in _drawn and not mesh.is_editmode and (faces := _triangles(mesh)).size:
        _drawn[key] = _uploaded(mesh, faces)
    return _drawn.get(key)


def _triangles(mesh: bpy.types.Mesh) -> np.ndarray:
    """``(N, 3)`` vertices of the triangles."""
    mesh.calc_loop_triangles()
    faces = np.empty(3 * len(mesh.loop_triangles), np.int32)
    mesh.loop_triangles.foreach_get("vertices", faces)
    return faces.reshape(-1, 3)


def _uploaded(mesh: bpy.types.Mesh, faces: np.ndarray) -> DrawnMesh:
    vertices: np.ndarray = np.empty((len(mesh.vertices), 3), np.float32)
    mesh.attributes["position"].data.foreach_get("vector", vertices.reshape(-1))
    normals: np.ndarray = np.empty_like(vertices)
    mesh.vertex_normals.foreach_get("vector", normals.reshape(-1))
    # of a sample, for speed
    corners = vertices[faces[:: len(faces) // 10_000 + 1]]
    edge_mm = float(np.median(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)))
    vertices, normals, faces = _split_at_sharp_edges(vertices, normals, faces)
    fields = {"position": vertices, "normal": normals}
    return DrawnMesh(batch_for_shader(surface_shader("BONE"), "TRIS", fields, indices=faces), edge_mm)


def _split_at_sharp_edges(
    vertices: np.ndarray, normals: np.ndarray, faces: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Give each corner at a sharp edge a separate vertex with the normal of its face."""
    a, b, c = (vertices[faces[:, corner]] for corner in range(3))
    face_normals = np.cross(b - a, c - a)
    length = np.linalg.norm(face_normals, axis=1, keepdims=True)
    face_normals = np.divide(face_normals, length, out=np.zeros_like(face_normals), where=length > 0)
    cosines = np.stack([np.einsum("ij,ij->i", face_normals, normals[faces[:, corner]]) for corner in range(3)], axis=1)
    sharp = (cosines < SHARP) & (length > 0)
    split = faces[sharp]
    faces = faces.copy()
    faces[sharp] = len(vertices) + np.arange(len(split), dtype=np.int32)
    face, _ = np.nonzero(sharp)
    return np.concatenate([vertices, vertices[split]]), np.concatenate([normals, face_normals[face]]), faces


@persistent
def _after_update(_scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
    for update in depsgraph.updates if depsgraph.id_type_updated("MESH") else ():
        if isinstance(update.id, bpy.types.Mesh):
            _drawn.pop(update.id.original.session_uid, None)


@persistent
def _after_undo(*_: object) -> None:
    _drawn.clear()


PARTS = (
    at_end(_drawn.clear),
    listening(bpy.app.handlers.depsgraph_update_post, _after_update),
    listening(bpy.app.handlers.undo_post, _after_undo),
    listening(bpy.app.handlers.redo_post, _after_undo),
    listening(bpy.app.handlers.load_post, _after_undo),
)
