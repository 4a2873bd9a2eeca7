"""The surface as Blender's search structure: what a pose would show."""

from collections.abc import Callable, Sequence

import numpy as np
from mathutils import Vector
from mathutils.bvhtree import BVHTree

from ...camera.pinhole import PinholeCamera
from ...poses.constraints import ViewStatistics
from ...projection.visible_surface import cast_grid
from ...surface.mesh import TriangleMesh
from ...transforms import camera_centre

GRID = 16
"""Number of rays along the longer side of the image; fractions are accurate to about 1 / GRID^2."""


def surface_tree(mesh: TriangleMesh) -> BVHTree:
    """The mesh as Blender's search structure, in single precision; no scene is needed."""
    return BVHTree.FromPolygons(mesh.vertices.tolist(), mesh.faces.tolist(), all_triangles=True)


class ViewProbe:
    """What a pose would show, by a grid of rays at the surface; call it with ``cam_from_model`` (4x4, mm)."""

    def __init__(
        self,
        mesh: TriangleMesh,
        camera: PinholeCamera,
        observed: Callable[[np.ndarray, np.ndarray], np.ndarray],
    ) -> None:
        """Build the tree; ``observed`` tells of points and normals, both ``(N, 3)``, which the frame saw."""
        self._tree, self._camera, self._observed = surface_tree(mesh), camera, observed

    def __call__(self, cam_from_model: np.ndarray) -> ViewStatistics:
        """Surface fraction and observed fraction of the view, and the camera's distance to the surface."""
        seen = cast_grid(self._first_hit, self._camera, cam_from_model, along=GRID)
        *_, distance = self._tree.find_nearest(Vector(camera_centre(cam_from_model)))
        clearance = np.inf if distance is None else float(distance)
        if len(seen.pixels) == 0:
            return ViewStatistics(0.0, 0.0, clearance)
        # back sides are surface too, but never observed
        observed = self._observed(seen.points_model, seen.normals_model)
        return ViewStatistics(seen.image_fraction, float(observed.mean()), clearance)

    def seen_point(self, pixel: np.ndarray, cam_from_model: np.ndarray) -> np.ndarray | None:
        """As of :class:`.Room`."""
        direction = cam_from_model[:3, :3].T @ self._camera.rays_cam(pixel)
        hit = self._first_hit(camera_centre(cam_from_model).tolist(), direction.tolist())
        if hit is None:
            return None
        point, normal = (np.array(each, float)[None] for each in hit)
        return point[0] if self._observed(point, normal)[0] else None

    def touches(self, mesh: TriangleMesh, others: Sequence[TriangleMesh]) -> bool:
        """As of :class:`.Room`."""
        tree = surface_tree(mesh)
        return bool(tree.overlap(self._tree)) or any(bool(tree.overlap(surface_tree(other))) for other in others)

    def _first_hit(self, origin: Sequence[float], direction: Sequence[float]) -> tuple[Vector, Vector] | None:
        point, normal, _, _ = self._tree.ray_cast(origin, direction)
        return None if point is None or normal is None else (point, normal)
