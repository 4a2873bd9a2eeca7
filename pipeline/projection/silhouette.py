"""Exact silhouette of a mesh in a camera, also beyond the image, from its silhouette edges and without rendering.

Orient every triangle so that its image has the same winding. Then the sum of the winding numbers of all triangles
around a pixel is the number of surface layers that cover it, front and back faces alike, and the pixel belongs to the
silhouette if that number is not zero. The half-edges of neighbouring triangles cancel in the sum. Few edges remain:
those between a front and a back face, and open boundaries. Nothing is assumed about the mesh: it may be open,
non-manifold, self-intersecting or inconsistently wound.

Notes
-----
Winding numbers are counted along pixel rows. Each crossing of an edge with a row is computed once per edge, and the
test whether a vertex is above a row once per vertex. So every triangle's loop stays closed under rounding, and the sum
is an exact integer: a pixel can only be wrong if its centre lies on an edge within rounding. The row rule is half-open
(a vertex exactly on a row is above it), so a shared vertex counts once. A pixel belongs to the silhouette if its
*centre* does, as in a renderer with one sample per pixel.

An edge through the plane of the camera centre ends at a point at infinity, and its part behind the plane is left out;
the part of a face's loop along the line at infinity crosses either all rows or none. There is no near plane.

The silhouette as the set where the winding number changes: Sander et al., "Silhouette clipping", SIGGRAPH 2000.
"""

from dataclasses import dataclass

import numpy as np

from ..camera.pinhole import PinholeCamera
from ..surface.mesh import TriangleMesh
from ..transforms import camera_centre

Window = tuple[int, int, int, int]
"""Pixels x0 <= x < x1, y0 <= y < y1 as (x0, y0, x1, y1); it may reach beyond the image."""


def canvas(camera: PinholeCamera) -> Window:
    """The window of three image widths by three heights around the image in which BOP counts ``px_count_all``."""
    return -camera.width, -camera.height, 2 * camera.width, 2 * camera.height


@dataclass(frozen=True)
class SilhouetteEdges:
    """The edges of a mesh and the faces next to them: the part that does not depend on the pose. Build once per mesh.

    Vertices are compared by index: a mesh whose faces share no vertices gives the right silhouette, but slowly.

    Attributes
    ----------
    mesh
        The mesh, in the model frame.
    ends
        ``(2, E)`` int32 vertex indices of the undirected edges, smaller index first.
    half_edges
        ``(2, E)`` the first two half-edges on each edge: f if face f runs from the smaller to the larger vertex index,
        F + f if it runs the other way, 2F for none.
    further_edges, further_half_edges
        ``(M,)`` edge, ``(M,)`` half-edge: the third and later half-edges of non-manifold edges.
    face_edges
        ``(F, 3)`` int32 the edge from each corner of a face to the next.
    """

    mesh: TriangleMesh
    ends: np.ndarray
    half_edges: np.ndarray
    further_edges: np.ndarray
    further_half_edges: np.ndarray
    face_edges: np.ndarray

    @classmethod
    def of(cls, mesh: TriangleMesh) -> "SilhouetteEdges":
        """Find the edges of a mesh."""
        # int32 where it is enough: millions of faces have tens of millions of half-edges
        face_count, start = len(mesh.faces), mesh.faces
        end = np.roll(start, -1, axis=1)
        key = (np.minimum(start, end).astype(np.int64) * len(mesh.vertices) + np.maximum(start, end)).ravel()
        half_edge = (np.arange(face_count, dtype=np.int32)[:, None] + np.int32(face_count) * (start > end)).ravel()
        order = np.argsort(key, kind="stable")
        key, half_edge = key[order], half_edge[order]
        is_first = np.diff(key, prepend=-1) != 0
        edge = np.cumsum(is_first, dtype=np.int32) - np.int32(1)
        first = np.flatnonzero(is_first)
        place = np.arange(len(key), dtype=np.int32) - first.astype(np.int32)[edge]
        half_edges = np.full((2, len(first)), 2 * face_count)
        paired = place < 2
        half_edges[place[paired], edge[paired]] = half_edge[paired]
        face_edges = np.empty(len(key), dtype=np.int32)
        face_edges[order] = edge
        return cls(
            mesh,
            ends=np.stack(np.divmod(key[first], len(mesh.vertices))).astype(np.int32),
            half_edges=half_edges,
            further_edges=edge[~paired],
            further_half_edges=half_edge[~paired],
            face_edges=face_edges.reshape(-1, 3),
        )

    def facing(self, centre: np.ndarray) -> np.ndarray:
        """``(3,)`` centre of projection in the model frame -> ``(F,)`` int8: 1 front, -1 back, 0 seen edge-on."""
        # without a matrix product, whose threads wait for one another where processes share the cores
        along, offsets = np.einsum("fi,i->f", self.mesh.face_cross, centre), self.mesh.plane_offsets
        return (along > offsets).view(np.int8) - (along < offsets).view(np.int8)

    def windings(self, facing: np.ndarray) -> np.ndarray:
        """``(F,)`` facing -> ``(E,)`` sum of the half-edges on each edge, signed along ``ends``; 0 inside a layer."""
        signs = np.concatenate([facing, -facing, np.zeros(1, np.int8)])
        sums = signs[self.half_edges[0]] + signs[self.half_edges[1]]
        if len(self.further_edges):
            sums = sums.astype(np.int32)
            np.add.at(sums, self.further_edges, signs[self.further_half_edges])
        return sums


