"""Rays at a mesh: the face that each of them meets first, by Embree, the ray tracer inside Cycles.

The package ``embreex`` brings it, as a wheel without further needs; nothing else here imports it. Embree computes in
single precision, with edges that let nothing through. It keeps a copy of the mesh, and its time hardly grows with it.
"""

from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..errors import InputError
from ..surface.mesh import TriangleMesh

if TYPE_CHECKING:
    from embreex.rtcore_scene import EmbreeScene


class Hits(NamedTuple):
    """What N rays meet; all but ``face`` is meaningless where they miss.

    Attributes
    ----------
    face
        ``(N,)`` int32, -1 for a miss.
    distance
        ``(N,)`` float32, in lengths of the ray's direction.
    front
        ``(N,)`` bool: the face shows its front.
    second, third
        ``(N,)`` float32 barycentrics of the face's second and third corner; the first has what is left to 1.
    """

    face: np.ndarray
    distance: np.ndarray
    front: np.ndarray
    second: np.ndarray
    third: np.ndarray


def require_embree() -> None:
    """Check that rays can be cast."""
    try:
        import embreex.mesh_construction  # noqa: F401
    except ImportError:
        raise InputError(
            "--engine raster: expected the package embreex in this Python, found none; install it (pip install "
            "embreex), use a Blender in which the OneFrame extension is enabled, or use --engine cycles"
        ) from None


class MeshRays:
    """Casts rays at one mesh."""

    def __init__(self, mesh: TriangleMesh) -> None:
        """Keep the mesh: the first rays build the search structure, which takes a second for a million faces."""
        require_embree()
        self._mesh = mesh

    @cached_property
    def _scene(self) -> "EmbreeScene":
        from embreex import mesh_construction, rtcore_scene

        scene = rtcore_scene.EmbreeScene(robust=True)
        mesh_construction.TriangleMesh(scene, self._mesh.vertices.astype(np.float32), self._mesh.faces)
        return scene

    def first_hits(self, origins: np.ndarray, directions: np.ndarray) -> Hits:
        """``(N, 3)`` float32 origins, mm, and directions of any length -> what the rays meet; one thread may ask."""
        found = self._scene.run(origins, directions, output=True)
        # column by column: numpy is slow at reductions along an axis of three
        x, y, z = (found["Ng"] * directions).T
        return Hits(found["primID"], found["tfar"], x + y + z < 0, found["u"], found["v"])
