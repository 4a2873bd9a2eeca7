"""Data-blocks in the open file: creating meshes, removing everything temporary, resolving paths."""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

import bpy
import numpy as np
from idprop.types import IDPropertyArray, IDPropertyGroup
from numpy.typing import ArrayLike

from ...surface.mesh import TriangleMesh

_KINDS = ("scenes", "worlds", "objects", "meshes", "cameras", "lights", "materials", "images", "node_groups")
_OF_BLENDER = ("RENDER_RESULT", "COMPOSITING")
"""Types of the images that Blender itself creates and keeps."""


def data_blocks() -> list[bpy.types.ID]:
    """All data-blocks of the kinds that the pipeline creates."""
    return [
        block
        for kind in _KINDS
        for block in getattr(bpy.data, kind)
        if not (kind == "images" and block.type in _OF_BLENDER)
    ]


def remove_data(blocks: Iterable[bpy.types.ID]) -> None:
    """Remove data-blocks; for scenes, also free the render engine's data."""
    others = []
    for block in blocks:
        if isinstance(block, bpy.types.Scene):
            # else the engine's dependency graph outlives its scene: the next removal of any data reads freed memory
            block.render.use_persistent_data = False
            # unlike batch_remove, it switches a window that shows the scene to another one
            bpy.data.scenes.remove(block)
        else:
            others.append(block)
    bpy.data.batch_remove(others)


@contextmanager
def temporary_data() -> Iterator[None]:
    """Remove at the end of the block all data-blocks created inside it."""
    existing = set(data_blocks())
    try:
        yield
    finally:
        remove_data(block for block in data_blocks() if block not in existing)


def new_mesh_object(name: str, mesh: TriangleMesh) -> bpy.types.Object:
    """A mesh object at the world's origin, not linked to any collection, with the vertices and faces in order."""
    data = bpy.data.meshes.new(name)
    data.vertices.add(len(mesh.vertices))
    data.vertices.foreach_set("co", mesh.vertices.astype(np.float32).ravel())
    data.loops.add(mesh.faces.size)
    data.loops.foreach_set("vertex_index", mesh.faces.ravel())
    data.polygons.add(len(mesh.faces))
    data.polygons.foreach_set("loop_start", np.arange(0, mesh.faces.size, 3, dtype=np.int32))
    data.update(calc_edges=True)
    return bpy.data.objects.new(name, data)


def set_vertex_colors(mesh_object: bpy.types.Object, name: str, rgba: np.ndarray) -> None:
    """Store ``(V, 4)`` float values unchanged as a point colour attribute (32 bit, no colour space)."""
    attribute = mesh_object.data.color_attributes.new(name, "FLOAT_COLOR", "POINT")
    attribute.data.foreach_set("color", np.ascontiguousarray(rgba, dtype=np.float32).ravel())


def set_corner_uv(mesh_object: bpy.types.Object, name: str, uv: np.ndarray) -> None:
    """Store ``(F, 3, 2)`` texture coordinates (origin bottom-left) as a UV map."""
    layer = mesh_object.data.uv_layers.new(name=name, do_init=False)
    layer.uv.foreach_set("vector", np.ascontiguousarray(uv, dtype=np.float32).ravel())


def set_corner_vectors(mesh_object: bpy.types.Object, name: str, vectors: np.ndarray) -> None:
    """Store ``(F, 3, 3)`` float vectors, one per corner of each triangle, as an attribute."""
    attribute = mesh_object.data.attributes.new(name, "FLOAT_VECTOR", "CORNER")
    attribute.data.foreach_set("vector", np.ascontiguousarray(vectors, dtype=np.float32).ravel())


def absolute_path(path: str) -> Path:
    """The absolute path for one that Blender may store relative to the .blend file (``//...``)."""
    return Path(bpy.path.abspath(path)).resolve()


def set_exact(data: bpy.types.ID, name: str, values: ArrayLike) -> None:
    """Store a float64 array of any shape in a custom property of a data-block."""
    array = np.asarray(values, dtype=np.float64)
    data[name] = {"shape": list(array.shape), "values": array.ravel().tolist()}


def exact(data: bpy.types.ID, name: str) -> np.ndarray | None:
    """The array that :func:`set_exact` stored, or ``None`` if the property is missing or holds something else."""
    stored = data.get(name)
    if not isinstance(stored, IDPropertyGroup):
        return None
    shape, values = stored.get("shape"), stored.get("values")
    if not _is_array(shape, "i") or not _is_array(values, "d"):
        return None
    try:
        return np.array(values, dtype=np.float64).reshape(tuple(shape))
    except ValueError:
        return None


def _is_array(stored: object, typecode: str) -> bool:
    # an empty array may have any type
    return isinstance(stored, IDPropertyArray) and (stored.typecode == typecode or len(stored) == 0)
