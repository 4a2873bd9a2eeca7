"""Exact views by rasterisation: OpenGL finds the triangle of each pixel, and formulas do the rest.

Two passes, through Blender's ``gpu`` module. The first draws the surface and keeps the face of each pixel; its shader
does nothing else, since a rasteriser shades small triangles several times over. The second runs once per pixel: it
intersects the ray through the pixel's centre with the face's plane, which gives depth without a depth buffer's
rounding, and looks the point up in the reference view by the rule of :mod:`pipeline.colour.source_view`. Its matrices
are multiplied in double precision beforehand, and at the frame's own pose the lookup is the identity.

What is left to the rasteriser is which of two adjacent triangles has a pixel centre that lies within about 1/256 px of
their edge. Cycles is the proof: :func:`check_raster` renders the frame's own pose and compares it with Cycles' depth.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import bpy
import gpu
import numpy as np
from mathutils import Matrix

from ...camera.pinhole import PinholeCamera
from ...colour.source_view import SourceView
from ...dataset.view import RenderedView
from ...errors import InputError, RunError
from ...surface.mesh import TriangleMesh
from ...transforms import inverse_rigid
from ..process import delayed_interrupts
from .raster_shaders import CORNER_TEXELS, RAYS, ROW, face_shader, view_shader

LARGEST_FACES = 2**24 - 1
"""Faces are numbered from 1 in single precision, 0 is the background."""
_SAME_DEPTH, _SAME_PART = 1e-5, 0.999
"""Relative difference of depth from Cycles', and the least part of the surface that keeps it. On a bowl of 200 000
triangles, 99.9 % of the pixels are within 3e-9."""


class Raster:
    """Draws views of a surface with the projective colours of a reference view, or plain for ``None``."""

    def __init__(
        self,
        mesh: TriangleMesh,
        camera: PinholeCamera,
        colour: SourceView | None,
        unseen: np.ndarray | None = None,
    ) -> None:
        """Keep the data; OpenGL gets them with the first view.

        Parameters
        ----------
        mesh, camera, unseen
            As for :class:`.SurfaceScene`.
        colour
            The reference view, or ``None`` for geometry alone.

        Raises
        ------
        InputError
            More faces than :data:`LARGEST_FACES`.
        """
        if len(mesh.faces) > LARGEST_FACES:
            raise InputError(
                f"surface: expected at most {LARGEST_FACES:,} faces with engine raster, found {len(mesh.faces):,}; "
                "use --engine cycles"
            )
        self._mesh, self._camera, self._colour, self._unseen = mesh, camera, colour, unseen
        self._drawing: _Drawing | None = None

    def render(self, cam_from_model: np.ndarray, nearest_mm: float) -> RenderedView:
        """Render a pose (4x4, mm); nothing nearer than ``nearest_mm`` is shown."""
        pixels = _with_context(lambda: self._draw(cam_from_model, nearest_mm))
        signed = pixels[..., 3]
        return RenderedView(pixels[..., :3], np.abs(signed), signed > 0, np.zeros(signed.shape, bool))

    def _draw(self, cam_from_model: np.ndarray, nearest_mm: float) -> np.ndarray:
        if self._drawing is None:
            self._drawing = _Drawing(self._mesh, self._camera, self._colour, self._unseen)
        return self._drawing.draw(cam_from_model, nearest_mm)

    def close(self) -> None:
        """Free what OpenGL holds."""
        self._drawing = None


def check_raster(mesh: TriangleMesh, source: SourceView) -> None:
    """Check that this machine's OpenGL draws the frame's own pose as Cycles did.

    Parameters
    ----------
    mesh
        The surface, model frame.
    source
        The reference view, whose inverse depth comes from Cycles.

    Raises
    ------
    RunError
        It does not.
    """
    raster = Raster(mesh, source.camera, None)
    nearest = 0.99 * float(source.depth_mm[source.depth_mm > 0].min())
    drawn = raster.render(source.cam_from_model, nearest).depth_mm
    raster.close()
    known = source.inverse_depth > 0
    same = float((np.abs(drawn * source.inverse_depth - 1)[known] < _SAME_DEPTH).mean())
    if same < _SAME_PART:
        raise RunError(
            f"--engine raster: expected the depth of Cycles at the frame's pose, {1 - same:.1%} of the surface differs "
            "with this machine's graphics driver; use --engine cycles"
        )


class _Drawing:
    """What OpenGL holds for one surface, camera and reference view; needs its context."""

    def __init__(
        self, mesh: TriangleMesh, camera: PinholeCamera, colour: SourceView | None, unseen: np.ndarray | None
    ) -> None:
        self._camera, self._colour = camera, colour
        largest = gpu.capabilities.max_texture_size_get()
        texels = len(mesh.faces) * (1 if unseen is None else CORNER_TEXELS)
        sides = (*camera.size_wh, *(colour.camera.size_wh if colour else ()), -(-texels // ROW))
        if max(sides) > largest:
            raise InputError(
                f"view: expected at most {largest} px a side for this machine's OpenGL, found {max(sides)}; "
                "use --engine cycles"
            )
        self._faces_shader, self.view_shader = face_shader(), view_shader(filled=unseen is not None)
        self._surface, self._screen = _surface_batch(mesh), _screen_batch()
        frame = np.zeros((1, 1, 4))
        if colour is not None:
            image, inverse_depth = colour.continued
            frame = np.concatenate([image, inverse_depth[..., None]], axis=2)
        self._textures = {"frame": _texture(frame), "planes": _texture(_planes(mesh, colour))}
        if unseen is not None:
            self._textures["corners"] = _texture(_corners(mesh, unseen))
        size = camera.size_wh
        self._faces = gpu.types.GPUTexture(size, format="RG32F")
        self._depth = gpu.types.GPUTexture(size, format="DEPTH_COMPONENT32F")
        self._view = gpu.types.GPUTexture(size, format="RGBA32F")
        self._first = gpu.types.GPUFrameBuffer(depth_slot=self._depth, color_slots=(self._faces,))
        self._second = gpu.types.GPUFrameBuffer(color_slots=(self._view,))

    def draw(self, cam_from_model: np.ndarray, nearest_mm: float) -> np.ndarray:
        """``(H, W, 4)`` float32: colour, and depth in mm, negative where the frame saw nothing."""
        state: Any = gpu.state
        state.blend_set("NONE")
        state.face_culling_set("NONE")
        with self._first.bind():
            self._first.clear(color=(0.0, 0.0, 0.0, 0.0), depth=0.0)
            state.depth_test_set("GREATER")
            state.depth_mask_set(True)
            self._faces_shader.bind()
            clip = _clip_from_cam(self._camera, nearest_mm) @ cam_from_model
            self._faces_shader.uniform_float("clip_from_model", Matrix(clip.tolist()))
            self._faces_shader.uniform_float("nearest", nearest_mm)
            self._surface.draw(self._faces_shader)
            state.depth_test_set("NONE")
            state.depth_mask_set(False)
        with self._second.bind():
            self.view_shader.bind()
            self._set_rays(cam_from_model)
            for name, texture in (("faces", self._faces), *self._textures.items()):
                self.view_shader.uniform_sampler(name, texture)
            self._screen.draw(self.view_shader)
            pixels = np.empty((*self._camera.shape_hw, 4), np.float32)
            # a buffer of more dimensions has wrong strides in 4.5
            buffer: Any = gpu.types.Buffer("FLOAT", pixels.size, pixels.reshape(-1))
            self._second.read_color(0, 0, *self._camera.size_wh, 4, 0, "FLOAT", data=buffer)
        return pixels

    def _set_rays(self, cam_from_model: np.ndarray) -> None:
        """Pixel to ray in the model frame, and with the depth to the homogeneous pixel of the reference view."""
        model_from_cam = inverse_rigid(cam_from_model)
        rays, origin = model_from_cam[:3, :3] @ np.linalg.inv(self._camera.k), model_from_cam[:3, 3]
        if self._colour is None:
            source, epipole, tolerance = np.eye(3), np.zeros(3), 0.0
        else:
            relative = self._colour.cam_from_model @ model_from_cam
            source = self._colour.camera.k @ relative[:3, :3] @ np.linalg.inv(self._camera.k)
            epipole, tolerance = self._colour.camera.k @ relative[:3, 3], self._colour.depth_tolerance
        for name, vector in zip(RAYS, (*rays.T, *source.T, epipole), strict=True):
            self.view_shader.uniform_float(name, (*vector, 0.0))
        self.view_shader.uniform_float("origin_and_tolerance", (*origin, tolerance))


def _clip_from_cam(camera: PinholeCamera, nearest_mm: float) -> np.ndarray:
    """OpenGL's projection with the image's first row at the bottom, and the far plane at infinity."""
    projection = np.zeros((4, 4))
    projection[0, 0], projection[0, 2] = 2 * camera.fx / camera.width, (2 * camera.cx + 1) / camera.width - 1
    projection[1, 1], projection[1, 2] = 2 * camera.fy / camera.height, (2 * camera.cy + 1) / camera.height - 1
    projection[2, 2], projection[2, 3], projection[3, 2] = 1.0, -2 * nearest_mm, 1.0
    return projection


def _planes(mesh: TriangleMesh, colour: SourceView | None) -> np.ndarray:
    """``(R, 4096, 4)``: normal n and offset d of each face's plane n X + d = 0, zero for faces without area.

    Normals have length 2 where the front side faces the reference view, otherwise 1.
    """
    corners = mesh.vertices.astype(np.float32).astype(float)[mesh.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    normals = np.divide(normals, lengths, out=np.zeros_like(normals), where=lengths > 0)
    if colour is not None:
        normals[colour.facing_faces(mesh)] *= 2
    normals = normals.astype(np.float32)
    offsets = -np.einsum("ij,ij->i", normals.astype(float), corners.mean(axis=1))
    return _in_rows(np.concatenate([normals, offsets[:, None]], axis=1))


def _corners(mesh: TriangleMesh, colours: np.ndarray) -> np.ndarray:
    """``(R, 4096, 4)``: positions and colours ``(V, 3)`` of each face's corners."""
    values = np.concatenate([mesh.vertices[mesh.faces], colours[mesh.faces]], axis=1)
    return _in_rows(np.pad(values.reshape(-1, 3), ((0, 0), (0, 1))))


