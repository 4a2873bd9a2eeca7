"""Exact views at the pixels' centres: what Cycles renders for colours without light, in less time.

A z-buffer in double precision finds the face that a pixel shows (:mod:`oneframe.projection.z_buffer`). Embree's rays
(:mod:`oneframe.projection.rays`) do where it cannot, where a colour depends on the place in the face, for several rays
in a pixel, and where there are so many faces that rays take less time. Everything else is a formula in the pixel and
the depth. The point's pixel in a frame, (x, y, z), is A (u, v, 1) + b / depth, with A and b computed in double
precision, so that at the frame's own pose each pixel is looked up at its own place.

Of several frames, the first that saw a point colours it: the next one is looked up only where those before did not see
the point, so the time grows slowly with the frames.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ..camera.pinhole import PinholeCamera
from ..images.pixel_values import ROUNDING_PX
from ..projection.edge_pixels import pixel_pattern
from ..projection.rays import Hits, MeshRays
from ..projection.rendered_view import RenderedView
from ..projection.z_buffer import is_within_limits, rasterise_depth
from ..surface.mesh import TriangleMesh
from ..transforms import camera_centre, inverse_rigid
from .anti_aliasing import MISSED, OBSERVED, UNSEEN, footprint_scale, smoothed
from .lens_shading import CornerNormals, lit_by_lamp, shown_codes
from .shading import ColouredSurface, ImageShader, Points, SurfaceColour, VertexShader, corner_means, source_of
from .vertex_colours import NEUTRAL, VertexColours

BLOCK = 1 << 15
"""Rays that are cast and coloured at once: few enough for a processor's cache."""

FACES_A_PIXEL = 2
"""Faces in a pixel of the view from which on rays take less time than the z-buffer, whose time grows with the faces."""


class _Eye(NamedTuple):
    """A pose, and what follows from it.

    ``model_from_px`` ``(3, 3)`` gives a ray's direction from its pixel (u, v, 1), of length 1 along the optical axis;
    rays start at the depth ``start_mm``, before the surface, where single precision loses less. ``frames`` are A and b
    of this module for each frame, and ``scales`` the sides of a pixel in it, in a view that is to be anti-aliased.
    """

    cam_from_model: np.ndarray
    centre: np.ndarray
    start_mm: float
    model_from_px: np.ndarray
    frames: list[tuple[np.ndarray, np.ndarray]]
    scales: list[float] | None


class _Rays(NamedTuple):
    """Columns and rows of pixels, and as of :meth:`RayTracer._meet` what their rays meet, and its depth, mm."""

    u: np.ndarray
    v: np.ndarray
    hits: Hits
    depth_mm: np.ndarray

    def part(self, index: np.ndarray) -> "_Rays":
        """Some of the rays, if columns and rows are ``(N,)``."""
        hits = Hits(*(values[index] if len(values) else values for values in self.hits))
        return _Rays(self.u[index], self.v[index], hits, self.depth_mm[index])


_Meet = Callable[[_Eye, np.ndarray, np.ndarray], tuple[Hits, np.ndarray]]
"""As :meth:`RayTracer._meet`."""


