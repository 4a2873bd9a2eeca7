"""The colours of surface points in both colour modes, by the rule of :mod:`oneframe.colour.source_view`.

It is what the material of :mod:`oneframe.blender.render.material` computes at a shaded point, for many points at once.
"""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from ..projection.rays import Hits
from ..surface.mesh import TriangleMesh
from .anti_aliasing import filtered_image
from .footprint_filter import squares_for
from .lens_shading import LensShading
from .source_view import SourceView
from .vertex_colours import VertexColours

SurfaceColour = VertexColours | SourceView


@dataclass(frozen=True)
class ColouredSurface:
    """What every engine renders.

    Attributes
    ----------
    mesh
        The surface, model frame, mm.
    colours
        Sources of its colour, of which the first that saw a point is taken; none for geometry alone, in neutral grey
        and observed on front sides.
    unseen
        ``(V, 3)`` code values 0..1 of the vertices for what no frame saw; ``None``: neutral grey.
    pivot_model
        ``(3,)`` mm: the point whose distance determines the filter of anti-aliased views; the origin if left out.
    light
        The light at the lens, in which the colours are albedos, see :mod:`oneframe.colour.lens_shading`; ``None``: the
        colours are shown as they are.
    """

    mesh: TriangleMesh
    colours: tuple[SurfaceColour, ...] = ()
    unseen: np.ndarray | None = None
    pivot_model: np.ndarray = field(default_factory=lambda: np.zeros(3))
    light: LensShading | None = None


def source_of(colour: SurfaceColour) -> SourceView | None:
    """The view that a colour is taken from, if it tells which points were seen."""
    return colour if isinstance(colour, SourceView) else colour.source


class Points(NamedTuple):
    """N surface points that rays met.

    Attributes
    ----------
    hits
        The faces, and the places in them.
    x, y, depth_mm
        ``(N,)`` float32 pixel of the reference view, moved into it, and depth from its camera.
    may_be_seen
        ``(N,)`` bool: both cameras see the front of the face, and the pixel is inside the reference view.
    """

    hits: Hits
    x: np.ndarray
    y: np.ndarray
    depth_mm: np.ndarray
    may_be_seen: np.ndarray


class Texels:
    """An image ``(H, W)`` or ``(H, W, 4)`` for many lookups in single precision; coordinates outside are moved in."""

    def __init__(self, image: np.ndarray) -> None:
        self.height, self.width = image.shape[:2]
        self._channels = 1 if image.ndim == 2 else image.shape[2]
        flat = np.ascontiguousarray(image, np.float32).reshape(-1)
        # one number of 16 bytes for four channels: numpy gathers numbers ten times as fast as rows
        self._flat = flat if image.ndim == 2 else flat.view(np.complex128)

    def between(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """``(N,)`` float32 columns and rows -> ``(N, C)`` values, interpolated bilinearly."""
        x, y = self._moved_in(x, y)
        left, top = (
            np.minimum(at.astype(np.int32), max(size - 2, 0)) for at, size in ((x, self.width), (y, self.height))
        )
        across, down = (self._for_channels(at - corner.astype(np.float32)) for at, corner in ((x, left), (y, top)))
        right, below = int(self.width > 1), self.width * int(self.height > 1)
        first = (top * self.width + left).astype(np.intp)
        upper = _mixed(self._values(first), self._values(first, right), across)
        lower = _mixed(self._values(first, below), self._values(first, below + right), across)
        return _mixed(upper, lower, down).reshape(len(first), self._channels)

    def nearest(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """``(N,)`` float32 columns and rows -> ``(N, C)`` values of the nearest pixels."""
        column, row = (np.rint(at).astype(np.intp) for at in self._moved_in(x, y))
        return self._values(row * self.width + column).reshape(len(row), self._channels)

    def _moved_in(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return np.clip(x, 0, self.width - 1), np.clip(y, 0, self.height - 1)

    def _for_channels(self, weights: np.ndarray) -> np.ndarray:
        """As many weights as values: numpy is slow along an axis of four."""
        return np.stack([weights] * self._channels, axis=1).ravel()

    def _values(self, index: np.ndarray, offset: int = 0) -> np.ndarray:
        """The channels of N pixels, one after the other."""
        # "clip" checks nothing, which is faster
        return self._flat[offset:].take(index, mode="clip").view(np.float32)


def _mixed(first: np.ndarray, second: np.ndarray, share: np.ndarray) -> np.ndarray:
    """``first + share * (second - first)``, in place of ``second``."""
    second -= first
    second *= share
    second += first
    return second


class ImageShader:
    """Colours from the frame."""

    def __init__(self, source: SourceView) -> None:
        self._source = source
        image, surface = source.continued
        self._surface, self._image = Texels(surface), Texels(np.dstack([image, surface]))
        self._filtered: dict[int, tuple[Texels, float]] = {}

    def exact(self, points: Points, texel_share: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
        """``(N, 3)`` colours, see :data:`.CastRays` for the share; ``(N,)`` bool: the frame saw the point."""
        texels = self._image.between(points.x, points.y)
        rgb, own = texels[:, :3], _is_same(texels[:, 3], points, self._source)
        if texel_share > 0:
            nearest = self._image.nearest(points.x, points.y)
            same = _is_same(nearest[:, 3], points, self._source)
            rgb = rgb + (np.float32(texel_share) * same)[:, None] * (nearest[:, :3] - rgb)
        return rgb, own & points.may_be_seen

    def filtered(self, points: Points, scale: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The same, with means over pixels of this scale; ``(N,)`` bool: seen, but near the border of what was."""
        x, y = points.x, points.y
        seen = _is_same(self._surface.between(x, y)[:, 0], points, self._source) & points.may_be_seen
        side, offset = squares_for(scale)
        if side not in self._filtered:
            image, place = filtered_image(self._source, side)
            self._filtered[side] = Texels(image), place
        texels, place = self._filtered[side]
        total = texels.between(x - np.float32(place + offset), y - np.float32(place + offset))
        border = total[:, 3] > 0.5
        if offset > 0:
            for right, down in ((1, -1), (-1, 1), (1, 1)):
                shifted = (at + np.float32(sign * offset - place) for at, sign in ((x, right), (y, down)))
                # with the fourth channel: numpy is slow along an axis of three
                total += texels.between(*shifted)
            total *= np.float32(0.25)
        return total[:, :3], seen, seen & border


class VertexShader:
    """Colours of vertices, interpolated."""

    def __init__(self, mesh: TriangleMesh, colour: VertexColours) -> None:
        self._mesh, self._colour, self._source = mesh, colour, colour.source
        self._surface = None if self._source is None else Texels(self._source.continued[1])

    def exact(self, points: Points, _texel_share: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
        """As of :class:`ImageShader`."""
        corners = self._mesh.faces[points.hits.face]
        seen = self._colour.least[corners].all(axis=1) & points.may_be_seen
        if self._surface is not None and self._source is not None:
            seen &= _is_same(self._surface.between(points.x, points.y)[:, 0], points, self._source)
        return corner_means(self._colour.rgb[corners], points.hits), seen


def corner_means(values: np.ndarray, hits: Hits) -> np.ndarray:
    """``(N, 3, C)`` values at the corners of the faces -> ``(N, C)`` at the hits."""
    first, second, third = values[:, 0], values[:, 1], values[:, 2]
    return first + hits.second[:, None] * (second - first) + hits.third[:, None] * (third - first)


def _is_same(inverse_depth: np.ndarray, points: Points, source: SourceView) -> np.ndarray:
    return np.abs(inverse_depth * points.depth_mm - 1) <= source.depth_tolerance
