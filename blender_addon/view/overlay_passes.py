"""Renders the surface's contour and its structures at a view's resolution, into textures.

Three passes: the surface's geometry (normal and depth in view axes); edges in the geometry (steps of the depth, changes
of the normal); the ridges of the edge strength as lines one pixel wide, at any zoom. Structures, which lie inside the
surface, have a texture of their own, where they are fainter behind the surface.
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import bpy
import gpu
import numpy as np
from mathutils import Matrix

from ..ui.rectangle import rectangle
from .overlay_mesh import DrawnMesh, drawn_mesh
from .overlay_shaders import edges_shader, lines_shader, surface_shader

MAX_SLOPE = 4.0
"""Depth per lateral distance; steeper steps are occluding contours: surface seen at less than 14 degrees."""

MIN_STEP_EDGES = 2.0
"""Least depth of a step, in edge lengths of the mesh; smaller steps are its roughness."""

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
        self._lines_key: float | None = None
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

    def draw(self, projection: Projection, surface: bpy.types.Object, crease_deg: float | None) -> None:
        """Update the textures, and the lines unless ``crease_deg``, the least angle of a crease, is ``None``."""
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
                self._key, self._lines_key = key, None
            if crease_deg is not None and self._lines_key != crease_deg:
                min_step_mm = 0.0 if mesh is None else MIN_STEP_EDGES * mesh.edge_mm
                self._find_lines(projection, crease_deg, min_step_mm)
                self._lines_key = crease_deg

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

    def _find_lines(self, projection: Projection, crease_deg: float, min_step_mm: float) -> None:
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
            shader.uniform_float("crease_rad", np.radians(crease_deg))
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
