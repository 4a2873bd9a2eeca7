"""A z-buffer of a mesh in a pinhole camera, in numpy: the nearest face at each pixel centre, and its depth.

For interactive work, where starting a renderer would take longer, and for datasets of the engine raster.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from ..camera.pinhole import PinholeCamera
from ..surface.mesh import TriangleMesh
from ..transforms import transform_points
from .spans import filled, spans_of

FARTHEST_PX = 1e5
"""Largest coordinate of a corner: beyond it, too little of a number's precision is left for the pixel."""

SIDES_PX = 2, 4
"""Sizes of boxes around small faces: their pixels are tested one by one; larger faces are filled in spans."""

OUTSIDE = 1e-9
"""How far outside a small face, in barycentrics, a centre may be: rounding leaves no gap between neighbours."""

BLOCK = 1 << 16
"""Faces that are rasterised at once: few enough for a processor's cache, and enough for numpy."""


class DepthRaster(NamedTuple):
    """The nearest surface at each pixel centre.

    Attributes
    ----------
    inverse_depth
        ``(H, W)`` float64, 1/mm along the optical axis; 0 where there is no surface.
    face
        ``(H, W)`` int64 index of the face, -1 where there is none.
    """

    inverse_depth: np.ndarray
    face: np.ndarray

    @property
    def depth_mm(self) -> np.ndarray:
        """``(H, W)`` float64 along the optical axis; 0 where there is no surface."""
        inverse = self.inverse_depth
        return np.divide(1.0, inverse, out=np.zeros_like(inverse), where=inverse > 0)


def rasterise_depth(
    mesh: TriangleMesh, camera: PinholeCamera, cam_from_model: np.ndarray, faces: np.ndarray | None = None
) -> DepthRaster:
    """Rasterise a mesh, both sides of its faces, and keep the nearest face at each pixel centre.

    Faces with a corner at or behind the plane of the camera centre are left out: there is no near-plane clipping.

    Parameters
    ----------
    mesh, camera, cam_from_model
        What is seen, and from where (4x4, mm).
    faces
        ``(N,)`` the faces that count, all if ``None``. Of a closed surface, seen from outside, its front faces do.

    Notes
    -----
    The inverse depth of a plane is affine in the pixel, so interpolation along the pixels of a row is exact.
    """
    height, width = camera.shape_hw
    inverse_depth, shown = np.zeros(height * width), np.full(height * width, -1)
    for pixel, values, face in _covered(mesh, camera, cam_from_model, faces):
        np.maximum.at(inverse_depth, pixel, values)
        nearest = inverse_depth[pixel] == values
        shown[pixel[nearest]] = face[nearest]
    return DepthRaster(inverse_depth.reshape(height, width), shown.reshape(height, width))


def inverse_depth_of(
    mesh: TriangleMesh, camera: PinholeCamera, cam_from_model: np.ndarray, faces: np.ndarray | None = None
) -> np.ndarray:
    """``(H, W)`` inverse depth as of :func:`rasterise_depth`, in less time."""
    height, width = camera.shape_hw
    inverse_depth = np.zeros(height * width)
    for pixel, values, _ in _covered(mesh, camera, cam_from_model, faces):
        np.maximum.at(inverse_depth, pixel, values)
    return inverse_depth.reshape(height, width)


_Covered = Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]
"""``(N,)`` pixels ``row * width + column`` that faces cover, their inverse depth there, and which faces."""


def _covered(
    mesh: TriangleMesh, camera: PinholeCamera, cam_from_model: np.ndarray, faces: np.ndarray | None
) -> _Covered:
    points = transform_points(cam_from_model, mesh.vertices)
    # NaN behind the camera: it is within no bounds
    inverse = np.divide(1.0, points[:, 2], out=np.full(len(points), np.nan), where=points[:, 2] > 0)
    projected = (
        points[:, 0] * inverse * camera.fx + camera.cx,
        points[:, 1] * inverse * camera.fy + camera.cy,
        inverse,
    )
    counted = np.arange(len(mesh.faces)) if faces is None else faces
    for begin in range(0, len(counted), BLOCK):
        numbers = counted[begin : begin + BLOCK]
        corners = np.ascontiguousarray(mesh.faces[numbers].T, dtype=np.intp)
        for pixel, values, face in _block(corners, projected, camera.size_wh):
            yield pixel, values, numbers[face]


