"""What a pose would show, before it is rendered: a coarse grid of rays through the true K."""

import numpy as np
from mathutils import Vector
from mathutils.bvhtree import BVHTree

from ...camera.pinhole import PinholeCamera
from ...poses.constraints import ViewStatistics
from ...transforms import camera_centre, inverse_rigid
from ..colour.reference_view import ReferenceView
from ..render.surface_scene import SurfaceScene

GRID = 16
"""Rays along the longer side of the image; fractions are known to about 1 / GRID^2."""


class ViewProbe:
    """Casts a grid of rays at the surface; call it with ``cam_from_model``."""

    def __init__(self, surface_scene: SurfaceScene, source: ReferenceView, camera: PinholeCamera) -> None:
        depsgraph = surface_scene.scene.view_layers[0].depsgraph
        depsgraph.update()
        self._tree = BVHTree.FromObject(surface_scene.surface_object, depsgraph)  # type: ignore[arg-type]  # the same class
        self._source = source
        self._rays_cam = camera.rays_cam(camera.coarse_grid(GRID))

    def __call__(self, cam_from_model: np.ndarray) -> ViewStatistics:
        """Surface and observed fraction of the view, and the camera's distance to the surface."""
        centre = Vector(camera_centre(cam_from_model))
        directions = self._rays_cam @ inverse_rigid(cam_from_model)[:3, :3].T
        points, normals = [], []
        for direction in directions:
            point, normal, _, _ = self._tree.ray_cast(centre, direction)
            # back sides are surface too, but never observed
            if point is not None and normal is not None:
                points.append(point)
                normals.append(normal if normal.dot(direction) < 0 else (0.0, 0.0, 0.0))
        nearest = self._tree.find_nearest(centre)
        clearance = float(nearest[3]) if nearest[3] is not None else np.inf
        if not points:
            return ViewStatistics(0.0, 0.0, clearance)
        observed = self._source.view.observed(np.array(points), np.array(normals))
        return ViewStatistics(len(points) / len(directions), float(observed.mean()), clearance)
