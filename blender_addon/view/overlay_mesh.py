"""Meshes on the GPU: uploaded once, so that moving the object changes only a matrix.

Blender reports when a mesh may have changed (edits, undo, opening a file). Its content is then compared by checksum
with the uploaded mesh, and uploaded again only if it differs.
"""

import zlib
from dataclasses import dataclass

import bpy
import gpu
import numpy as np
from bpy.app.handlers import persistent
from gpu_extras.batch import batch_for_shader
from mathutils import Matrix

from ..class_registration import at_end, listening
from .overlay_shaders import surface_shader

SHARP = np.cos(np.radians(40.0))
"""Cosine of an angle: corners whose face normal differs by more from the vertex normal get the face normal."""


@dataclass(frozen=True)
class DrawnMesh:
    """A mesh on the GPU.

    Attributes
    ----------
    batch, kind
        For drawing with ``surface_shader(kind)``.
    image
        Name of the texture image, for kind ``TEXTURE``.
    edge_mm
        Median length of the edges: the resolution of the mesh.
    checksum
        Of the mesh's content.
    """

    batch: gpu.types.GPUBatch
    kind: str
    image: str
    edge_mm: float
    checksum: int

    def draw(
        self,
        view_from_model: Matrix,
        clip_from_view: Matrix,
        plain: tuple[float, float, float, float],
        hidden_alpha: float = 0.0,
        bone: gpu.types.GPUTexture | None = None,
    ) -> None:
        """Draw into the active framebuffer; ``plain`` is the RGBA of a mesh without colours.

        With the ``bone``'s geometry, as a structure: its alpha is ``hidden_alpha`` where that lies before it.
        """
        kind = self.kind if bone is None else "STRUCTURE"
        shader = surface_shader(kind)
        shader.bind()
        if bone is not None:
            shader.uniform_sampler("bone", bone)
        elif kind == "TEXTURE":
            shader.uniform_sampler("surface_texture", gpu.texture.from_image(bpy.data.images[self.image]))
        shader.uniform_float("view_from_model", view_from_model)
        shader.uniform_float("clip_from_view", clip_from_view)
        if kind in ("PLAIN", "STRUCTURE"):
            # kept in a variable: the buffer must live until the mesh is drawn
            buffer = gpu.types.GPUUniformBuf(gpu.types.Buffer("FLOAT", 8, (*plain, hidden_alpha, 0.0, 0.0, 0.0)))
            shader.uniform_block("plain", buffer)
        self.batch.draw(shader)

    @property
    def coloured(self) -> bool:
        """Whether the mesh has colours."""
        return self.kind != "PLAIN"


@dataclass(frozen=True)
class _Content:
    """What determines the drawing of a mesh: indexed triangles and their colours or texture coordinates."""

    kind: str
    image: str
    vertices: np.ndarray
    faces: np.ndarray
    corner_values: np.ndarray | None
    vertex_values: np.ndarray | None

    def checksum(self) -> int:
        found = zlib.adler32(f"{self.kind} {self.image}".encode())
        for array in (self.vertices, self.faces, self.corner_values, self.vertex_values):
            if array is not None:
                found = zlib.adler32(array.data, found)
        return found


_drawn: dict[int, DrawnMesh] = {}
_maybe_changed: set[int] = set()
"""Keys of drawn meshes to compare with Blender's before the next drawing."""


def drawn_mesh(mesh: bpy.types.Mesh) -> DrawnMesh | None:
    """The mesh on the GPU, uploaded if necessary; ``None`` for a mesh without faces."""
    key = mesh.session_uid
    uploaded = _drawn.get(key)
    if mesh.is_editmode or (uploaded is not None and key not in _maybe_changed):
        # Edit mode works on a copy: this mesh is unchanged, and cannot be read
        return uploaded
    content = _content(mesh)
    _maybe_changed.discard(key)
    if content is None:
        _drawn.pop(key, None)
        return None
    checksum = content.checksum()
    if uploaded is None or uploaded.checksum != checksum:
        _drawn[key] = DrawnMesh(_batch(content, mesh), content.kind, content.image, _median_edge(content), checksum)
    return _drawn[key]


def _content(mesh: bpy.types.Mesh) -> _Content | None:
    faces = _triangles(mesh)
    if len(faces) == 0:
        return None
    vertices = np.empty(3 * len(mesh.vertices), np.float32)
    mesh.attributes["position"].data.foreach_get("vector", vertices)
    kind, image, corner_values, vertex_values = "PLAIN", "", None, None
    texture = _texture_of(mesh)
    colours = mesh.color_attributes.active_color
    layer = mesh.uv_layers.active
    if texture is not None and layer is not None:
        kind, image = "TEXTURE", texture.name
        corner_values = np.empty(2 * len(mesh.loops), np.float32)
        layer.uv.foreach_get("vector", corner_values)
    elif colours is not None and colours.domain in ("POINT", "CORNER"):
        kind = "COLOURS"
        values = np.empty(4 * len(colours.data), np.float32)
        colours.data.foreach_get("color_srgb", values)
        values = np.ascontiguousarray(values.reshape(-1, 4)[:, :3])
        vertex_values, corner_values = (values, None) if colours.domain == "POINT" else (None, values)
    return _Content(kind, image, vertices, faces, corner_values, vertex_values)


