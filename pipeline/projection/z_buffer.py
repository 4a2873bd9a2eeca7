"""A z-buffer of a mesh in a pinhole camera, in numpy: the nearest face at each pixel centre, and its depth.

For interactive work, where starting a renderer would take longer; datasets are ray traced.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from ..camera.pinhole import PinholeCamera
from ..surface.mesh import TriangleMesh
from ..transforms import transform_points
from .spans import Spans, filled, spans_of

FARTHEST_PX = 1e5
"""Largest coordinate of a corner: beyond it, too little of a number's precision is left for the pixel."""


BLOCK = 1 << 13
"""Faces that are rasterised at once: few enough for a processor's cache."""


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
    for numbers, nearness in _faces_in_rows(mesh, camera, cam_from_model, faces):
        for span, offset, pixel in filled(nearness.spans, width):
            values = nearness.at(span, offset)
            np.maximum.at(inverse_depth, pixel, values)
            nearest = inverse_depth[pixel] == values
            shown[pixel[nearest]] = numbers[nearness.spans.triangle[span[nearest]]]
    return DepthRaster(inverse_depth.reshape(height, width), shown.reshape(height, width))


def inverse_depth_of(
    mesh: TriangleMesh, camera: PinholeCamera, cam_from_model: np.ndarray, faces: np.ndarray | None = None
) -> np.ndarray:
    """``(H, W)`` inverse depth as of :func:`rasterise_depth`, in less time."""
    height, width = camera.shape_hw
    inverse_depth = np.zeros(height * width)
    for _, nearness in _faces_in_rows(mesh, camera, cam_from_model, faces):
        for span, offset, pixel in filled(nearness.spans, width):
            np.maximum.at(inverse_depth, pixel, nearness.at(span, offset))
    return inverse_depth.reshape(height, width)


class _Nearness(NamedTuple):
    """Inverse depth along spans: ``(S,)`` at their first pixel, its change per column, its least and greatest value."""

    spans: Spans
    first: np.ndarray
    across: np.ndarray
    least: np.ndarray
    most: np.ndarray

    def at(self, span: np.ndarray, offset: np.ndarray) -> np.ndarray:
        values = offset * self.across[span]
        values += self.first[span]
        np.maximum(values, self.least[span], out=values)
        return np.minimum(values, self.most[span], out=values)


def _faces_in_rows(
    mesh: TriangleMesh, camera: PinholeCamera, cam_from_model: np.ndarray, faces: np.ndarray | None
) -> Iterator[tuple[np.ndarray, _Nearness]]:
    """The faces that may cover a pixel centre, block by block, and their spans."""
    points = transform_points(cam_from_model, mesh.vertices)
    width, height = camera.size_wh
    inverse = np.divide(1.0, points[:, 2], out=np.zeros(len(points)), where=points[:, 2] > 0)
    u, v = (
        points[:, axis] * inverse * focal + centre
        for axis, focal, centre in ((0, camera.fx, camera.cx), (1, camera.fy, camera.cy))
    )
    # corner by corner: numpy is slow at reductions along an axis of three
    a, b, c = (mesh.faces if faces is None else mesh.faces[faces]).T
    kept = np.minimum(np.minimum(inverse[a], inverse[b]), inverse[c]) > 0
    for values, size in ((u, width), (v, height)):
        of_a, of_b, of_c = values[a], values[b], values[c]
        low, high = np.minimum(np.minimum(of_a, of_b), of_c), np.maximum(np.maximum(of_a, of_b), of_c)
        # keep faces with a pixel centre in their bounds, and within the limit on coordinates
        kept &= (
            (np.ceil(low) <= np.floor(high))
            & (high >= 0)
            & (low <= size - 1)
            & (low > -FARTHEST_PX)
            & (high < FARTHEST_PX)
        )
    kept = np.flatnonzero(kept) if faces is None else faces[kept]
    for begin in range(0, len(kept), BLOCK):
        numbers = kept[begin : begin + BLOCK]
        corners = np.ascontiguousarray(mesh.faces[numbers].T)
        yield numbers, _nearness(u[corners], v[corners], inverse[corners], camera.size_wh)


def _nearness(u: np.ndarray, v: np.ndarray, inverse: np.ndarray, size_wh: tuple[int, int]) -> _Nearness:
    """Of triangles with corners ``(3, T)``."""
    spans = spans_of(u, v, size_wh)
    across, down = _gradient(u, v, inverse)
    triangle = spans.triangle
    first = inverse[0][triangle] + (
        (spans.first - u[0][triangle]) * across[triangle] + (spans.row - v[0][triangle]) * down[triangle]
    )
    # rounding must not carry the depth beyond that of the corners: faces seen edge-on are steep
    least, most = inverse.min(axis=0)[triangle], inverse.max(axis=0)[triangle]
    return _Nearness(spans, first, across[triangle], least, most)


def _gradient(u: np.ndarray, v: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Derivatives along columns and rows of what is affine in ``(3, T)`` triangles; 0 for those without area."""
    (x1, x2), (y1, y2), (w1, w2) = ((part[1] - part[0], part[2] - part[0]) for part in (u, v, values))
    area2 = x1 * y2 - x2 * y1
    inverse = np.divide(1.0, area2, out=np.zeros_like(area2), where=area2 != 0)
    return (w1 * y2 - w2 * y1) * inverse, (w2 * x1 - w1 * x2) * inverse


def is_within_limits(mesh: TriangleMesh, camera: PinholeCamera, cam_from_model: np.ndarray) -> bool:
    """Whether :func:`rasterise_depth` leaves out no face: all are in front of the camera, and not far off the image."""
    points = transform_points(cam_from_model, mesh.vertices)
    # NaN, of points behind the camera, is not within them
    return bool((np.abs(camera.project(points)) < FARTHEST_PX).all())


def inverse_depth_map(depth_mm: np.ndarray, valid: np.ndarray | None = None) -> np.ndarray:
    """``(H, W)`` depth in mm, 0 for background -> inverse depth in 1/mm, 0 also where ``valid`` is False."""
    seen = depth_mm > 0
    if valid is not None:
        seen &= valid
    return np.divide(1.0, depth_mm, out=np.zeros(depth_mm.shape, np.float32), where=seen, casting="same_kind")
