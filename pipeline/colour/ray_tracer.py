"""Exact views at the pixels' centres: what Cycles renders for colours without light, in less time.

First comes what is seen: the nearest face at each pixel, and its depth (:mod:`oneframe.projection.z_buffer`). Then each
pixel of the surface is coloured once: by the rule of :mod:`oneframe.colour.seen_frame`, from the first frame that saw
its point; it is what the material of :mod:`oneframe.blender.render.material` computes. Rays beside the pixels' centres,
for anti-aliased views, are treated alike.
"""

from typing import NamedTuple

import numpy as np

from ..camera.pinhole import PinholeCamera
from ..images.pixel_values import ROUNDING_PX
from ..kernels import lookup
from ..projection.edge_pixels import pixel_pattern
from ..projection.rendered_view import RenderedView
from ..projection.z_buffer import corner_weights, nearest_at, rasterise_depth
from ..surface.mesh import TriangleMesh
from ..transforms import camera_centre, inverse_rigid
from .anti_aliasing import MISSED, OBSERVED, UNSEEN, filtered_image, footprint_scale, smoothed
from .footprint_filter import squares_for
from .lens_shading import LensShading, lit_by_lamp, shown_codes
from .shading import ColouredSurface, SurfaceColour, source_of
from .vertex_colours import NEUTRAL, VertexColours

MOST_POINTS = 1 << 22
"""Points that are coloured at once, beside the pixels' centres: it bounds the memory."""

SIGNS = np.array([(-1, -1), (1, -1), (-1, 1), (1, 1)])
"""Of the lookups in an averaged frame."""


class _Met(NamedTuple):
    """N points of the surface: ``(N, 2)`` image points, ``(N,)`` faces, inverse depths, and whether fronts are seen."""

    uv: np.ndarray
    face: np.ndarray
    inverse_depth: np.ndarray
    front: np.ndarray


