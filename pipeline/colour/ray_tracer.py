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
from ..kernels.lookup import FrameLookup, Met, Painted, interpolate, met_points, paint, shown_by, towards_lamp
from ..light.lens_light import received
from ..projection.edge_pixels import pixel_pattern
from ..projection.rendered_view import RenderedView
from ..projection.z_buffer import fronts, inverse_depth_map, nearest_at, nearest_at_centres, projected
from ..surface.mesh import TriangleMesh
from ..transforms import camera_centre, inverse_rigid
from .anti_aliasing import MISSED, OBSERVED, UNSEEN, filtered_image, footprint_scale, smoothed
from .footprint_filter import squares_for
from .lens_shading import LensShading, lit_by_lamp, shown_codes
from .seen_frame import SeenFrame
from .shading import ColouredSurface, SurfaceColour, source_of
from .vertex_colours import NEUTRAL, VertexColours

MOST_POINTS = 1 << 22
"""Points that are coloured at once, beside the pixels' centres: it bounds the memory."""

SIGNS = np.array([(-1, -1), (1, -1), (-1, 1), (1, 1)])
"""Of the lookups in an averaged frame."""


class _Painter:
    """Colours from one frame, or none."""

    def __init__(self, mesh: TriangleMesh, colour: SurfaceColour | None) -> None:
        self.source = None if colour is None else source_of(colour)
        self._mesh, self._vertex_rgb = mesh, None
        self._images: dict[int, tuple[np.ndarray, float]] = {}
        self._faces = np.ones(len(mesh.faces), bool)
        if self.source is not None:
            self._texels = np.dstack(self.source.continued).astype(np.float32)
            self._faces = self.source.facing_faces(mesh)
        if isinstance(colour, VertexColours):
            self._vertex_rgb = colour.rgb
            self._faces &= colour.least[mesh.faces].all(axis=1)

    def paint(self, seen: "_Seen", number: int, painted: Painted, *, filtered: bool, scale: float | None) -> None:
        """Enter what the frame of this number saw, where no other one gave a colour.

        Colours are means over pixels of a scale if it is given and they shall be filtered.
        """
        faces, met = seen.front & self._faces, seen.met
        if self.source is None:
            chosen = (met.face >= 0) & faces[met.face] & (painted.source == 0)
            painted.rgb[chosen] = NEUTRAL
        elif self._vertex_rgb is not None:
            chosen = shown_by(met, faces, self._lookup(self.source, seen, False, None)) & (painted.source == 0)
        else:
            paint(met, faces, self._lookup(self.source, seen, filtered, scale), number, painted)
            return
        if self._vertex_rgb is not None:
            interpolate(self._vertex_rgb, self._mesh.faces, seen.points, met, chosen, painted.rgb)
        painted.source[chosen] = number

    def _lookup(self, frame: SeenFrame, seen: "_Seen", filtered: bool, scale: float | None) -> FrameLookup:
        frame_from_view = frame.camera.k @ (frame.cam_from_model @ inverse_rigid(seen.pose))[:3]
        affine = np.column_stack([frame_from_view[:, :3] @ np.linalg.inv(seen.camera.k), frame_from_view[:, 3]])
        image, offsets, share = self._texels, np.zeros((0, 2)), 0.0
        if scale is not None and not filtered:
            share = min(scale * scale, 1.0)
        elif scale is not None:
            side, offset = squares_for(scale)
            if side not in self._images:
                self._images[side] = filtered_image(frame, side)
            image, place = self._images[side]
            offsets = offset * SIGNS[: 4 if offset > 0 else 1] - place
        return FrameLookup(
            tuple(affine.ravel().tolist()), self._texels, frame.depth_tolerance, ROUNDING_PX, image, offsets, share
        )


class _Seen(NamedTuple):
    """What rays of a view meet, its vertices in pixels, and the faces that show it their front; camera and pose."""

    met: Met
    points: np.ndarray
    front: np.ndarray
    camera: PinholeCamera
    pose: np.ndarray


