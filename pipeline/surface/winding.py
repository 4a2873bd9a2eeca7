"""Faces wound like their neighbours: what is front is then front on the whole piece."""

import numpy as np

from .mesh import TriangleMesh, distinct_points


def consistent_winding(mesh: TriangleMesh, where: str) -> tuple[TriangleMesh, list[str]]:
    """Turn faces that are wound against their neighbours, where the mesh allows it.

    Neighbours are two different faces that share a side which no third one has; corners at one place are one. In each
    piece the larger area keeps its side. A piece that has only one side, as a Möbius strip, stays as it is.

    Returns
    -------
    The mesh, and messages for the user, which begin with ``where``.
    """
    first, second, differs = _neighbours(mesh)
    if not differs.any():
        return mesh, []
    piece, turned = _two_coloured(len(mesh.faces), first, second, differs)
    contradicted = piece[first][turned[first] ^ turned[second] != differs]
    turned &= ~np.isin(piece, contradicted)
    area = np.linalg.norm(mesh.face_cross, axis=1)
    balance = np.bincount(piece, np.where(turned, area, -area), minlength=len(piece))
    turned ^= (balance > 0)[piece]
    turned &= ~np.isin(piece, contradicted)
    messages = []
    if turned.any():
        messages.append(
            f"{where}: turned {turned.sum()} of {len(turned)} faces, which were wound against their neighbours"
        )
    if len(contradicted):
        messages.append(f"{where}: some faces are wound against their neighbours, and no turn makes them agree")
    faces = mesh.faces.copy()
    faces[turned] = faces[turned, ::-1]
    return TriangleMesh(mesh.vertices, faces), messages


def _neighbours(mesh: TriangleMesh) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Two faces at each side that two share, ``(E,)`` each, and whether they are wound against each other."""
    corners = distinct_points(mesh.vertices)[1][mesh.faces]
    start, end = corners.ravel(), np.roll(corners, -1, axis=1).ravel()
    side = np.minimum(start, end) * np.int64(len(mesh.vertices)) + np.maximum(start, end)
    order = np.argsort(side, kind="stable")
    side = side[order]
    begins = np.flatnonzero(np.concatenate([[True], side[1:] != side[:-1]]))
    pairs = begins[np.diff(np.append(begins, len(side))) == 2]
    one, other = order[pairs], order[pairs + 1]
    # the same face twice has no neighbour in itself
    opposite = np.roll(corners, 1, axis=1).ravel()
    differ = opposite[one] != opposite[other]
    one, other = one[differ], other[differ]
    return one // 3, other // 3, (start < end)[one] == (start < end)[other]


def _two_coloured(
    count: int, first: np.ndarray, second: np.ndarray, differs: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The piece that each of ``count`` faces belongs to, and a side of it so that neighbours differ where they must.

    Pieces grow together as in Shiloach and Vishkin's algorithm (1982); sides are relative to a piece's first face.
    """
    piece, side = np.arange(count), np.zeros(count, bool)
    while True:
        low, high = piece[first], piece[second]
        apart = low != high
        if not apart.any():
            return piece, side
        low, high = low[apart], high[apart]
        relative = (side[first] ^ side[second] ^ differs)[apart]
        parent, turn = np.arange(count), np.zeros(count, bool)
        # each piece joins one with a lower number, so no circle arises
        parent[np.maximum(low, high)] = np.minimum(low, high)
        joined = parent[np.maximum(low, high)] == np.minimum(low, high)
        turn[np.maximum(low, high)[joined]] = relative[joined]
        while (parent[parent] != parent).any():
            turn ^= turn[parent]
            parent = parent[parent]
        side ^= turn[piece]
        piece = parent[piece]