def _block(
    corners: np.ndarray, projected: tuple[np.ndarray, np.ndarray, np.ndarray], size_wh: tuple[int, int]
) -> _Covered:
    """A block of faces, whose corners ``(3, T)`` are vertices with these columns, rows and inverse depths."""
    covers, inside = (np.ones(corners.shape[1], dtype=bool) for _ in range(2))
    u, v = (values[corners] for values in projected[:2])
    lows, lengths = [], []
    for (a, b, c), size in zip((u, v), size_wh, strict=True):
        # corner by corner: numpy is slow at reductions along an axis of three
        low, high = np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)
        first, last = np.ceil(low), np.floor(high)
        covers &= (first <= last) & (last >= 0) & (first < size) & (low > -FARTHEST_PX) & (high < FARTHEST_PX)
        inside &= (first >= 0) & (last < size)
        lows.append(first)
        lengths.append(last - first)
    side = np.where(covers & inside, np.maximum(*lengths) + 1, np.where(covers, np.inf, 0))
    smaller = 0.0
    for at_most in (*SIDES_PX, np.inf):
        group = np.flatnonzero((side > smaller) & (side <= at_most))
        smaller = at_most
        if len(group) == 0:
            continue
        of_group = u.take(group, axis=1), v.take(group, axis=1), projected[2][corners.take(group, axis=1)]
        if at_most == np.inf:
            found = _in_spans(*of_group, size_wh)
        else:
            found = _in_boxes(*of_group, (lows[0][group], lows[1][group]), int(at_most), size_wh[0])
        for pixel, values, face in found:
            yield pixel, values, group[face]


def _in_boxes(
    u: np.ndarray, v: np.ndarray, inverse: np.ndarray, low: tuple[np.ndarray, np.ndarray], side: int, width: int
) -> _Covered:
    """Triangles with corners ``(3, T)`` in boxes from ``low`` of at most ``side`` px, a pixel of all boxes at once."""
    (x1, x2), (y1, y2) = ((part[1] - part[0], part[2] - part[0]) for part in (u, v))
    area2 = x1 * y2 - x2 * y1
    scale = np.divide(1.0, area2, out=np.full_like(area2, np.nan), where=area2 != 0)
    right, down = low[0] - u[0], low[1] - v[0]
    across, along = [y2 * scale, -y1 * scale], [-x2 * scale, x1 * scale]
    weights = [right * each + down * other for each, other in zip(across, along, strict=True)]
    for of_corners, sums in ((across, 0), (along, 0), (weights, 1)):
        of_corners.append(sums - of_corners[0] - of_corners[1])
    first = (low[1] * width + low[0]).astype(np.intp)
    for row in range(side):
        second, third, rest = (at + row * change for at, change in zip(weights, along, strict=True))
        for column in range(side):
            covered = np.flatnonzero(np.minimum(np.minimum(second, third), rest) >= -OUTSIDE)
            values = rest[covered] * inverse[0][covered]
            values += second[covered] * inverse[1][covered]
            values += third[covered] * inverse[2][covered]
            yield first[covered] + (row * width + column), values, covered
            for at, change in zip((second, third, rest), across, strict=True):
                at += change


def _in_spans(u: np.ndarray, v: np.ndarray, inverse: np.ndarray, size_wh: tuple[int, int]) -> _Covered:
    """Triangles of any size with corners ``(3, T)``."""
    spans = spans_of(u, v, size_wh)
    across, down = _gradient(u, v, inverse)
    triangle = spans.triangle
    at_first = inverse[0][triangle] + (
        (spans.first - u[0][triangle]) * across[triangle] + (spans.row - v[0][triangle]) * down[triangle]
    )
    # rounding must not carry the depth beyond that of the corners: faces seen edge-on are steep
    least, most = inverse.min(axis=0)[triangle], inverse.max(axis=0)[triangle]
    for span, offset, pixel in filled(spans, size_wh[0]):
        of_face = triangle[span]
        values = at_first[span] + offset * across[of_face]
        yield pixel, np.clip(values, least[span], most[span]), of_face


def _gradient(u: np.ndarray, v: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Derivatives along columns and rows of what is affine in ``(3, T)`` triangles; 0 for those without area."""
    (x1, x2), (y1, y2), (w1, w2) = ((part[1] - part[0], part[2] - part[0]) for part in (u, v, values))
    area2 = x1 * y2 - x2 * y1
    inverse = np.divide(1.0, area2, out=np.zeros_like(area2), where=area2 != 0)
    return (w1 * y2 - w2 * y1) * inverse, (w2 * x1 - w1 * x2) * inverse


def is_within_limits(mesh: TriangleMesh, camera: PinholeCamera, cam_from_model: np.ndarray) -> bool:
    """Whether :func:`rasterise_depth` leaves out no face: the box around all is in front, and not far off the image."""
    box = transform_points(cam_from_model, mesh.box)
    return bool((box[:, 2] > 0).all() and (np.abs(camera.project(box)) < FARTHEST_PX).all())


def inverse_depth_map(depth_mm: np.ndarray, valid: np.ndarray | None = None) -> np.ndarray:
    """``(H, W)`` depth in mm, 0 for background -> inverse depth in 1/mm, 0 also where ``valid`` is False."""
    seen = depth_mm > 0
    if valid is not None:
        seen &= valid
    return np.divide(1.0, depth_mm, out=np.zeros(depth_mm.shape, np.float32), where=seen, casting="same_kind")