class _Painter:
    """Colours from one frame, or none."""

    def __init__(self, mesh: TriangleMesh, colour: SurfaceColour | None) -> None:
        self.source = None if colour is None else source_of(colour)
        self._facing = None if self.source is None else self.source.facing_faces(mesh)
        self.shader: ImageShader | VertexShader | None = None
        if isinstance(colour, VertexColours):
            self.shader = VertexShader(mesh, colour)
        elif colour is not None:
            self.shader = ImageShader(colour)

    def colours(
        self, frame: tuple[np.ndarray, np.ndarray], rays: _Rays, scale: float | None, texel_share: float
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
        """``(N, 3)`` colours, means over pixels of a scale if it is given; ``(N,)`` seen; ``(N,)`` near the border."""
        points = self._points(frame, rays)
        if self.shader is None:
            return np.full((len(points.may_be_seen), 3), NEUTRAL, np.float32), points.may_be_seen, None
        if scale is not None and isinstance(self.shader, ImageShader):
            return self.shader.filtered(points, scale)
        return *self.shader.exact(points, texel_share), None

    def _points(self, frame: tuple[np.ndarray, np.ndarray], rays: _Rays) -> Points:
        """What the frame knows of the points that the rays meet."""
        u, v, hits, depth_mm = rays
        may_be_seen = (hits.face >= 0) & hits.front
        if self.source is None or self._facing is None:
            nothing = np.zeros(0, np.float32)
            return Points(hits, nothing, nothing, nothing, may_be_seen)
        may_be_seen &= self._facing[hits.face]
        nearness = 1 / depth_mm
        x, y, z = (
            (row[0] * u + (row[1] * v + row[2])).astype(np.float32).ravel() + np.float32(shift) * nearness
            for row, shift in zip(*frame, strict=True)
        )
        may_be_seen &= z > 0
        # where it is not, anything but a division by zero does
        divisor = np.where(may_be_seen, z, np.float32(1))
        x /= divisor
        y /= divisor
        width, height = self.source.camera.size_wh
        may_be_seen &= (x >= -ROUNDING_PX) & (x <= width - 1 + ROUNDING_PX)
        may_be_seen &= (y >= -ROUNDING_PX) & (y <= height - 1 + ROUNDING_PX)
        # z is the depth in the frame relative to that in the view
        z *= depth_mm
        return Points(hits, x, y, z, may_be_seen)


class RayTracer:
    """Renders views of one surface."""

    def __init__(
        self,
        surface: ColouredSurface,
        camera: PinholeCamera,
        *,
        samples: int = 1,
        rays: MeshRays | None = None,
    ) -> None:
        """Prepare what the views share.

        ``samples`` are rays in each pixel at an edge; ``rays`` are Embree's if left out.
        """
        mesh, colours, self._unseen = surface.mesh, surface.colours, surface.unseen
        self._mesh, self._camera, self._rays = mesh, camera, rays or MeshRays(mesh)
        self._painters = [_Painter(mesh, colour) for colour in colours or (None,)]
        self._pivot_model = None if samples == 1 else surface.pivot_model
        self._pattern = pixel_pattern(samples)
        self._light = surface.light
        self._normals = None if surface.light is None else CornerNormals(mesh)
        by_place = self._unseen is not None or any(isinstance(each, VertexColours) for each in colours)
        self._by_rays = by_place or len(mesh.faces) > FACES_A_PIXEL * camera.width * camera.height

    def render(self, cam_from_model: np.ndarray) -> RenderedView:
        """Render a pose (4x4, mm)."""
        meet: _Meet = self._meet
        if not self._by_rays and is_within_limits(self._mesh, self._camera, cam_from_model):
            meet = self._rasterised(cam_from_model)
        exact = self._exact(self._eye(cam_from_model), meet)
        return exact if self._pivot_model is None else self.smoothed(exact, cam_from_model)

    def smoothed(self, exact: RenderedView, cam_from_model: np.ndarray) -> RenderedView:
        """An exact view of a pose, whose colours are filtered, anti-aliased: see :func:`.anti_aliasing.smoothed`."""
        eye = self._eye(cam_from_model)
        if eye.scales is None:
            return exact

        def cast(u: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            return self._in_pixels(eye, u, v)

        vertex_colours = isinstance(self._painters[0].shader, VertexShader)
        # of pixels that no frame colours, any
        scale = np.array(eye.scales[:1] + eye.scales, np.float32)[exact.source] if vertex_colours else None
        return smoothed(exact, self._camera, cast, vertex_scale=scale)

    def _eye(self, cam_from_model: np.ndarray) -> _Eye:
        k_inverse = np.linalg.inv(self._camera.k)
        model_from_cam, frames, scales = inverse_rigid(cam_from_model), [], []
        for source in (painter.source for painter in self._painters):
            if source is None:
                frames.append((np.zeros((3, 3)), np.zeros(3)))
                continue
            frame_from_cam = source.camera.k @ (source.cam_from_model @ model_from_cam)[:3]
            frames.append((frame_from_cam[:, :3] @ k_inverse, frame_from_cam[:, 3]))
            if self._pivot_model is not None:
                scales.append(footprint_scale(source, self._pivot_model, self._camera, cam_from_model))
        return _Eye(
            cam_from_model,
            camera_centre(cam_from_model),
            max(float(cam_from_model[2, 3]) - 1.01 * self._mesh.radius, 0.0),
            cam_from_model[:3, :3].T @ k_inverse,
            frames,
            scales or None,
        )

    def _exact(self, eye: _Eye, meet: _Meet) -> RenderedView:
        """One ray a pixel; colours are means over pixels if the eye has scales."""
        shape = self._camera.shape_hw
        view = RenderedView(
            np.zeros((*shape, 3), np.float32),
            np.zeros(shape, np.float32),
            np.zeros(shape, np.uint8),
            np.zeros(shape, bool),
        )
        left, top, right, bottom = self._bounds(eye)
        u, rows = np.arange(left, right), max(1, BLOCK // max(right - left, 1))
        for first in range(top, bottom if len(u) else top, rows):
            v = np.arange(first, min(first + rows, bottom))[:, None]
            block = slice(first, first + len(v)), slice(left, right)
            hits, depth_mm = meet(eye, u, v)
            rgb, source, near = self._coloured(eye, _Rays(u, v, hits, depth_mm), filtered=True)
            shape = len(v), len(u)
            view.rgb[block] = rgb.reshape(*shape, 3)
            view.depth_mm[block] = (depth_mm * (hits.face >= 0)).reshape(shape)
            view.source[block] = source.reshape(shape)
            if near is not None:
                view.near_unseen[block] = near.reshape(shape)
        return view

    def _in_pixels(self, eye: _Eye, u: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Several rays in each pixel: see :data:`.CastRays`."""
        count = len(self._pattern)
        colours, kinds = np.empty((len(u), count, 3), np.float32), np.empty((len(u), count), np.int8)
        for first in range(0, len(u), rows := max(1, BLOCK // count)):
            block = slice(first, first + rows)
            right, down = self._pattern.T
            across, along = (at.ravel() for at in (u[block, None] + right, v[block, None] + down))
            hits, depth_mm = self._meet(eye, across, along)
            rgb, source, _ = self._coloured(eye, _Rays(across, along, hits, depth_mm), filtered=False)
            colours[block] = rgb.reshape(-1, count, 3)
            kinds[block] = np.where(source > 0, OBSERVED, np.where(hits.face >= 0, UNSEEN, MISSED)).reshape(-1, count)
        return colours, kinds

    def _coloured(self, eye: _Eye, rays: _Rays, *, filtered: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
        """``(N, 3)`` colours, the ``(N,)`` number of the frame of each, from 1, or 0, and what is near its border."""

        def painted(number: int, part: _Rays) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
            scale = None if eye.scales is None else eye.scales[number]
            share = 0.0 if filtered or scale is None else min(scale * scale, 1.0)
            return self._painters[number].colours(eye.frames[number], part, scale if filtered else None, share)

        hits = rays.hits
        if len(self._painters) == 1:
            rgb, seen, near = painted(0, rays)
            return self._finished(eye, rays, rgb, seen), seen.astype(np.uint8), near
        u, v = np.broadcast_arrays(rays.u, rays.v)
        flat = rays._replace(u=u.ravel(), v=v.ravel())
        rgb, source = np.zeros((len(hits.face), 3), np.float32), np.zeros(len(hits.face), np.uint8)
        border = np.zeros(len(source), bool)
        left = np.flatnonzero((hits.face >= 0) & hits.front)
        for number in range(len(self._painters)):
            if len(left) == 0:
                break
            colours, seen, near = painted(number, flat.part(left))
            rgb[left[seen]], source[left[seen]] = colours[seen], number + 1
            if near is not None:
                border[left[near]] = True
            left = left[~seen]
        return self._finished(eye, flat, rgb, source > 0), source, border

    def _bounds(self, eye: _Eye) -> tuple[int, int, int, int]:
        """First and end column and row of the pixels that can show the surface."""
        width, height = self._camera.size_wh
        x, y, z = np.linalg.inv(eye.model_from_px) @ (self._mesh.box - eye.centre).T
        if z.min() <= 0:
            return 0, 0, width, height
        (left, right), (top, bottom) = (
            (int(np.clip(np.floor(at.min()), 0, size)), int(np.clip(np.ceil(at.max()) + 1, 0, size)))
            for at, size in ((x / z, width), (y / z, height))
        )
        return left, top, right, bottom

    def _rasterised(self, cam_from_model: np.ndarray) -> _Meet:
        """What gives the same as :meth:`_meet` at the pixels' centres, without places in the faces."""
        raster = rasterise_depth(self._mesh, self._camera, cam_from_model)
        front = self._mesh.front_facing(camera_centre(cam_from_model))
        nothing = np.zeros(0, np.float32)

        def meet(eye: _Eye, u: np.ndarray, v: np.ndarray) -> tuple[Hits, np.ndarray]:
            block = slice(v[0, 0], v[-1, 0] + 1), slice(u[0], u[-1] + 1)
            face, nearness = (values[block].ravel() for values in (raster.face, raster.inverse_depth))
            depth_mm = np.divide(1, nearness, out=np.ones(len(face)), where=nearness > 0).astype(np.float32)
            return Hits(face, depth_mm - np.float32(eye.start_mm), front[face], nothing, nothing), depth_mm

        return meet

    def _meet(self, eye: _Eye, u: np.ndarray, v: np.ndarray) -> tuple[Hits, np.ndarray]:
        """Cast rays through pixels, whose columns and rows are broadcast: what N rays meet, and ``(N,)`` its depth.

        The depth is in mm, and 1 for a miss.
        """
        shape = np.broadcast_shapes(u.shape, v.shape)
        directions, origins = np.empty((2, *shape, 3), np.float32)
        for axis, (right, down, ahead) in enumerate(eye.model_from_px):
            across, along = right * u, down * v + ahead
            np.add(across, along, out=directions[..., axis], casting="same_kind")
            across, along = eye.start_mm * across, eye.start_mm * along + eye.centre[axis]
            np.add(across, along, out=origins[..., axis], casting="same_kind")
        hits = self._rays.first_hits(origins.reshape(-1, 3), directions.reshape(-1, 3))
        depth_mm = np.where(hits.face >= 0, np.add(hits.distance, eye.start_mm, dtype=np.float64), 1)
        return hits, depth_mm.astype(np.float32)

    def _finished(self, eye: _Eye, rays: _Rays, rgb: np.ndarray, seen: np.ndarray) -> np.ndarray:
        """The colours in their light, in place, with those of what no frame saw, and black without a hit."""
        hits = rays.hits
        hit = hits.face >= 0
        unseen = np.flatnonzero(hit & ~seen)
        if self._unseen is None:
            rgb[unseen] = NEUTRAL
        else:
            part = Hits(*(values[unseen] for values in hits))
            rgb[unseen] = corner_means(self._unseen[self._mesh.faces[part.face]], part)
        if self._light is not None and self._normals is not None:
            points = np.empty((3, len(hits.face)), np.float32)
            for point, (right, down, ahead), centre in zip(points, eye.model_from_px, eye.centre, strict=True):
                direction = (right * rays.u).astype(np.float32) + (down * rays.v + ahead).astype(np.float32)
                np.multiply(direction.ravel(), rays.depth_mm, out=point)
                point += np.float32(centre)
            normals = self._normals.at(hits.face, points.T, hits.front)
            lit = None
            if self._light.shadows:
                lit = lit_by_lamp(
                    self._rays, self._light, hits.face, np.ascontiguousarray(points.T), eye.cam_from_model
                )
            factors = self._light.factors(points.T, normals, eye.cam_from_model, lit)
            shown_codes(rgb, factors, self._light.curve)
        rgb[~hit] = 0
        return rgb
