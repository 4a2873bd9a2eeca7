"""Triangle meshes: checking and cleaning, normals, diameter.

:mod:`oneframe.surface.mesh_reader` and :mod:`oneframe.surface.mesh_writer` read and write files.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..errors import InputError

LARGEST_COORDINATE = 1e9
"""1000 km in mm; larger coordinates mean a damaged file, and their products may overflow."""

MOST_FACES = MOST_VERTICES = 10_000_000
"""Largest mesh; a temporal bone at the resolution of its CT has two million."""

BALL_DECIMALS = 3
"""Decimals of a ball in a file: to a micrometre."""

_BLOCK = 1 << 18
"""Faces that are computed at a time, which bounds the memory that it takes."""


@dataclass(frozen=True)
class TriangleMesh:
    """A triangle mesh; arrays are never written to after construction.

    Attributes
    ----------
    vertices
        ``(V, 3)`` float64, mm.
    faces
        ``(F, 3)`` int32 vertex indices, counter-clockwise seen from the front.
    """

    vertices: np.ndarray
    faces: np.ndarray

    @cached_property
    def face_cross(self) -> np.ndarray:
        """``(F, 3)`` outward face normals times twice the area, mm^2; by columns, which every view sums."""
        cross = np.empty(self.faces.shape, order="F")
        for at in range(0, len(cross), _BLOCK):
            a, b, c = (self.vertices[corner] for corner in self.faces[at : at + _BLOCK].T)
            cross[at : at + _BLOCK] = np.cross(b - a, c - a)
        return cross

    @cached_property
    def plane_offsets(self) -> np.ndarray:
        """``(F,)`` so that ``face_cross @ x - plane_offsets`` is positive in front of a face."""
        offsets = np.empty(len(self.faces))
        for at in range(0, len(offsets), _BLOCK):
            part = slice(at, at + _BLOCK)
            offsets[part] = (self.face_cross[part] * self.vertices[self.faces[part, 0]]).sum(axis=1)
        return offsets

    @cached_property
    def face_normals(self) -> np.ndarray:
        """``(F, 3)`` unit outward face normals."""
        return self.face_cross / _lengths(self.face_cross)[:, None]

    @cached_property
    def face_centres(self) -> np.ndarray:
        """``(F, 3)`` means of the corners, mm."""
        # corner by corner: numpy is slow at reductions along an axis of three
        a, b, c = (self.vertices[self.faces[:, corner]] for corner in range(3))
        return (a + b + c) / 3

    @cached_property
    def vertex_normals(self) -> np.ndarray:
        """``(V, 3)`` unit normals: the area-weighted mean of the adjacent faces; zero for unused vertices."""
        normals = np.empty_like(self.vertices)
        for axis in range(3):
            weights = np.repeat(self.face_cross[:, axis], 3)
            normals[:, axis] = np.bincount(self.faces.ravel(), weights, minlength=len(self.vertices))
        length = np.linalg.norm(normals, axis=1, keepdims=True)
        return np.divide(normals, length, out=np.zeros_like(normals), where=length > 0)

    @cached_property
    def smooth_normals(self) -> np.ndarray:
        """``(V, 3)`` as :attr:`vertex_normals`, but one at each place: many programs write three vertices a face."""
        places, index = distinct_points(self.vertices)
        if len(places) == len(self.vertices):
            return self.vertex_normals
        return TriangleMesh(places, index[self.faces]).vertex_normals[index]

    @cached_property
    def is_flipped(self) -> np.ndarray:
        """``(F,)`` bool: faces that show their back where their vertices' :attr:`smooth_normals` point."""
        towards = np.zeros(len(self.faces))
        for axis in range(3):
            of_corners = self.smooth_normals[:, axis][self.faces]
            towards += (of_corners[:, 0] + of_corners[:, 1] + of_corners[:, 2]) * self.face_cross[:, axis]
        return towards < 0

    @cached_property
    def bounds(self) -> np.ndarray:
        """``(2, 3)`` smallest and largest vertex coordinates, mm."""
        return np.stack([self.vertices.min(axis=0), self.vertices.max(axis=0)])

    @property
    def box(self) -> np.ndarray:
        """``(8, 3)`` corners of the box around the vertices, mm."""
        return np.stack(np.meshgrid(*self.bounds.T), axis=-1).reshape(-1, 3)

    @cached_property
    def radius(self) -> float:
        """Largest distance of a vertex from the frame's origin, mm."""
        return float(np.sqrt((self.vertices**2).sum(axis=1).max()))

    @cached_property
    def median_edge(self) -> float:
        """Median edge length over the sides of all faces, mm: it limits the resolution of vertex colours."""
        # all three sides: exporters that split quads start every face at the diagonal
        a, b, c = (self.vertices[self.faces[:, corner]] for corner in range(3))
        return float(np.median(np.concatenate([_lengths(a - c), _lengths(b - a), _lengths(c - b)])))

    def front_facing(self, viewpoint: np.ndarray, faces: np.ndarray | slice = slice(None)) -> np.ndarray:
        """Whether faces, all or those with indices ``(N,)``, show a viewpoint (3,), mm, their front: ``(N,)`` bool."""
        return self.face_cross[faces] @ viewpoint > self.plane_offsets[faces]

    def moved(self, offset: np.ndarray) -> "TriangleMesh":
        """The mesh with ``offset`` (3,) in mm added to all vertices."""
        return replace(self, vertices=self.vertices + offset)

    def scaled(self, factor: float) -> "TriangleMesh":
        """The mesh with all coordinates multiplied, e.g. 1000 from metres to millimetres."""
        return replace(self, vertices=self.vertices * factor)

    def flipped(self) -> "TriangleMesh":
        """The mesh with the other side of every face as its front."""
        return replace(self, faces=np.ascontiguousarray(self.faces[:, ::-1]))


