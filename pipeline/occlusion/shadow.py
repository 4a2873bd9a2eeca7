"""The shadow of instruments in the light at the lens: a z-buffer from the lamp, as fine as the view's pixels."""

from dataclasses import dataclass, replace

import numpy as np

from ..camera.pinhole import PinholeCamera
from ..colour.lens_shading import CornerNormals, LensShading, lit_by_lamp, shifted_codes, shown_codes
from ..projection.rays import MeshRays
from ..projection.rendered_view import RenderedView
from ..projection.visible_surface import pixel_points
from ..projection.z_buffer import inverse_depth_of, rasterise_depth
from ..surface.mesh import TriangleMesh
from ..transforms import camera_centre


class Shadow:
    """The shadow of a mesh, model frame, mm, in the light of the lens of a view with this pose (4x4, mm)."""

    def __init__(
        self, mesh: TriangleMesh, light: LensShading, camera: PinholeCamera, cam_from_model: np.ndarray
    ) -> None:
        self.camera, self.cam_from_model = camera, cam_from_model
        lamp, distance_mm = light.at(cam_from_model)
        self._lamp_cam_mm = x, y, _ = lamp.lamp_cam_mm
        lamp_from_model = cam_from_model.copy()
        lamp_from_model[:3, 3] -= self._lamp_cam_mm
        # the lens' own image where it works, and half an image around it
        cx = camera.cx + camera.fx * x / distance_mm + camera.width // 2
        cy = camera.cy + camera.fy * y / distance_mm + camera.height // 2
        self._seen = replace(camera, width=2 * camera.width, height=2 * camera.height, cx=cx, cy=cy)
        self._inverse_depth = inverse_depth_of(mesh, self._seen, lamp_from_model)

    def covers(self, depth_mm: np.ndarray) -> np.ndarray:
        """``(H, W)`` bool: it falls on what the pixels of the view show at this depth, 0 for nothing."""
        v, u = np.nonzero(depth_mm)
        camera, seen, (x, y, z) = self.camera, self._seen, self._lamp_cam_mm
        depth = depth_mm[v, u].astype(np.float64)
        inverse = 1 / (depth - z)
        right = ((u - camera.cx) * depth - camera.fx * x) * inverse + seen.cx
        down = ((v - camera.cy) * depth - camera.fy * y) * inverse + seen.cy
        texel = tuple(
            np.clip(np.rint(at), 0, size - 1).astype(int) for at, size in ((down, seen.height), (right, seen.width))
        )
        covered = np.zeros(depth_mm.shape, bool)
        covered[v, u] = self._inverse_depth[texel] > inverse
        return covered


@dataclass(frozen=True)
class LitSurface:
    """The surface in the light at the lens, for the shadows on it.

    Attributes
    ----------
    mesh, normals
        The surface, model frame, mm, and its normals.
    light
        The light.
    rays
        Rays at it, if its own parts throw shadows, too.
    """

    mesh: TriangleMesh
    normals: CornerNormals
    light: LensShading
    rays: MeshRays | None = None

    def shaded(self, view: RenderedView, shadow: Shadow) -> RenderedView:
        """A view of the surface alone with a shadow on it."""
        camera, pose = shadow.camera, shadow.cam_from_model
        v, u = np.nonzero(shadow.covers(view.depth_mm))
        if len(v) == 0:
            return view
        left, top, width, height = u.min(), v.min(), int(np.ptp(u)) + 1, int(np.ptp(v)) + 1
        part = replace(camera, width=width, height=height, cx=camera.cx - left, cy=camera.cy - top)
        faces = rasterise_depth(self.mesh, part, pose).face[v - top, u - left]
        # a centre on an edge, where the renderer meets surface and double precision does not, stays lit
        v, u, faces = v[faces >= 0], u[faces >= 0], faces[faces >= 0]
        points = pixel_points(view.depth_mm, (v, u), camera, pose)
        normals = self.normals.at(faces, points, self.mesh.front_facing(camera_centre(pose), faces))
        lit = None if self.rays is None else lit_by_lamp(self.rays, self.light, faces, points, pose)
        before, after = (
            self.light.factors(points, normals, pose, each) for each in (lit, np.zeros(len(v), np.float32))
        )
        rgb, curve = view.rgb.copy(), self.light.curve
        rgb[v, u] = shown_codes(shifted_codes(rgb[v, u], curve), after / before, curve)
        return replace(view, rgb=rgb)
