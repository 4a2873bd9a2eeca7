"""A view with what stands in front of the surface: one step after any engine, so that all have the same masks.

A z-buffer in double precision finds the occluders at the pixels' centres, in any Blender, and the nearer of surface
and occluder is seen. The lamp at the lens lights them as it does the surface, or else one in the lens' centre.
"""

from dataclasses import dataclass, replace

import numpy as np

from ..camera.pinhole import PinholeCamera
from ..colour.lens_shading import LensShading, lit_by_lamp, shifted_codes, shown_codes
from ..light.lens_light import LensLight
from ..projection.edge_pixels import pixel_pattern
from ..projection.rendered_view import RenderedView
from ..projection.visible_surface import pixel_points
from ..projection.z_buffer import DepthRaster, inverse_depth_map, rasterise_depth, seen_normals
from ..surface.mesh import TriangleMesh
from ..transforms import camera_centre
from .occluders import Occluders
from .shadow import Shadow
from .staging import Filter, Staging

HEAD_LIGHT = LensLight((0.0, 0.0, 0.0), 0.1)
MOST_SAMPLES = 8
"""Rays in a pixel at an occluder's edge, each of which takes a z-buffer of its own."""
LEAST = 0.02
"""Shading that a part of an occluder gets at least."""


def head_light(pivot_model: np.ndarray) -> LensShading:
    """A lamp in the lens' centre, for what no light of a case shines on; exposed for a pivot (3,), model frame, mm."""
    x, y, z = pivot_model.tolist()
    return LensShading(HEAD_LIGHT, LEAST, middle_model=(x, y, z))


def front_filter(staging: Staging) -> Filter | None:
    """The filter that puts the occluders in front of a view."""
    if not staging.options["occluders"]:
        return None
    light = staging.light or head_light(staging.reference.pivot_model).moved(staging.camera_from_planned)
    front = Front(staging.camera, light, staging.options["samples"])
    return lambda view, staged: front.composed(view, staged.occluders, staged.cam_from_model)


@dataclass(frozen=True)
class Front:
    """What the views of a dataset share to be composed.

    Attributes
    ----------
    camera
        Intrinsics of the views.
    light
        The light at the lens, or :func:`head_light`.
    samples
        Rays in a pixel that an edge crosses.
    """

    camera: PinholeCamera
    light: LensShading
    samples: int = 1

    def composed(self, view: RenderedView, occluders: Occluders | None, cam_from_model: np.ndarray) -> RenderedView:
        """A view of a pose (4x4, mm) with occluders in front of it, or none."""
        if occluders is None:
            return replace(view, occluder_mm=np.zeros_like(view.depth_mm))
        surface = inverse_depth_map(view.depth_mm)
        seen = _Seen(occluders, self.camera, cam_from_model, self.light)
        raster = seen.raster(np.zeros(2))
        shown = raster.inverse_depth > surface
        rgb = view.rgb.copy()
        rgb[shown] = seen.colours(raster, shown, np.zeros(2))
        if self.samples > 1:
            self._smooth_edges(rgb, view, shown, surface, seen)
        return replace(
            view,
            rgb=rgb,
            source=np.where(shown, np.uint8(0), view.source),
            occluder_mm=np.where(shown, raster.depth_mm, 0).astype(np.float32),
        )

    def _smooth_edges(
        self, rgb: np.ndarray, view: RenderedView, shown: np.ndarray, surface: np.ndarray, seen: "_Seen"
    ) -> None:
        """Mix the colours of pixels that an occluder covers in part; those whose centre shows nothing stay black."""
        offsets = pixel_pattern(samples := min(self.samples, MOST_SAMPLES))
        rasters = [seen.raster(offset) for offset in offsets]
        hits = [raster.inverse_depth > surface for raster in rasters]
        count = np.sum(hits, axis=0)
        behind = view.mask | view.surround
        edges = (count > 0) & ((count < samples) | ~shown) & (shown | behind)
        total = np.zeros_like(rgb)
        for raster, hit, offset in zip(rasters, hits, offsets, strict=True):
            part = hit & edges
            total[part] += seen.colours(raster, part, offset)
        # beside the background, the mean over what shows the occluder, as of the surface there
        cover = np.where(behind, count / samples, 1.0)[edges, None].astype(np.float32)
        rgb[edges] = cover * (total[edges] / count[edges, None]) + (1 - cover) * view.rgb[edges]


class _Seen:
    """Occluders from a pose, in the light of its lens."""

    def __init__(
        self, occluders: Occluders, camera: PinholeCamera, cam_from_model: np.ndarray, light: LensShading
    ) -> None:
        self._occluders, self._camera, self._pose, self._light = occluders, camera, cam_from_model, light
        self._centre = camera_centre(cam_from_model)
        self._lamp = light.at(cam_from_model)[0].place_model(cam_from_model)

    def raster(self, offset: np.ndarray) -> DepthRaster:
        """What is at a place ``(2,)`` of each pixel, px from its centre."""
        right, down = offset.tolist()
        camera = replace(self._camera, cx=self._camera.cx - right, cy=self._camera.cy - down)
        return rasterise_depth(self._occluders.mesh, camera, self._pose)

    def colours(self, raster: DepthRaster, pixels: np.ndarray, offset: np.ndarray) -> np.ndarray:
        """``(N, 3)`` code values of the ``(H, W)`` bool pixels of a raster that is of this place in them."""
        v, u = np.nonzero(pixels)
        faces, uv = raster.face[pixels], np.stack([u, v], axis=1) + offset
        away = (self._camera.rays_cam(uv) @ self._pose[:3, :3]) / raster.inverse_depth[pixels][:, None]
        points = (self._centre + away).astype(np.float32)
        normals = seen_normals(self._occluders.mesh, self._camera, self._pose, faces, uv)
        rgb = shifted_codes(self._occluders.rgb[faces], self._light.curve)
        shown_codes(rgb, self._light.factors(points, normals, self._pose), self._light.curve)
        halfway = _unit(-away) + _unit(self._lamp - points)
        gloss, sharpness = self._occluders.shine[faces].T
        shine = gloss * np.maximum((normals * _unit(halfway)).sum(axis=1), 0) ** sharpness
        return np.clip(rgb + shine[:, None], 0, 1).astype(np.float32)


def _unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-12)


def shadow_filter(staging: Staging) -> Filter | None:
    """The filter that casts the shadow of occluders on the surface."""
    light, mesh = staging.light, staging.reference.mesh
    if light is None or not staging.options["occluders"]:
        return None
    lit = LitSurface(mesh, light)
    return lambda view, staged: view if staged.shadow is None else lit.shaded(view, staged.shadow)


@dataclass(frozen=True)
class LitSurface:
    """The surface in the light at the lens, for the shadows on it.

    Attributes
    ----------
    mesh
        The surface, model frame, mm.
    light
        The light.
    """

    mesh: TriangleMesh
    light: LensShading

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
        normals = seen_normals(self.mesh, camera, pose, faces, np.stack([u, v], axis=1).astype(np.float64))
        lit = lit_by_lamp(self.mesh, self.light, faces, points, pose) if self.light.shadows else None
        before, after = (
            self.light.factors(points, normals, pose, each) for each in (lit, np.zeros(len(v), np.float32))
        )
        rgb, curve = view.rgb.copy(), self.light.curve
        rgb[v, u] = shown_codes(shifted_codes(rgb[v, u], curve), after / before, curve)
        return replace(view, rgb=rgb)