class _Painter:
    """Colours from one frame, or none."""

    def __init__(self, mesh: TriangleMesh, colour: SurfaceColour | None) -> None:
        self.source = None if colour is None else source_of(colour)
        self.vertices = colour if isinstance(colour, VertexColours) else None
        self._mesh = mesh
        self._images: dict[int, tuple[np.ndarray, float]] = {}
        if self.source is not None:
            image, self._surface = self.source.continued
            self._facing = self.source.facing_faces(mesh)
            self._exact = np.dstack([image, self._surface]).astype(np.float32)

    def paint(
        self, met: _Met, weights: np.ndarray | None, affine: np.ndarray, scale: float | None, texel_share: float
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """``(N, 3)`` colours, means over pixels of a scale if it is given, ``(N,)`` seen, ``(N,)`` near the border.

        The ``weights`` of the faces' corners are used for the colours of vertices; see :data:`.CastRays` for the share.
        """
        nothing = np.zeros(len(met.face), bool)
        seen, places = met.front, np.zeros((0, 3))
        if self.source is not None:
            tolerance = self.source.depth_tolerance
            places, shown = lookup.placed_in_frame(
                met.uv, met.inverse_depth, affine, self._surface, tolerance, ROUNDING_PX
            )
            seen = seen & self._facing[met.face] & shown
        if self.vertices is not None and weights is not None:
            seen = seen & self.vertices.least[self._mesh.faces[met.face]].all(axis=1)
            return lookup.interpolated(self.vertices.rgb, self._mesh.faces, met.face, weights), seen, nothing
        if self.source is None:
            return np.full((len(met.face), 3), NEUTRAL, np.float32), seen, nothing
        if scale is None:
            return (
                lookup.looked_up(self._exact, places, seen, np.zeros((1, 2)), texel_share, tolerance)[:, :3],
                seen,
                nothing,
            )
        side, offset = squares_for(scale)
        if side not in self._images:
            self._images[side] = filtered_image(self.source, side)
        image, place = self._images[side]
        offsets = offset * SIGNS[: 4 if offset > 0 else 1] - place
        values = lookup.looked_up(image, places, seen, offsets, 0.0, 0.0)
        return values[:, :3], seen, seen & (values[:, 3] > 0.5)


class RayTracer:
    """Renders views of one surface."""

    def __init__(self, surface: ColouredSurface, camera: PinholeCamera, *, samples: int = 1) -> None:
        """Prepare what the views share; ``samples`` are rays in each pixel at an edge."""
        self._surface, self._mesh, self._camera = surface, surface.mesh, camera
        self._painters = [_Painter(surface.mesh, colour) for colour in surface.colours or (None,)]
        self._is_smooth, self._pattern = samples > 1, pixel_pattern(samples)
        by_vertices = any(painter.vertices is not None for painter in self._painters)
        self._needs_weights = by_vertices or surface.unseen is not None or surface.light is not None

    def render(self, cam_from_model: np.ndarray) -> RenderedView:
        """Render a pose (4x4, mm)."""
        raster = rasterise_depth(self._mesh, self._camera, cam_from_model)
        shown = raster.face >= 0
        v, u = np.nonzero(shown)
        met = self._met(
            np.stack([u, v], axis=1).astype(np.float64), raster.face[shown], raster.inverse_depth[shown], cam_from_model
        )
        rgb = np.zeros((*shown.shape, 3), np.float32)
        source, near = np.zeros(shown.shape, np.uint8), np.zeros(shown.shape, bool)
        rgb[shown], source[shown], near[shown] = self._coloured(met, cam_from_model, filtered=True)
        exact = RenderedView(rgb, raster.depth_mm.astype(np.float32), source, near)
        return self.smoothed(exact, cam_from_model) if self._is_smooth else exact

    def smoothed(self, exact: RenderedView, cam_from_model: np.ndarray) -> RenderedView:
        """An exact view of a pose, whose colours are filtered, anti-aliased: see :func:`.anti_aliasing.smoothed`."""
        scales = self._scales(cam_from_model)
        if not scales:
            return exact

        def cast(u: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            return self._in_pixels(cam_from_model, u, v)

        # of pixels that no frame colours, any
        by_vertices = self._painters[0].vertices is not None
        scale = np.array(scales[:1] + scales, np.float32)[exact.source] if by_vertices else None
        return smoothed(exact, self._camera, cast, vertex_scale=scale)

    def _scales(self, cam_from_model: np.ndarray) -> list[float]:
        """The sides of a view's pixel in each frame, in views that are anti-aliased."""
        sources = [painter.source for painter in self._painters if self._is_smooth and painter.source is not None]
        return [footprint_scale(each, self._surface.pivot_model, self._camera, cam_from_model) for each in sources]

    def _met(self, uv: np.ndarray, face: np.ndarray, inverse_depth: np.ndarray, cam_from_model: np.ndarray) -> _Met:
        centre = camera_centre(cam_from_model)
        return _Met(
            uv, face, inverse_depth, lookup.fronts(self._mesh.face_cross, self._mesh.plane_offsets, face, centre)
        )

    def _in_pixels(self, cam_from_model: np.ndarray, u: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Several rays in each pixel: see :data:`.CastRays`."""
        count = len(self._pattern)
        colours, kinds = np.zeros((len(u), count, 3), np.float32), np.full((len(u), count), MISSED, np.int8)
        for first in range(0, len(u), rows := max(1, MOST_POINTS // count)):
            block = slice(first, first + rows)
            uv = (np.stack([u[block], v[block]], axis=1)[:, None] + self._pattern).reshape(-1, 2)
            inverse_depth, face = nearest_at(self._mesh, self._camera, cam_from_model, uv)
            hit = np.flatnonzero(face >= 0)
            met = self._met(uv[hit], face[hit], inverse_depth[hit], cam_from_model)
            rgb, source, _ = self._coloured(met, cam_from_model, filtered=False)
            colours[block].reshape(-1, 3)[hit] = rgb
            kinds[block].reshape(-1)[hit] = np.where(source > 0, OBSERVED, UNSEEN)
        return colours, kinds

    def _coloured(
        self, met: _Met, cam_from_model: np.ndarray, *, filtered: bool
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """``(N, 3)`` colours, the ``(N,)`` number of the frame of each, from 1, or 0, and what is near its border."""
        count, scales = len(met.face), self._scales(cam_from_model)
        rgb, source, border = np.full((count, 3), NEUTRAL, np.float32), np.zeros(count, np.uint8), np.zeros(count, bool)
        mesh, weights = self._mesh, None
        if self._needs_weights:
            weights = corner_weights(mesh, self._camera, cam_from_model, met.face, met.uv)
        left = np.arange(count)
        for number, painter in enumerate(self._painters):
            part = met if number == 0 else _Met(*(values[left] for values in met))
            scale = scales[number] if scales else None
            share = 0.0 if filtered or scale is None else min(scale * scale, 1.0)
            own = weights if weights is None or number == 0 else weights[left]
            affine = self._affine(painter, cam_from_model)
            colours, seen, near = painter.paint(part, own, affine, scale if filtered else None, share)
            if number == 0:
                np.copyto(rgb, colours, where=seen[:, None])
                source[seen], border = number + 1, near
            else:
                rgb[left[seen]], source[left[seen]], border[left[near]] = colours[seen], number + 1, True
            left = left[~seen]
        if self._surface.unseen is not None and weights is not None:
            rgb[left] = lookup.interpolated(self._surface.unseen, mesh.faces, met.face[left], weights[left])
        if self._surface.light is not None and weights is not None:
            self._light(self._surface.light, rgb, met, weights, cam_from_model)
        return rgb, source, border

    def _affine(self, painter: _Painter, cam_from_model: np.ndarray) -> np.ndarray:
        """``(3, 4)`` A and b of :mod:`oneframe.kernels.lookup`; zeros without a frame."""
        if painter.source is None:
            return np.zeros((3, 4))
        view = painter.source.camera.k @ (painter.source.cam_from_model @ inverse_rigid(cam_from_model))[:3]
        return np.column_stack([view[:, :3] @ np.linalg.inv(self._camera.k), view[:, 3]])

    def _light(
        self, light: LensShading, rgb: np.ndarray, met: _Met, weights: np.ndarray, cam_from_model: np.ndarray
    ) -> None:
        """Put colours into the light at the lens."""
        mesh = self._mesh
        away = self._camera.rays_cam(met.uv) / met.inverse_depth[:, None]
        points = camera_centre(cam_from_model) + away @ cam_from_model[:3, :3]
        normals = lookup.shading_normals(mesh.smooth_normals, mesh.face_cross, mesh.faces, met.face, weights, met.front)
        lit = lit_by_lamp(mesh, light, met.face, points, cam_from_model) if light.shadows else None
        factors = light.factors(points.astype(np.float32), normals, cam_from_model, lit)
        shown_codes(rgb, factors, light.curve)
