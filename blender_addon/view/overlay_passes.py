"""Renders the surface's contour and its structures at a view's resolution, into textures.

Three passes: the surface's geometry (normal and depth in view axes); edges in the geometry (steps of the depth, changes
of the normal); the ridges of the edge strength as lines one pixel wide, at any zoom. Structures, which lie inside the
surface, have a texture of their own, where they are fainter behind the surface.

Meshes are uploaded to the GPU once, so that moving an object changes only a matrix. Blender reports when a mesh may
have changed (edits, undo, opening a file); it is then uploaded again.
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import bpy
import gpu
import numpy as np
from bpy.app.handlers import persistent
from gpu_extras.batch import batch_for_shader
from mathutils import Matrix

from ..class_registration import at_end, listening
from .overlay_shaders import edges_shader, lines_shader, rectangle, surface_shader

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


MAX_SLOPE = 4.0
"""Depth per lateral distance; steeper steps are occluding contours: surface seen at less than 14 degrees."""

MIN_STEP_EDGES = 2.0
"""Least depth of a step, in edge lengths of the mesh; smaller steps are its roughness."""

CREASE_DEG = 60.0
"""Least change of the surface's normal that counts as a crease."""

CREASE_RADIUS_PX = 3.0
"""Radius of the disc within which a crease changes the normal, in pixels of the frame; finer changes are roughness."""

STRUCTURE_ALPHA, HIDDEN_ALPHA = 0.95, 0.4
"""Opacity of structures that are in view, and of those behind the surface."""


@dataclass(frozen=True)
class Projection:
    """The projection of a region of ``width`` x ``height`` px.

    Attributes
    ----------
    view_from_world, clip_from_view
        ``(4, 4)``, in OpenGL's convention.
    frame_mm_per_px
        Size of a frame's pixel per mm of depth (1 / f); 0 in views other than the camera's.
    """

    width: int
    height: int
    view_from_world: Matrix
    clip_from_view: Matrix
    frame_mm_per_px: float = 0.0

    @property
    def mm_per_px(self) -> tuple[float, float]:
        """Size of a pixel on the surface: per mm of depth (perspective), and at any depth (parallel projection)."""
        size = 2.0 / (self.clip_from_view[0][0] * self.width)
        return (0.0, size) if self.clip_from_view[3][3] else (max(size, self.frame_mm_per_px), 0.0)

    @property
    def magnification(self) -> float:
        """This view's pixels per pixel of the frame; 1 in views other than the camera's."""
        if not self.frame_mm_per_px:
            return 1.0
        return self.frame_mm_per_px * self.clip_from_view[0][0] * self.width / 2

    def key(self) -> tuple:
        """A key that is equal for equal projections."""
        rows = (*self.view_from_world, *self.clip_from_view)
        return self.width, self.height, self.frame_mm_per_px, *(value for row in rows for value in row)