@dataclass(frozen=True)
class Ball:
    """The part of a surface that matters: ``centre`` (3,) and radius, mm, in the frame of the mesh."""

    centre: np.ndarray
    radius_mm: float

    def rounded(self) -> "Ball":
        """The ball as files hold it: to a micrometre."""
        return Ball(np.round(self.centre, BALL_DECIMALS), round(self.radius_mm, BALL_DECIMALS))


def ball_around(mesh: TriangleMesh) -> Ball:
    """The ball about the mean of a surface's vertices that holds all of them, rounded."""
    centre = mesh.vertices.mean(axis=0)
    return Ball(centre, mesh.moved(-centre).radius).rounded()


def checked_mesh(vertices: np.ndarray, faces: np.ndarray, where: str) -> tuple[TriangleMesh, list[str]]:
    """Check raw arrays; drop zero-area faces and unused vertices, with messages about it.

    Parameters
    ----------
    vertices, faces
        ``(V, 3)`` coordinates and ``(F, 3)`` integer indices, as read.
    where
        Names the file in messages.
    """
    messages: list[str] = []
    if len(vertices) == 0 or len(faces) == 0:
        raise InputError(
            f"{where}: expected a surface, found {len(vertices)} vertices and {len(faces)} faces; "
            "export the mesh with its faces"
        )
    if len(vertices) > MOST_VERTICES or len(faces) > MOST_FACES:
        raise InputError(
            f"{where}: expected up to {MOST_FACES:,} vertices and faces, found {len(vertices):,} and {len(faces):,}; "
            "decimate the mesh"
        )
    vertices = np.asarray(vertices, dtype=np.float64)
    faces = np.asarray(faces, dtype=np.int64)
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise InputError(
            f"{where}: expected vertex indices 0..{len(vertices) - 1}, found {faces.min()}..{faces.max()}; "
            "the file is corrupt"
        )
    used = np.zeros(len(vertices), dtype=bool)
    used[faces] = True
    bad = used & ~(np.abs(vertices) < LARGEST_COORDINATE).all(axis=1)
    if bad.any():
        raise InputError(
            f"{where}: expected coordinates below {LARGEST_COORDINATE:g}, found NaN, infinity or larger in "
            f"{bad.sum()} of {len(bad)} vertices (first: vertex {int(np.argmax(bad))}); repair the mesh"
        )
    flat = np.concatenate([_flat(vertices, faces[at : at + _BLOCK]) for at in range(0, len(faces), _BLOCK)])
    if flat.all():
        raise InputError(f"{where}: expected a surface, found {len(faces)} faces, all with zero area")
    if flat.any():
        messages.append(f"{where}: dropped {flat.sum()} of {len(faces)} faces with zero area")
        faces = faces[~flat]
        used[:] = False
        used[faces] = True
    if not used.all():
        messages.append(f"{where}: dropped {(~used).sum()} of {len(vertices)} vertices that no face uses")
        new_index = np.cumsum(used) - 1
        vertices, faces = vertices[used], new_index[faces]
    return TriangleMesh(np.ascontiguousarray(vertices), np.ascontiguousarray(faces, dtype=np.int32)), messages


