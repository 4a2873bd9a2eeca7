"""Blender's own rays at the surface of a scene, one after the other, for a Blender without the package embreex."""

import numpy as np
from mathutils.bvhtree import BVHTree

from ...errors import InputError
from ...projection.rays import Hits, MeshRays
from .surface_scene import SurfaceScene


def rays_at(surface_scene: SurfaceScene) -> MeshRays:
    """What casts rays at the surface of a scene: Embree, or Blender where it is missing."""
    try:
        return MeshRays(surface_scene.mesh)
    except InputError:
        return SceneRays(surface_scene)


def scene_tree(surface_scene: SurfaceScene) -> BVHTree:
    """The surface of a scene as Blender's search structure."""
    layer = surface_scene.scene.view_layers[0]
    # a layer that was never rendered has no depsgraph yet
    layer.update()
    return BVHTree.FromObject(surface_scene.surface_object, layer.depsgraph)  # type: ignore[arg-type]  # the same class


class SceneRays(MeshRays):
    """Casts Blender's rays at the mesh of a scene."""

    def __init__(self, surface_scene: SurfaceScene) -> None:
        self._mesh, self._tree = surface_scene.mesh, scene_tree(surface_scene)

    def first_hits(self, origins: np.ndarray, directions: np.ndarray) -> Hits:
        """As of :class:`.MeshRays`."""
        mesh = self._mesh
        found = [self._tree.ray_cast(*ray) for ray in zip(origins.tolist(), directions.tolist(), strict=True)]
        face = np.array([-1 if number is None else number for _, _, number, _ in found], np.int32)
        distance = np.array([distance or 0.0 for *_, distance in found]) / np.linalg.norm(directions, axis=1)
        a, b, c = (mesh.vertices[mesh.faces[face, corner]] for corner in range(3))
        offset, cross = origins + distance[:, None] * directions - a, mesh.face_cross[face]
        squared = (cross * cross).sum(axis=1)
        second = (np.cross(offset, c - a) * cross).sum(axis=1) / squared
        third = (np.cross(b - a, offset) * cross).sum(axis=1) / squared
        front = (cross * directions).sum(axis=1) < 0
        return Hits(face, distance.astype(np.float32), front, second.astype(np.float32), third.astype(np.float32))