def _in_rows(texels: np.ndarray) -> np.ndarray:
    rows = np.zeros((-(-len(texels) // ROW) * ROW, 4), np.float32)
    rows[: len(texels)] = texels
    return rows.reshape(-1, ROW, 4)


def _surface_batch(mesh: TriangleMesh) -> Any:
    """The faces; the last corner of face i is vertex i, from which OpenGL takes values that are not interpolated."""
    last = mesh.faces[:, 2]
    count = len(last)
    copy = np.full(len(mesh.vertices), -1)
    copy[last[::-1]] = np.arange(count)[::-1]
    others = np.flatnonzero(copy < 0)
    copy[others] = count + np.arange(len(others))
    positions = mesh.vertices[np.concatenate([last, others])]
    faces = np.stack([copy[mesh.faces[:, 0]], copy[mesh.faces[:, 1]], np.arange(count)], axis=1)
    indices: Any = np.ascontiguousarray(faces, np.int32)
    elements = gpu.types.GPUIndexBuf(type="TRIS", seq=indices)
    return gpu.types.GPUBatch(type="TRIS", buf=_vertices("position", positions), elem=elements)


def _screen_batch() -> Any:
    """One triangle that covers the image."""
    return gpu.types.GPUBatch(type="TRIS", buf=_vertices("corner", np.array([[-1, -1], [3, -1], [-1, 3]])))


def _vertices(name: str, values: np.ndarray) -> Any:
    layout = gpu.types.GPUVertFormat()
    layout.attr_add(id=name, comp_type="F32", len=values.shape[1], fetch_mode="FLOAT")
    buffer = gpu.types.GPUVertBuf(layout, len(values))
    data: Any = np.ascontiguousarray(values, np.float32)
    buffer.attr_fill(name, data)
    return buffer


def _texture(rgba: np.ndarray) -> Any:
    data: Any = np.ascontiguousarray(rgba, np.float32).reshape(-1)
    buffer = gpu.types.Buffer("FLOAT", data.size, data)
    return gpu.types.GPUTexture((rgba.shape[1], rgba.shape[0]), format="RGBA32F", data=buffer)


def _with_context(draw: Callable[[], np.ndarray]) -> np.ndarray:
    """Call a function with an OpenGL context, which Blender also has without a window: for engines that ask for it."""
    results: list[np.ndarray] = []
    errors: list[Exception] = []

    def render(_self: bpy.types.RenderEngine, _depsgraph: bpy.types.Depsgraph) -> None:
        try:
            results.append(draw())
        except Exception as error:  # Blender would print it and go on
            errors.append(error)

    with _engine(render) as scene, delayed_interrupts():
        bpy.ops.render.render(scene=scene.name)
    if errors:
        raise errors[0]
    if not results:
        raise RuntimeError("the engine ended without a view")
    return results[0]


@contextmanager
def _engine(render: Callable[[Any, bpy.types.Depsgraph], None]) -> Iterator[bpy.types.Scene]:
    """An empty scene whose engine is this function."""
    names = {"bl_idname": "ONEFRAME_RASTER", "bl_label": "OneFrame", "bl_use_gpu_context": True, "render": render}
    engine: Any = type("OneFrameRaster", (bpy.types.RenderEngine,), names)
    bpy.utils.register_class(engine)
    scene = bpy.data.scenes.new("oneframe raster")
    camera = bpy.data.cameras.new("raster")
    camera_object = bpy.data.objects.new("raster", camera)
    try:
        scene.render.engine = "ONEFRAME_RASTER"
        scene.render.resolution_x = scene.render.resolution_y = 8
        scene.collection.objects.link(camera_object)
        scene.camera = camera_object
        yield scene
    finally:
        bpy.data.scenes.remove(scene)
        bpy.data.batch_remove([camera_object, camera])
        bpy.utils.unregister_class(engine)