@dataclass(frozen=True)
class SilhouetteStatistics:
    """The whole silhouette in numbers, as in BOP's ``scene_gt_info.json``.

    Attributes
    ----------
    px_count_all
        Number of pixels of the silhouette on :func:`canvas`, inside and outside the image.
    px_count_inside
        Number of these pixels inside the image.
    bbox_obj
        (x, y, width, height) of all pixels, not clipped to the image, width = xmax - xmin; all -1 if there are none.
        (BOP's tool also writes -1 if no pixel is *visible*, which is not known here.)
    """

    px_count_all: int
    px_count_inside: int
    bbox_obj: tuple[int, int, int, int]


@dataclass(frozen=True)
class _Segments:
    """Directed image segments; their winding number around a pixel is the number of layers that cover it.

    ``points`` (3, N) homogeneous pixels, ``v`` (N,) their image rows or +-inf for points at infinity, ``ends`` (2, S)
    indices into them, ``winding`` (S,), and ``at_infinity``: how often the loops run down the line at infinity on the
    left and on the right, which crosses every row.
    """

    points: np.ndarray
    v: np.ndarray
    ends: np.ndarray
    winding: np.ndarray
    at_infinity: tuple[int, int] = (0, 0)


def silhouette_statistics(
    edges: SilhouetteEdges, camera: PinholeCamera, cam_from_model: np.ndarray
) -> SilhouetteStatistics:
    """Count the silhouette on :func:`canvas`; no image is made, so the time does not grow with the canvas's area."""
    x0, _, x1, _ = window = canvas(camera)
    rows, columns, winding = _crossings(_segments(edges, camera, cam_from_model), window)
    order = np.argsort(rows * (x1 - x0 + 1) + columns)
    rows, columns = rows[order], columns[order]
    # the crossings of a row sum to zero, so a run of covered pixels ends in its own row
    covered = np.flatnonzero(np.cumsum(winding[order]) > 0)
    row, start, end = rows[covered], columns[covered], columns[np.minimum(covered + 1, len(columns) - 1)]
    filled = end > start
    row, start, end = row[filled], start[filled], end[filled]
    if len(row) == 0:
        return SilhouetteStatistics(0, 0, (-1, -1, -1, -1))
    inside = np.clip(end, 0, camera.width) - np.clip(start, 0, camera.width)
    x, y = int(start.min()), int(row.min())
    return SilhouetteStatistics(
        px_count_all=int((end - start).sum()),
        px_count_inside=int(inside[(row >= 0) & (row < camera.height)].sum()),
        bbox_obj=(x, y, int(end.max()) - 1 - x, int(row.max()) - y),
    )


def _homogeneous(vertices: np.ndarray, camera: PinholeCamera, cam_from_model: np.ndarray) -> np.ndarray:
    """``(V, 3)`` model points -> ``(3, V)`` homogeneous pixels; the last row is the depth in mm."""
    px_from_model = camera.k @ cam_from_model[:3]
    return px_from_model[:, :3] @ vertices.T + px_from_model[:, 3:]


def _segments(edges: SilhouetteEdges, camera: PinholeCamera, cam_from_model: np.ndarray) -> _Segments:
    """The silhouette edges of a pose: those whose half-edges do not cancel."""
    facing = edges.facing(camera_centre(cam_from_model))
    windings = edges.windings(facing)
    vertices = edges.mesh.vertices
    # each vertex is projected once: its copies in two edges must not differ in the last bit
    if _homogeneous(edges.mesh.box, camera, cam_from_model)[2].min() <= 0:
        points = _homogeneous(vertices, camera, cam_from_model)
        front = points[2] > 0
        if not front.all():
            return _segments_to_infinity(edges, facing, windings, points, front)
    kept = np.flatnonzero(windings != 0)
    ends, used = np.take(edges.ends, kept, axis=1), np.zeros(len(vertices), dtype=bool)
    used[ends] = True
    kept_vertices, number = np.flatnonzero(used), np.empty(len(vertices), np.int64)
    number[kept_vertices] = np.arange(len(kept_vertices))
    points = _homogeneous(vertices[kept_vertices], camera, cam_from_model)
    return _Segments(points, points[1] / points[2], number[ends], windings[kept])