def distinct_points(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """``(N, 3)`` points -> ``(M, 3)`` distinct points in lexicographic order, and ``(N,)`` the index of each point."""
    order = np.lexsort(points.T[::-1])
    in_order = points[order]
    first = np.ones(len(points), dtype=bool)
    first[1:] = (in_order[1:] != in_order[:-1]).any(axis=1)
    index = np.empty(len(points), dtype=np.int64)
    index[order] = np.cumsum(first) - 1
    return in_order[first], index


def _lengths(vectors: np.ndarray) -> np.ndarray:
    """``(N,)`` lengths of ``(N, 3)`` vectors."""
    # column by column: numpy is slow at reductions along an axis of three
    x, y, z = vectors.T
    return np.sqrt(x * x + y * y + z * z)


def _flat(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """``(F,)`` bool: faces without area."""
    a, b, c = (vertices[faces[:, corner]] for corner in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    longest = np.max([((p - q) ** 2).sum(axis=1) for p, q in ((a, b), (b, c), (c, a))], axis=0)
    # relative to the face's own size: single precision does not determine the normal of a thinner needle
    return area <= 1e-7 * longest


def diameter(points: np.ndarray) -> float:
    """The exact largest distance between two of ``(N, 3)`` points, mm (BOP's ``diameter``).

    Notes
    -----
    A few sweeps to the farthest point from the last one give a good lower bound d0. A point p can only belong to a
    longer pair if |p - c| + max|q - c| > d0 for the centre c, which leaves few candidates on real shapes; these are
    compared in blocks.
    """
    centre = (points.min(axis=0) + points.max(axis=0)) / 2
    lower, index = 0.0, int(np.argmax(((points - centre) ** 2).sum(axis=1)))
    for _ in range(8):
        distance = np.sqrt(((points - points[index]) ** 2).sum(axis=1))
        index = int(np.argmax(distance))
        if distance[index] <= lower:
            break
        lower = float(distance[index])
    reach = np.sqrt(((points - centre) ** 2).sum(axis=1))
    candidates = points[reach + reach.max() >= lower]
    offset = candidates - centre
    squared_reach = (offset**2).sum(axis=1)
    order = np.argsort(-squared_reach, kind="stable")
    offset, squared_reach = offset[order], squared_reach[order]
    reach = np.sqrt(squared_reach)
    block = 128
    for start in range(0, len(offset), block):
        if reach[start] * 2 < lower:
            break  # both ends of any remaining pair lie nearer to the centre than half the bound
        stop = int(np.searchsorted(-reach, reach[start] - lower, side="right"))
        rows, partners = offset[start : start + block], offset[start:stop]
        if len(partners) == 0:
            continue
        squared = squared_reach[start : start + block, None] + squared_reach[None, start:stop] - 2 * rows @ partners.T
        row, partner = np.unravel_index(int(np.argmax(squared)), squared.shape)
        lower = max(lower, float(np.linalg.norm(rows[row] - partners[partner])))
    return lower
