"""A surface and structures, prepared for overlays from many poses, and their visible contours.

Contours are the projections of the edges between front and back faces, and of open borders, as far as nothing hides
them. They lie where the mesh has them, to a fraction of a pixel.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..camera.pinhole import PinholeCamera
from ..images.layer_stack import Colour, Layer, SurfaceLayer
from ..images.strokes import pieces_of
from ..surface.mesh import TriangleMesh
from ..transforms import camera_centre, transform_points
from .silhouette import SilhouetteEdges
from .z_buffer import inverse_depth_of, rasterise_depth

STEP_MM = 1.0
"""Smallest step of depth that counts as a contour: bone is rough."""

PIECE_PX = 4.0
"""Longest piece of an edge that is visible or hidden as a whole."""


@dataclass(frozen=True)
class Solid:
    """A mesh with its edges.

    Attributes
    ----------
    edges
        Those of the mesh.
    is_closed
        Whether it is closed with its fronts outside, so that no back face is ever seen from outside.
    """

    edges: SilhouetteEdges
    is_closed: bool

    @classmethod
    def of(cls, mesh: TriangleMesh) -> "Solid":
        """Find the edges of a mesh (model frame)."""
        edges = SilhouetteEdges.of(mesh)
        return cls(edges, _is_closed(edges))

    def seen_faces(self, cam_from_model: np.ndarray) -> np.ndarray | None:
        """Indices of the faces that a camera outside may see; ``None`` for all."""
        if not self.is_closed:
            return None
        return np.flatnonzero(self.edges.facing(camera_centre(cam_from_model)) > 0)


@dataclass(frozen=True)
class OverlayScene:
    """A surface and structures, all in the model frame; the structures with their colours, sRGB 0..1."""

    surface: Solid
    structures: tuple[tuple[Solid, Colour], ...]

    @classmethod
    def of(cls, surface: TriangleMesh, structures: Sequence[tuple[TriangleMesh, Colour]]) -> "OverlayScene":
        """Prepare meshes."""
        return cls(Solid.of(surface), tuple((Solid.of(mesh), colour) for mesh, colour in structures))

    def surface_layer(
        self, camera: PinholeCamera, cam_from_model: np.ndarray, depth_mm: np.ndarray | None = None
    ) -> SurfaceLayer:
        """The surface at a pose (4x4, mm); its ``(H, W)`` depth is rasterised unless it is given."""
        edges = self.surface.edges
        if depth_mm is None:
            inverse = inverse_depth_of(edges.mesh, camera, cam_from_model, self.surface.seen_faces(cam_from_model))
            depth_mm = np.zeros(inverse.shape, np.float32)
            np.divide(1, inverse, out=depth_mm, where=inverse > 0, casting="unsafe")
        return SurfaceLayer(depth_mm, *visible_contours(edges, camera, cam_from_model, depth_mm))

    def layers(self, camera: PinholeCamera, cam_from_model: np.ndarray) -> list[Layer]:
        """The structures at a pose, in their order."""
        return [structure_layer(solid, colour, camera, cam_from_model) for solid, colour in self.structures]


def structure_layer(solid: Solid, colour: Colour, camera: PinholeCamera, cam_from_model: np.ndarray) -> Layer:
    """One structure (model frame) at a pose, in the part of the image that it may cover."""
    mesh = solid.edges.mesh
    pixels = camera.project(transform_points(cam_from_model, mesh.vertices))
    pixels = pixels[np.isfinite(pixels).all(axis=1)]
    size = np.array(camera.size_wh)
    low = np.clip(np.floor(pixels.min(axis=0, initial=np.inf)), 0, size).astype(np.int64)
    high = np.clip(np.ceil(pixels.max(axis=0, initial=-np.inf)) + 1, 0, size).astype(np.int64)
    if (high <= low).any():
        return Layer((0, 0), np.zeros((0, 0), np.float32), np.zeros((0, 0), np.float32), colour)
    x0, y0 = (int(value) for value in low)
    width, height = (int(value) for value in high - low)
    window = replace(camera, width=width, height=height, cx=camera.cx - x0, cy=camera.cy - y0)
    raster = rasterise_depth(mesh, window, cam_from_model, solid.seen_faces(cam_from_model))
    seen = raster.face >= 0
    depth, shade = np.zeros(seen.shape, np.float32), np.zeros(seen.shape, np.float32)
    depth[seen] = 1 / raster.inverse_depth[seen]
    y, x = np.nonzero(seen)
    shade[seen] = _facing(mesh, raster.face[seen], np.stack([x, y], axis=1), depth[seen], window, cam_from_model)
    return Layer((x0, y0), depth, shade, colour)


def _facing(
    mesh: TriangleMesh,
    face: np.ndarray,
    pixels: np.ndarray,
    depth_mm: np.ndarray,
    camera: PinholeCamera,
    cam_from_model: np.ndarray,
) -> np.ndarray:
    """``(N,)`` cosine between the smooth normal and the ray at points of faces, 0..1."""
    rays = camera.rays_cam(pixels.astype(np.float64))
    rotation = cam_from_model[:3, :3]
    points = ((rays * depth_mm[:, None]) - cam_from_model[:3, 3]) @ rotation
    normals = smooth_normals(mesh, mesh.vertex_normals, face, points)
    towards = camera_centre(cam_from_model) - points
    return np.abs(np.einsum("nk,nk->n", normals, towards)) / np.linalg.norm(towards, axis=1)


def smooth_normals(mesh: TriangleMesh, of_vertices: np.ndarray, face: np.ndarray, points: np.ndarray) -> np.ndarray:
    """``(N, 3)`` unit normals at points of faces ``(N,)``, interpolated between those ``(V, 3)`` of the vertices."""
    corners = mesh.faces[face]
    a, b, c = (mesh.vertices[corners[:, corner]] for corner in range(3))
    cross = mesh.face_cross[face]
    squared = np.einsum("nk,nk->n", cross, cross)
    weight_b = np.einsum("nk,nk->n", np.cross(points - a, c - a), cross) / squared
    weight_c = np.einsum("nk,nk->n", np.cross(b - a, points - a), cross) / squared
    weights = np.clip(np.stack([1 - weight_b - weight_c, weight_b, weight_c]), 0, 1)
    normals = sum(weights[corner][:, None] * of_vertices[corners[:, corner]] for corner in range(3))
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    return np.divide(normals, length, out=np.zeros_like(normals), where=length > 0)


def _is_closed(edges: SilhouetteEdges) -> bool:
    """Whether every edge joins two faces that run along it in opposite directions, around a positive volume."""
    faces = len(edges.mesh.faces)
    first, second = edges.half_edges
    opposite = (second < 2 * faces) & ((first < faces) != (second < faces))
    volume = float((edges.mesh.vertices[edges.mesh.faces[:, 0]] * edges.mesh.face_cross).sum())
    return len(edges.further_edges) == 0 and bool(opposite.all()) and volume > 0


def visible_contours(
    edges: SilhouetteEdges, camera: PinholeCamera, cam_from_model: np.ndarray, depth_mm: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Find the contours of a surface.

    Parameters
    ----------
    edges
        Those of the surface, in the model frame.
    camera, cam_from_model
        Intrinsics and pose (4x4, mm).
    depth_mm
        ``(H, W)`` of the surface in this camera, 0 where there is none.

    Returns
    -------
    ``(N, 2, 2)`` segments (x, y) in px where the surface ends, and ``(M, 2, 2)`` where it goes on behind; edges that
    reach behind the camera are left out.
    """
    windings = edges.windings(edges.facing(camera_centre(cam_from_model)))
    ends = edges.ends[:, np.flatnonzero(windings)]
    points = transform_points(cam_from_model, edges.mesh.vertices[ends.ravel()])
    pixels, depths = camera.project(points).reshape(2, -1, 2), points[:, 2].reshape(2, -1)
    (u0, v0), (u1, v1) = pixels[0].T, pixels[1].T
    # NaN, of points behind the camera, is in no image
    with np.errstate(invalid="ignore"):
        near = (np.maximum(u0, u1) >= -0.5) & (np.minimum(u0, u1) <= camera.width - 0.5)
        near &= (np.maximum(v0, v1) >= -0.5) & (np.minimum(v0, v1) <= camera.height - 0.5)
        near &= np.maximum(np.abs(u1 - u0), np.abs(v1 - v0)) < max(camera.size_wh)
    pixels, inverse = pixels[:, near], 1 / depths[:, near]
    edge, along = pieces_of(np.hypot(*(pixels[1] - pixels[0]).T), PIECE_PX)
    start, direction = pixels[0][edge], (pixels[1] - pixels[0])[edge]
    # not as means: numpy is slow at reductions along an axis of two
    middle = 0.5 * (along[:, 0] + along[:, 1])
    pixel = start + middle[:, None] * direction
    inside = np.flatnonzero(camera.contains(pixel))
    edge, along, middle = edge[inside], along[inside], middle[inside]
    depth = 1 / ((1 - middle) * inverse[0][edge] + middle * inverse[1][edge])
    x, y = np.rint(pixel[inside]).astype(np.int64).T
    rows, columns = (
        np.clip(part + np.arange(-1, 2)[:, None], 0, size - 1) for part, size in ((y, camera.height), (x, camera.width))
    )
    around = depth_mm[rows[:, None], columns[None]].reshape(9, -1)
    # background is as far as can be
    around = np.where(around > 0, around, np.inf)
    farthest = around.max(axis=0)
    # what is hidden has nothing farther around it
    ending = np.isinf(farthest)
    step = ~ending & (farthest - depth > STEP_MM)
    start, direction = start[inside], direction[inside]
    first, last = (
        np.stack([start[kept] + along[kept, end, None] * direction[kept] for end in (0, 1)], axis=1)
        for kept in (ending, step)
    )
    return first, last