def _segments_to_infinity(
    edges: SilhouetteEdges, facing: np.ndarray, windings: np.ndarray, points: np.ndarray, front: np.ndarray
) -> _Segments:
    """The silhouette edges of a mesh that is partly behind the plane of the camera centre, clipped to that plane."""
    edge_front = front[edges.ends]
    cut = np.flatnonzero(edge_front[0] != edge_front[1])
    # where an edge crosses the plane of the camera centre: its image is the point at infinity in direction (x, y)
    p, q = points[:, edges.ends[0, cut]], points[:, edges.ends[1, cut]]
    at_infinity = p * np.abs(q[2]) + q * np.abs(p[2])
    at_infinity[2] = 0
    index_at_infinity = np.full(edge_front.shape[1], -1)
    index_at_infinity[cut] = points.shape[1] + np.arange(len(cut))
    v = np.divide(points[1], points[2], out=np.zeros_like(points[1]), where=front)
    v = np.concatenate([v, np.where(at_infinity[1] > 0, np.inf, -np.inf)])
    points = np.concatenate([points, at_infinity], axis=1)
    kept = np.flatnonzero((windings != 0) & edge_front.any(axis=0))
    ends = np.where(edge_front[:, kept], edges.ends[:, kept], index_at_infinity[kept])

    # a clipped face leaves the front along one edge and returns along another; between them it follows infinity
    corner_front = front[edges.mesh.faces]
    face = np.flatnonzero((corner_front.any(axis=1) & ~corner_front.all(axis=1)) & (facing != 0))
    corner_front = corner_front[face]
    next_front = np.roll(corner_front, -1, axis=1)
    leaving = np.argmax(corner_front & ~next_front, axis=1)
    returning = np.argmax(~corner_front & next_front, axis=1)
    i, j = (index_at_infinity[edges.face_edges[face, side]] for side in (leaving, returning))
    down = ((v[j] > 0).astype(np.int64) - (v[i] > 0)) * facing[face]
    on_left = points[0, i] * np.abs(points[1, j]) + points[0, j] * np.abs(points[1, i]) < 0
    return _Segments(points, v, ends, windings[kept], (int(down[on_left].sum()), int(down[~on_left].sum())))


def _crossings(segments: _Segments, window: Window) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Where the segments cross the pixel rows of the window.

    Returns
    -------
    ``(N,)`` row, ``(N,)`` first column whose centre is not left of the crossing, clipped to x0..x1 (x1: none in the
    window), ``(N,)`` change of the number of layers there. The changes of a row sum to zero.
    """
    x0, y0, x1, y1 = window
    v_start, v_end = segments.v[segments.ends]
    first, stop = (
        np.ceil(np.clip(v, y0, y1)).astype(np.int64) for v in (np.minimum(v_start, v_end), np.maximum(v_start, v_end))
    )
    count = stop - first
    segment = np.repeat(np.arange(len(count)), count)
    rows = np.arange(len(segment)) + (first - np.cumsum(count) + count)[segment]
    # front faces are counter-clockwise in the image, so a pixel to the right of a downward edge is inside
    winding = np.where(v_end > v_start, segments.winding, -segments.winding.astype(np.int64))[segment]

    (xa, ya, za), (xb, yb, zb) = (np.take(segments.points, i[segment], axis=1) for i in segments.ends)
    # rounding cannot make the weights negative or zero: the crossing stays between the ends, and 0 / 0 cannot occur
    weight_a, weight_b = (np.maximum(np.abs(y - rows * z), 1e-200) for y, z in ((yb, zb), (ya, za)))
    u = (weight_a * xa + weight_b * xb) / (weight_a * za + weight_b * zb)
    columns = np.ceil(np.clip(u, x0, x1)).astype(np.int64)
    for column, down in zip((x0, x1), segments.at_infinity, strict=True):
        if down:
            every_row = np.arange(y0, y1)
            rows = np.concatenate([rows, every_row])
            columns = np.concatenate([columns, np.full_like(every_row, column)])
            winding = np.concatenate([winding, np.full_like(every_row, down)])
    return rows, columns, winding
