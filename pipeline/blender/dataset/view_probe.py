"""What a pose would show, measured before rendering with a coarse grid of rays through the exact K."""

from collections.abc import Sequence

import numpy as np
from mathutils import Vector
from mathutils.bvhtree import BVHTree

from ...camera.pinhole import PinholeCamera
from ...poses.constraints import ViewStatistics
from ...projection.visible_surface import cast_grid
from ...transforms import camera_centre
from ..colour.reference_view import ReferenceView
from ..render.surface_scene import SurfaceScene

GRID = 16
"""Number of rays along the longer side of the image; fractions are accurate to about 1 / GRID^2."""


class ViewProbe:
    """Casts a grid of rays at the surface; call it with ``cam_from_model`` (4x4, mm)."""

    def __init__(self, surface_scene: SurfaceScene, source: ReferenceView, camera: PinholeCamera) -> None:
        layer = surface_scene.scene.view_layers[0]
        # a layer that was never rendered has no depsgraph yet
        layer.update()
        depsgraph = layer.depsgraph
        self._tree = BVHTree.FromObject(surface_scene.surface_object, depsgraph)  # type: ignore[arg-type]  # the same class
        self._source = source
        self._camera = camera

    def __call__(self, cam_from_model: np.ndarray) -> ViewStatistics:
        """Surface fraction and observed fraction of the view, and the camera's distance to the surface."""
        seen = cast_grid(self._first_hit, self._camera, cam_from_model, along=GRID)
        *_, distance = self._tree.find_nearest(Vector(camera_centre(cam_from_model)))
        clearance = np.inf if distance is None else float(distance)
        if len(seen.pixels) == 0:
            return ViewStatistics(0.0, 0.0, clearance)
        # back sides are surface too, but never observed
        observed = self._source.view.observed(seen.points_model, seen.normals_model)
        return ViewStatistics(seen.image_fraction, float(observed.mean()), clearance)

    def _first_hit(self, origin: Sequence[float], direction: Sequence[float]) -> tuple[Vector, Vector] | None:
        point, normal, _, _ = self._tree.ray_cast(origin, direction)
        return None if point is None or normal is None else (point, normal)