class RayTracer:
    """Renders views of one surface."""

    def __init__(self, surface: ColouredSurface, camera: PinholeCamera, *, samples: int = 1) -> None:
        """Prepare what the views share; ``samples`` are rays in each pixel at an edge."""
        self._surface, self._mesh, self._camera = surface, surface.mesh, camera
        self._painters = [_Painter(surface.mesh, colour) for colour in surface.colours or (None,)]
        self._by_vertices = bool(surface.colours) and isinstance(surface.colours[0], VertexColours)
        self._is_smooth, self._pattern = samples > 1, pixel_pattern(samples)
        self._centres = camera.pixel_grid().reshape(-1, 2).astype(np.float64)

    def render(self, cam_from_model: np.ndarray) -> RenderedView:
        """Render a pose (4x4, mm)."""
        points = projected(self._mesh, self._camera, cam_from_model)
        raster = nearest_at_centres(points, self._mesh, self._camera)
        met = Met(self._centres, raster.face.ravel(), raster.inverse_depth.ravel())
        rgb, *others = self._coloured(met, points, cam_from_model, filtered=True)
        shape = self._camera.shape_hw
        depth_mm = inverse_depth_map(raster.inverse_depth)
        exact = RenderedView(rgb.reshape(*shape, 3), depth_mm, *(each.reshape(shape) for each in others))
        return self.smoothed(exact, cam_from_model) if self._is_smooth else exact

    def smoothed(self, exact: RenderedView, cam_from_model: np.ndarray) -> RenderedView:
        """An exact view of a pose, whose colours are filtered, anti-aliased: see :func:`.anti_aliasing.smoothed`."""
        scales = self._scales(cam_from_model)
        if not scales:
            return exact

        def cast(u: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            return self._in_pixels(cam_from_model, u, v)

        # of pixels that no frame colours, any
        scale = np.array(scales[:1] + scales, np.float32)[exact.source] if self._by_vertices else None
        return smoothed(exact, self._camera, cast, vertex_scale=scale)

    def _scales(self, cam_from_model: np.ndarray) -> list[float]:
        """The sides of a view's pixel in each frame, in views that are anti-aliased."""
        sources = [painter.source for painter in self._painters if self._is_smooth and painter.source is not None]
        return [footprint_scale(each, self._surface.pivot_model, self._camera, cam_from_model) for each in sources]

    def _in_pixels(self, cam_from_model: np.ndarray, u: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Several rays in each pixel: see :data:`.CastRays`."""
        count = len(self._pattern)
        points = projected(self._mesh, self._camera, cam_from_model)
        colours, kinds = np.zeros((len(u), count, 3), np.float32), np.full((len(u), count), MISSED, np.int8)
        for first in range(0, len(u), rows := max(1, MOST_POINTS // count)):
            block = slice(first, first + rows)
            uv = (np.stack([u[block], v[block]], axis=1)[:, None] + self._pattern).reshape(-1, 2)
            inverse_depth, face = nearest_at(self._mesh, self._camera, cam_from_model, uv)
            rgb, source, _ = self._coloured(Met(uv, face, inverse_depth), points, cam_from_model, filtered=False)
            colours[block] = rgb.reshape(-1, count, 3)
            kinds[block] = np.where(face < 0, MISSED, np.where(source > 0, OBSERVED, UNSEEN)).reshape(-1, count)
        return colours, kinds

    def _coloured(self, met: Met, points: np.ndarray, cam_from_model: np.ndarray, *, filtered: bool) -> Painted:
        """The colours of what rays meet, black for nothing."""
        mesh, count, scales = self._mesh, len(met.face), self._scales(cam_from_model)
        seen = _Seen(met, points, fronts(mesh, cam_from_model), self._camera, cam_from_model)
        hit, rgb = met.face >= 0, np.zeros((count, 3), np.float32)
        painted = Painted(rgb, np.zeros(count, np.uint8), np.zeros(count, bool))
        for number, painter in enumerate(self._painters):
            painter.paint(seen, number + 1, painted, filtered=filtered, scale=scales[number] if scales else None)
        unseen = hit & (painted.source == 0)
        if self._surface.unseen is not None:
            interpolate(self._surface.unseen, mesh.faces, points, met, unseen, rgb)
        else:
            rgb[unseen] = NEUTRAL
        if self._surface.light is not None:
            self._light(self._surface.light, seen, rgb, hit)
        return painted

    def _light(self, light: LensShading, seen: "_Seen", rgb: np.ndarray, hit: np.ndarray) -> None:
        """Put the colours of what was hit into the light at the lens."""
        mesh, pose, met, (lamp, distance_mm) = self._mesh, seen.pose, seen.met, light.at(seen.pose)
        centre, model_from_px = camera_centre(pose), pose[:3, :3].T @ np.linalg.inv(seen.camera.k)
        surface, lamp_from_lens = (mesh.smooth_normals, mesh.faces, mesh.is_flipped), lamp.place_model(pose) - centre
        ways = towards_lamp(
            surface, seen.points, met, tuple(lamp_from_lens.tolist()), tuple(model_from_px.ravel().tolist())
        )
        lit = np.ones(len(hit), np.float32) if light.shadows else None
        if lit is not None:
            lit[hit] = lit_by_lamp(mesh, light, met.face[hit], met_points(met, centre, model_from_px), pose)
        factors = light.factors_of(received(lamp, *ways, distance_mm, lit))
        # nothing is black
        factors[~hit] = 0
        shown_codes(rgb, factors, light.curve)
