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
from .z_buffer import rasterise_depth, seen_normals

STEP_MM = 1.0
"""Smallest step of depth that counts as a contour: bone is rough."""

PIECE_PX = 4.0
"""Longest piece of an edge that is visible or hidden as a whole."""


@dataclass(frozen=True)
class OverlayScene:
    """A surface and structures, all in the model frame; the structures with their colours, sRGB 0..1."""

    surface: SilhouetteEdges
    structures: tuple[tuple[TriangleMesh, Colour], ...]

    @classmethod
    def of(cls, surface: TriangleMesh, structures: Sequence[tuple[TriangleMesh, Colour]]) -> "OverlayScene":
        """Prepare the surface."""
        return cls(SilhouetteEdges.of(surface), tuple(structures))

    def surface_layer(
        self, camera: PinholeCamera, cam_from_model: np.ndarray, depth_mm: np.ndarray | None = None
    ) -> SurfaceLayer:
        """The surface at a pose (4x4, mm); its ``(H, W)`` depth is rasterised unless it is given."""
        edges = self.surface
        if depth_mm is None:
            depth_mm = rasterise_depth(edges.mesh, camera, cam_from_model).depth_mm.astype(np.float32)
        return SurfaceLayer(depth_mm, *visible_contours(edges, camera, cam_from_model, depth_mm))

    def layers(self, camera: PinholeCamera, cam_from_model: np.ndarray) -> list[Layer]:
        """The structures at a pose, in their order."""
        return [structure_layer(mesh, colour, camera, cam_from_model) for mesh, colour in self.structures]


def structure_layer(mesh: TriangleMesh, colour: Colour, camera: PinholeCamera, cam_from_model: np.ndarray) -> Layer:
    """One structure (model frame) at a pose, in the part of the image that it may cover."""
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
    raster = rasterise_depth(mesh, window, cam_from_model)
    seen = raster.face >= 0
    shade = np.zeros(seen.shape, np.float32)
    v, u = np.nonzero(seen)
    uv, pose = np.stack([u, v], axis=1).astype(np.float64), cam_from_model
    normals, rays = seen_normals(mesh, window, pose, raster.face[seen], uv), window.rays_cam(uv) @ pose[:3, :3]
    shade[seen] = np.abs(np.einsum("nk,nk->n", normals, rays)) / np.linalg.norm(rays, axis=1)
    return Layer((x0, y0), raster.depth_mm.astype(np.float32), shade, colour)


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