class SurfacePicture:
    """The textures of one view, kept until its size changes and drawn again only if something in it has changed.

    Attributes
    ----------
    geometry
        Normal in view axes, and depth in mm; depth 0 beside the surface.
    structures
        RGBA, code values; alpha :data:`STRUCTURE_ALPHA`, :data:`HIDDEN_ALPHA` behind the surface, 0 elsewhere.
    lines
        Contour lines one pixel wide, 0..1; red: occluding contours, green: creases.
    """

    def __init__(self, width: int, height: int) -> None:
        self.size = (width, height)
        self._key: tuple = ()
        self._has_lines = False
        self.structures = gpu.types.GPUTexture(self.size, format="RGBA8")
        self.geometry = gpu.types.GPUTexture(self.size, format="RGBA32F")
        self._edges = gpu.types.GPUTexture(self.size, format="RGBA16F")
        self.lines = gpu.types.GPUTexture(self.size, format="RGBA8")
        # kept in an attribute: a framebuffer does not keep its textures alive
        self._depth = depth = gpu.types.GPUTexture(self.size, format="DEPTH_COMPONENT32F")
        self._surface_target = gpu.types.GPUFrameBuffer(depth_slot=depth, color_slots=(self.geometry,))
        self._structure_target = gpu.types.GPUFrameBuffer(depth_slot=depth, color_slots=(self.structures,))
        self._edges_target = gpu.types.GPUFrameBuffer(color_slots=(self._edges,))
        self._lines_target = gpu.types.GPUFrameBuffer(color_slots=(self.lines,))

    def draw(self, projection: Projection, surface: bpy.types.Object, *, contour: bool) -> None:
        """Update the textures, and the lines if the contour is wanted."""
        mesh = drawn_mesh(surface.data)
        structures = [(child, drawn_mesh(child.data)) for child in shown_structures(surface)]
        key = (
            projection.key(),
            _drawing_key(surface, mesh),
            *((_drawing_key(child, structure), child.show_in_front) for child, structure in structures),
        )
        with _without_blending():
            if key != self._key:
                self._draw_surface(projection, surface, mesh)
                self._draw_structures(projection, structures)
                self._key, self._has_lines = key, False
            if contour and not self._has_lines:
                self._find_lines(projection, 0.0 if mesh is None else MIN_STEP_EDGES * mesh.edge_mm)
                self._has_lines = True

    def _draw_surface(self, projection: Projection, surface: bpy.types.Object, mesh: DrawnMesh | None) -> None:
        with self._surface_target.bind():
            self._surface_target.clear(color=(0.0, 0.0, 0.0, 0.0), depth=1.0)
            gpu.state.depth_test_set("LESS")
            gpu.state.depth_mask_set(True)
            if mesh is not None:
                shader = surface_shader("BONE")
                shader.bind()
                shader.uniform_float("view_from_model", projection.view_from_world @ surface.matrix_world)
                shader.uniform_float("clip_from_view", projection.clip_from_view)
                mesh.batch.draw(shader)

    def _draw_structures(
        self, projection: Projection, structures: list[tuple[bpy.types.Object, DrawnMesh | None]]
    ) -> None:
        with self._structure_target.bind():
            self._structure_target.clear(color=(0.0, 0.0, 0.0, 0.0), depth=1.0)
            gpu.state.depth_test_set("LESS")
            gpu.state.depth_mask_set(True)
            shader = surface_shader("STRUCTURE")
            for child, mesh in structures:
                if mesh is None:
                    continue
                shader.bind()
                shader.uniform_sampler("bone", self.geometry)
                shader.uniform_float("view_from_model", projection.view_from_world @ world_from_structure(child))
                shader.uniform_float("clip_from_view", projection.clip_from_view)
                hidden_alpha = HIDDEN_ALPHA if child.show_in_front else 0.0
                plain = (*child.color[:3], STRUCTURE_ALPHA, hidden_alpha, 0.0, 0.0, 0.0)
                # kept in a variable: the buffer must live until the mesh is drawn
                buffer = gpu.types.GPUUniformBuf(gpu.types.Buffer("FLOAT", 8, plain))
                shader.uniform_block("plain", buffer)
                mesh.batch.draw(shader)
        gpu.state.depth_mask_set(False)
        gpu.state.depth_test_set("NONE")

    def _find_lines(self, projection: Projection, min_step_mm: float) -> None:
        radius_px = max(CREASE_RADIUS_PX * projection.magnification, 2.0)
        with self._edges_target.bind():
            shader = edges_shader()
            shader.bind()
            shader.uniform_float("mm_per_px", projection.mm_per_px)
            shader.uniform_float("max_slope", MAX_SLOPE)
            shader.uniform_float("min_step_mm", min_step_mm)
            shader.uniform_float("radius_px", radius_px)
            shader.uniform_float("magnification", max(projection.magnification, 1.0))
            shader.uniform_sampler("geometry", self.geometry)
            placed_rectangle(shader, (0, 0), self.size, self.size).draw(shader)
        with self._lines_target.bind():
            shader = lines_shader()
            shader.bind()
            shader.uniform_float("crease_rad", np.radians(CREASE_DEG))
            shader.uniform_int("ridge_px", min(max(round(0.5 * radius_px), 1), 32))
            shader.uniform_sampler("edges", self._edges)
            placed_rectangle(shader, (0, 0), self.size, self.size).draw(shader)


def shown_structures(surface: bpy.types.Object) -> list[bpy.types.Object]:
    """The structures in a surface that the user has not switched off."""
    return [child for child in surface.children if child.type == "MESH" and not child.hide_viewport]


def world_from_structure(structure: bpy.types.Object) -> Matrix:
    """``(4, 4)`` placement of a child of the surface; Blender does not keep that of hidden objects up to date."""
    parent = structure.parent
    if parent is None:
        return structure.matrix_world
    return parent.matrix_world @ structure.matrix_parent_inverse @ structure.matrix_basis


def placed_rectangle(
    shader: gpu.types.GPUShader, low: Sequence[float], high: Sequence[float], target: Sequence[float]
) -> gpu.types.GPUBatch:
    """A filled rectangle between two corners, in pixels of a target of size ``target``; ``at`` is the pixel."""
    corners = np.array([(low[0], low[1]), (high[0], low[1]), (high[0], high[1]), (low[0], high[1])], float)
    return rectangle(shader, 2 * corners / np.array(target) - 1, corners)


def _drawing_key(drawn: bpy.types.Object, mesh: DrawnMesh | None) -> tuple:
    return mesh, tuple(value for row in world_from_structure(drawn) for value in row), tuple(drawn.color[:3])


@contextmanager
def _without_blending() -> Iterator[None]:
    """No blending while textures are drawn; restores blending and depth test afterwards."""
    blend, depth, mask = gpu.state.blend_get(), gpu.state.depth_test_get(), gpu.state.depth_mask_get()
    gpu.state.blend_set("NONE")
    yield
    gpu.state.blend_set(blend)  # type: ignore[arg-type]  # as it was read
    gpu.state.depth_test_set(depth)  # type: ignore[arg-type]  # as it was read
    gpu.state.depth_mask_set(mask)


PARTS = (
    at_end(_drawn.clear),
    listening(bpy.app.handlers.depsgraph_update_post, _after_update),
    listening(bpy.app.handlers.undo_post, _after_undo),
    listening(bpy.app.handlers.redo_post, _after_undo),
    listening(bpy.app.handlers.load_post, _after_undo),
)
