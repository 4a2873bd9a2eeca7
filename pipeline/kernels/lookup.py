"""What a frame knows of points of a surface, and values of the surface's vertices at them.

A point's homogeneous pixel in a frame is A (u, v, 1) + b w, with (u, v) its image point in a view and w its inverse
depth there, so that at the frame's own pose each pixel is looked up at its own place.
"""

from typing import NamedTuple

import numpy as np

from .compiled import compiled
from .nearest_face import corner_areas

BLOCK = 1024
"""Points that :func:`paint` colours together."""


class Met(NamedTuple):
    """What N rays meet: image points ``(N, 2)``, faces ``(N,)``, -1 for none, and inverse depths ``(N,)``."""

    uv: np.ndarray
    face: np.ndarray
    inverse_depth: np.ndarray


class FrameLookup(NamedTuple):
    """A frame as it colours a view.

    Attributes
    ----------
    affine
        The twelve numbers of the ``(3, 4)`` matrix of A and b, row by row.
    texels
        ``(H, W, 4)`` float32: the frame, and the inverse depth of what it shows.
    tolerance, margin
        Relative difference of a point's own inverse depth from that, and pixels outside the frame.
    image, offsets
        Colours are means over lookups in the image ``(H, W, 4)`` at offsets ``(K, 2)`` px, whose last channel marks
        what is near that which the frame did not see; of the texels themselves without offsets.
    share
        Of this mean so much is replaced by the nearest texel's colour, where that shows the point's surface.
    """

    affine: tuple[float, ...]
    texels: np.ndarray
    tolerance: float
    margin: float
    image: np.ndarray
    offsets: np.ndarray
    share: float


class Painted(NamedTuple):
    """Of N points the colours ``(N, 3)``, the number of the frame that gave them, 0 for none, and what is beside."""

    rgb: np.ndarray
    source: np.ndarray
    near_unseen: np.ndarray


@compiled
def fronts(cross: np.ndarray, offsets: np.ndarray, centre: np.ndarray) -> np.ndarray:
    """``(F,)`` bool: the faces, of planes ``cross . x = offset``, that show a viewpoint their front."""
    front = np.empty(len(cross), np.bool_)
    for face in range(len(cross)):
        along = cross[face, 0] * centre[0] + cross[face, 1] * centre[1] + cross[face, 2] * centre[2]
        front[face] = along > offsets[face]
    return front


@compiled
def _pixels_around(height: int, width: int, x: float, y: float) -> tuple[int, int, int, int, np.float32, np.float32]:
    """Rows above and below a place, columns left and right, and how far it is from the first; moved in if outside."""
    x, y = min(max(x, 0.0), width - 1.0), min(max(y, 0.0), height - 1.0)
    left, top = min(int(x), max(width - 2, 0)), min(int(y), max(height - 2, 0))
    return top, min(top + 1, height - 1), left, min(left + 1, width - 1), np.float32(x - left), np.float32(y - top)


@compiled
def _interpolated(image: np.ndarray, around: tuple[int, int, int, int, np.float32, np.float32], channel: int) -> float:
    # images are in single precision, and so is a mean of their pixels: it takes half of the time
    (top, below, left, right, across, down), one = around, np.float32(1)
    upper = image[top, left, channel] * (one - across) + image[top, right, channel] * across
    lower = image[below, left, channel] * (one - across) + image[below, right, channel] * across
    return upper * (one - down) + lower * down


@compiled
def _place(
    uvw: tuple[float, float, float], affine: tuple[float, ...], height: int, width: int, margin: float
) -> tuple[float, float, float]:
    """Column, row and depth in a frame of a point, given by pixel and inverse depth; depth 0 outside the frame."""
    u, v, w = uvw
    x0, x1, x2, x3, y0, y1, y2, y3, z0, z1, z2, z3 = affine
    z = z0 * u + z1 * v + z2 + z3 * w
    if z <= 0:
        return 0.0, 0.0, 0.0
    x, y = (x0 * u + x1 * v + x2 + x3 * w) / z, (y0 * u + y1 * v + y2 + y3 * w) / z
    inside = -margin <= x <= width - 1 + margin and -margin <= y <= height - 1 + margin
    return x, y, z / w if inside else 0.0