def _triangles(mesh: bpy.types.Mesh) -> np.ndarray:
    if len(mesh.loops) == 3 * len(mesh.polygons):
        # triangles only: much quicker than asking for Blender's triangulation
        faces = np.empty(len(mesh.loops), np.int32)
        mesh.attributes[".corner_vert"].data.foreach_get("value", faces)
        return faces
    mesh.calc_loop_triangles()
    faces = np.empty(3 * len(mesh.loop_triangles), np.int32)
    mesh.loop_triangles.foreach_get("vertices", faces)
    return faces


def _corners(mesh: bpy.types.Mesh) -> np.ndarray:
    if len(mesh.loops) == 3 * len(mesh.polygons):
        return np.arange(len(mesh.loops), dtype=np.int32)
    mesh.calc_loop_triangles()
    corners = np.empty(3 * len(mesh.loop_triangles), np.int32)
    mesh.loop_triangles.foreach_get("loops", corners)
    return corners


def _texture_of(mesh: bpy.types.Mesh) -> bpy.types.Image | None:
    """The texture image of the mesh, ``None`` without image or UV map."""
    if mesh.uv_layers.active is None:
        return None
    for material in mesh.materials:
        if material is None or material.node_tree is None:
            continue
        for node in material.node_tree.nodes:
            if node.bl_idname == "ShaderNodeTexImage" and node.image is not None and node.image.size[0]:
                return node.image
    return None


def _batch(content: _Content, mesh: bpy.types.Mesh) -> gpu.types.GPUBatch:
    vertices, faces = content.vertices.reshape(-1, 3), content.faces.reshape(-1, 3)
    normals: np.ndarray = np.empty(vertices.size, np.float32)
    mesh.vertex_normals.foreach_get("vector", normals)
    normals = normals.reshape(-1, 3)
    values = content.vertex_values
    if content.corner_values is not None:
        values = content.corner_values.reshape(len(mesh.loops), -1)[_corners(mesh)]
        vertices, normals = vertices[faces.ravel()], normals[faces.ravel()]
        faces = np.arange(faces.size, dtype=np.int32).reshape(-1, 3)
    vertices, normals, values, faces = _split_at_sharp_edges(vertices, normals, values, faces)
    fields = {"position": vertices, "normal": normals}
    if values is not None:
        fields["colour" if content.kind == "COLOURS" else "uv"] = values
    fields = {name: np.ascontiguousarray(data, np.float32) for name, data in fields.items()}
    return batch_for_shader(surface_shader(content.kind), "TRIS", fields, indices=np.ascontiguousarray(faces, np.int32))


def _median_edge(content: _Content) -> float:
    # of a sample, for speed
    corners = content.faces.reshape(-1, 3)
    corners = content.vertices.reshape(-1, 3)[corners[:: len(corners) // 10_000 + 1]]
    return float(np.median(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)))


def _split_at_sharp_edges(
    vertices: np.ndarray, normals: np.ndarray, values: np.ndarray | None, faces: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray | None, np.ndarray]:
    """Give each corner at a sharp edge a separate vertex with the normal of its face."""
    a, b, c = (vertices[faces[:, corner]] for corner in range(3))
    face_normals = np.cross(b - a, c - a)
    length = np.linalg.norm(face_normals, axis=1, keepdims=True)
    face_normals = np.divide(face_normals, length, out=np.zeros_like(face_normals), where=length > 0)
    cosines = np.stack([np.einsum("ij,ij->i", face_normals, normals[faces[:, corner]]) for corner in range(3)], axis=1)
    sharp = (cosines < SHARP) & (length > 0)
    if not sharp.any():
        return vertices, normals, values, faces
    face, _ = np.nonzero(sharp)
    split = faces[sharp]
    faces = faces.copy()
    faces[sharp] = len(vertices) + np.arange(len(split), dtype=np.int32)
    if values is not None:
        values = np.concatenate([values, values[split]])
    return np.concatenate([vertices, vertices[split]]), np.concatenate([normals, face_normals[face]]), values, faces


@persistent
def _after_update(_scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
    if depsgraph.id_type_updated("MESH") or depsgraph.id_type_updated("MATERIAL"):
        for update in depsgraph.updates:
            if isinstance(update.id, bpy.types.Mesh):
                _maybe_changed.add(update.id.original.session_uid)
            elif isinstance(update.id, bpy.types.Material):
                _maybe_changed.update(_drawn)


@persistent
def _after_undo(*_: object) -> None:
    _maybe_changed.update(_drawn)
    alive = {mesh.session_uid for mesh in bpy.data.meshes}
    for key in set(_drawn) - alive:
        del _drawn[key]


PARTS = (
    at_end(_drawn.clear, _maybe_changed.clear),
    listening(bpy.app.handlers.depsgraph_update_post, _after_update),
    listening(bpy.app.handlers.undo_post, _after_undo),
    listening(bpy.app.handlers.redo_post, _after_undo),
    listening(bpy.app.handlers.load_post, _after_undo),
)