@compiled
def shown_by(met: Met, faces: np.ndarray, frame: FrameLookup) -> np.ndarray:
    """``(N,)`` bool: points on some of the faces ``(F,)`` bool that a frame shows."""
    # arrays out of their tuples at once: in the loop each is a reference to count
    (uv, face, inverse_depth), (affine, texels, tolerance, margin) = met, frame[:4]
    shown, height, width = np.zeros(len(face), np.bool_), texels.shape[0], texels.shape[1]
    for number in range(len(shown)):
        if face[number] >= 0 and faces[face[number]]:
            uvw = (uv[number, 0], uv[number, 1], inverse_depth[number])
            x, y, depth = _place(uvw, affine, height, width, margin)
            around = _pixels_around(height, width, x, y)
            shown[number] = depth > 0 and abs(_interpolated(texels, around, 3) * depth - 1) <= tolerance
    return shown


@compiled
def _places(met: Met, faces: np.ndarray, frame: FrameLookup, painted: Painted, first: int, places: np.ndarray) -> None:
    """Enter columns, rows and depths, as of :func:`_place`, of points from a first one on that have no colour yet.

    The frame's texels there come into the processor's cache.
    """
    (uv, face, inverse_depth), sources, (affine, texels, _, margin) = met, painted.source, frame[:4]
    height, width, flat = texels.shape[0], texels.shape[1], texels.ravel()
    corners, touched = np.empty(len(places), np.int64), np.zeros(1, np.float32)
    for place in range(len(places)):
        number, x, y, depth = first + place, 0.0, 0.0, 0.0
        if face[number] >= 0 and sources[number] == 0 and faces[face[number]]:
            uvw = (uv[number, 0], uv[number, 1], inverse_depth[number])
            x, y, depth = _place(uvw, affine, height, width, margin)
        places[place, 0], places[place, 1], places[place, 2] = x, y, depth
        top, _, left = _pixels_around(height, width, x, y)[:3]
        corners[place] = 4 * (top * width + left)
    below = 4 * width if height > 1 else 0
    # memory answers many questions at once if a loop is so short that processors run ahead in it
    for place in range(len(places)):
        touched[0] += flat[corners[place]] + flat[corners[place] + below]


@compiled
def paint(met: Met, faces: np.ndarray, frame: FrameLookup, source: int, painted: Painted) -> None:
    """Enter colours of a frame, whose number is ``source``, at points on some of the faces that have none yet."""
    rgb, sources, near_unseen = painted
    _, texels, tolerance, _, image, offsets, share = frame
    height, width, count, block = texels.shape[0], texels.shape[1], len(offsets), np.empty((BLOCK, 3))
    for first in range(0, len(sources), BLOCK):
        places = block[: len(sources) - first]
        _places(met, faces, frame, painted, first, places)
        for place in range(len(places)):
            number, x, y, depth = first + place, places[place, 0], places[place, 1], places[place, 2]
            around = _pixels_around(height, width, x, y)
            if not (depth > 0 and abs(_interpolated(texels, around, 3) * depth - 1) <= tolerance):
                continue
            sources[number] = source
            if count == 0:
                for channel in range(3):
                    rgb[number, channel] = _interpolated(texels, around, channel)
            for lookup in range(count):
                around = _pixels_around(height, width, x + offsets[lookup, 0], y + offsets[lookup, 1])
                for channel in range(3):
                    value = _interpolated(image, around, channel)
                    rgb[number, channel] = value if lookup == 0 else rgb[number, channel] + value
                if lookup == 0 and _interpolated(image, around, 3) > 0.5:
                    near_unseen[number] = True
            if count > 1:
                for channel in range(3):
                    rgb[number, channel] /= count
            if share > 0:
                row, column = min(max(int(np.rint(y)), 0), height - 1), min(max(int(np.rint(x)), 0), width - 1)
                if abs(texels[row, column, 3] * depth - 1) <= tolerance:
                    for channel in range(3):
                        rgb[number, channel] += share * (texels[row, column, channel] - rgb[number, channel])


@compiled
def interpolate(
    values: np.ndarray, faces: np.ndarray, points: np.ndarray, met: Met, chosen: np.ndarray, means: np.ndarray
) -> None:
    """Enter means of values ``(V, C)`` of the corners of faces, of :func:`.projected` points, at chosen points."""
    for number in range(len(chosen)):
        if not chosen[number]:
            continue
        face = met.face[number]
        a, b, c = faces[face, 0], faces[face, 1], faces[face, 2]
        at_a, at_b, at_c = corner_areas(points, (a, b, c), met.uv[number, 0], met.uv[number, 1])
        total = at_a + at_b + at_c
        share = 1 / total if total != 0 else 0.0
        for channel in range(values.shape[1]):
            mean = at_a * values[a, channel] + at_b * values[b, channel] + at_c * values[c, channel]
            means[number, channel] = share * mean


@compiled
def towards_lamp(
    surface: tuple[np.ndarray, np.ndarray, np.ndarray],
    points: np.ndarray,
    met: Met,
    lamp: tuple[float, ...],
    model_from_px: tuple[float, ...],
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """What :func:`.received` asks of what rays from a lens meet of normals, faces and which of these are flipped.

    The lamp is seen from the lens, in the model's axes, mm; a ray goes along a matrix, row by row, times (u, v, 1).
    """
    (normals, faces, flipped), (uv, met_face, inverse_depth) = surface, met
    (lamp_x, lamp_y, lamp_z), (x0, x1, x2, y0, y1, y2, z0, z1, z2) = lamp, model_from_px
    along, squared, off_axis = np.zeros((3, len(met_face)), np.float32)
    for number in range(len(met_face)):
        face = met_face[number]
        if face < 0:
            continue
        u, v, w = uv[number, 0], uv[number, 1], inverse_depth[number]
        a, b, c = faces[face, 0], faces[face, 1], faces[face, 2]
        at_a, at_b, at_c = corner_areas(points, (a, b, c), u, v)
        nx = at_a * normals[a, 0] + at_b * normals[b, 0] + at_c * normals[c, 0]
        ny = at_a * normals[a, 1] + at_b * normals[b, 1] + at_c * normals[c, 1]
        nz = at_a * normals[a, 2] + at_b * normals[b, 2] + at_c * normals[c, 2]
        ray_x, ray_y, ray_z = x0 * u + x1 * v + x2, y0 * u + y1 * v + y2, z0 * u + z1 * v + z2
        # all w times as long
        x, y, z = lamp_x * w - ray_x, lamp_y * w - ray_y, lamp_z * w - ray_z
        normal = np.float32(w * w) * np.float32(max(nx * nx + ny * ny + nz * nz, 1e-24))
        # on the side that is seen
        outwards = x * nx + y * ny + z * nz if flipped[face] else -(x * nx + y * ny + z * nz)
        along[number] = np.float32(outwards) / np.sqrt(normal)
        squared[number] = np.float32(x * x + y * y + z * z) / np.float32(w * w)
        off_axis[number] = ray_x * ray_x + ray_y * ray_y + ray_z * ray_z - 1
    return along, squared, off_axis


@compiled
def met_points(met: Met, centre: np.ndarray, model_from_px: np.ndarray) -> np.ndarray:
    """``(M, 3)`` float32 points that M rays from a centre meet; they go along a matrix ``(3, 3)`` times (u, v, 1)."""
    uv, face, inverse_depth = met
    points, count = np.empty((len(face), 3), np.float32), 0
    for number in range(len(face)):
        if face[number] < 0:
            continue
        u, v, depth = uv[number, 0], uv[number, 1], 1 / inverse_depth[number]
        for axis in range(3):
            away = model_from_px[axis, 0] * u + model_from_px[axis, 1] * v + model_from_px[axis, 2]
            points[count, axis] = centre[axis] + away * depth
        count += 1
    return points[:count]


@compiled
def seen_from(
    place: np.ndarray, look: np.ndarray, points: np.ndarray, least: float, size: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """``(N, 2)`` pixels and ``(N,)`` depths of points, seen from a place with a rotation ``(3, 3)``; focal, principal.

    Focal length and principal point ``(2,)`` are such that an image of so many columns and rows just shows the points.
    The depth is 0 where the cosine between the line of sight and the axis z is below the least one.
    """
    uv, depths, low, high = np.zeros((len(points), 2)), np.zeros(len(points)), np.full(2, np.inf), np.full(2, -np.inf)
    for number in range(len(points)):
        x, y, z = points[number, 0] - place[0], points[number, 1] - place[1], points[number, 2] - place[2]
        depth = look[2, 0] * x + look[2, 1] * y + look[2, 2] * z
        if depth > 0 and depth >= least * np.sqrt(x * x + y * y + z * z):
            depths[number] = depth
            for axis in range(2):
                slope = (look[axis, 0] * x + look[axis, 1] * y + look[axis, 2] * z) / depth
                uv[number, axis] = slope
                low[axis], high[axis] = min(low[axis], slope), max(high[axis], slope)
    focal = (size - 1) / np.maximum(high - low, 1e-12)
    for axis in range(2):
        uv[:, axis] = focal[axis] * (uv[:, axis] - low[axis])
    return uv, depths, focal, -focal * low
