"""The surface that a camera sees: the nearest face at each pixel centre, or at given image points, and its depth."""

from typing import NamedTuple

import numpy as np

from ..camera.pinhole import PinholeCamera
from ..kernels import lookup, nearest_face
from ..surface.mesh import TriangleMesh
from ..transforms import camera_centre, rigid

LEAST_COSINE = 0.3
"""Between the axis of a camera in :func:`reached_from` and what it looks at."""


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


def rasterise_depth(mesh: TriangleMesh, camera: PinholeCamera, cam_from_model: np.ndarray) -> DepthRaster:
    """The nearest face, of both sides of all, at each pixel centre of a pose (4x4, mm)."""
    return nearest_at_centres(projected(mesh, camera, cam_from_model), mesh, camera)


def nearest_at_centres(points: np.ndarray, mesh: TriangleMesh, camera: PinholeCamera) -> DepthRaster:
    """The same for :func:`projected` vertices."""
    raster = DepthRaster(np.zeros(camera.shape_hw), np.full(camera.shape_hw, -1, np.int32))
    nearest_face.nearest_at_centres(points, mesh.faces, *raster)
    return raster


def nearest_at(
    mesh: TriangleMesh,
    camera: PinholeCamera,
    cam_from_model: np.ndarray,
    uv: np.ndarray,
    least: np.ndarray | float = 0.0,
) -> tuple[np.ndarray, np.ndarray]:
    """The same at ``(N, 2)`` points of the image: ``(N,)`` inverse depths, 1/mm, 0 for none, and faces, -1 for none.

    What has at most a least inverse depth ``(N,)`` is not met.
    """
    points = projected(mesh, camera, cam_from_model)
    return nearest_face.nearest_at_points(points, mesh.faces, uv, np.zeros(len(uv)) + least, *camera.size_wh)


def projected(mesh: TriangleMesh, camera: PinholeCamera, cam_from_model: np.ndarray) -> np.ndarray:
    """``(V, 5)`` homogeneous pixels, columns and rows of the vertices: see :func:`.nearest_face.projected`."""
    return nearest_face.projected(mesh.vertices, camera.k @ cam_from_model[:3])


def fronts(mesh: TriangleMesh, cam_from_model: np.ndarray) -> np.ndarray:
    """``(F,)`` bool: the faces that show a pose their front."""
    return lookup.fronts(mesh.face_cross, mesh.plane_offsets, camera_centre(cam_from_model))


def seen_normals(
    mesh: TriangleMesh, camera: PinholeCamera, cam_from_model: np.ndarray, face: np.ndarray, uv: np.ndarray
) -> np.ndarray:
    """``(N, 3)`` float32 unit normals, model frame, of what image points ``(N, 2)`` show of the faces ``(N,)``.

    Those of the vertices, interpolated, on the side that is seen.
    """
    points, normals = projected(mesh, camera, cam_from_model), np.zeros((len(face), 3), np.float32)
    lookup.interpolate(mesh.smooth_normals, mesh.faces, points, lookup.Met(uv, face, np.zeros(0)), face >= 0, normals)
    length = np.sqrt(np.maximum(np.einsum("nk,nk->n", normals, normals), np.float32(1e-24)))
    turned = (fronts(mesh, cam_from_model) == mesh.is_flipped)[face]
    normals /= np.where(turned, -length, length)[:, None]
    return normals


def reached_from(
    mesh: TriangleMesh, place: np.ndarray, points: np.ndarray, near: float, own: np.ndarray | None = None
) -> np.ndarray:
    """``(N,)`` bool: points ``(N, 3)`` that a place ``(3,)`` reaches by straight lines, all in the model frame, mm.

    In their way is any face, but for one's own ``(N,)`` and what is nearer to a point than this part of the way.
    """
    own = np.full(len(points), -1, np.int32) if own is None else own
    reached, left = np.ones(len(points), bool), np.arange(len(points))
    while len(left):
        # a camera at the place looks at the middle of them; those beside it get another one
        chosen = left if len(left) < len(points) else slice(None)
        others, size = points[chosen], int(np.sqrt(len(left) / 2)) + 2
        for axis in (others[:: len(others) // 1000 + 1].mean(axis=0) - place, others[0] - place):
            look = _looking_along(axis)
            uv, depth, focal, principal = lookup.seen_from(place, look, others, LEAST_COSINE, size)
            if depth[0] > 0:
                break
        ahead = depth > 0
        if not ahead.any():
            break
        camera, pose = PinholeCamera(size, size, *focal, *principal), rigid(look, -look @ place)
        limit = np.divide(1 / (1 - near), depth, out=np.full(len(depth), np.inf), where=ahead)
        face = nearest_at(mesh, camera, pose, uv, limit)[1]
        reached[chosen] = (face < 0) | (face == own[chosen])
        left = left[~ahead]
    return reached


def _looking_along(axis: np.ndarray) -> np.ndarray:
    """``(3, 3)`` a rotation that takes a direction to z; any if it is 0."""
    across = np.cross(np.eye(3)[np.argmin(np.abs(axis))], axis)
    if not across.any():
        return np.eye(3)
    x, z = across / np.linalg.norm(across), axis / np.linalg.norm(axis)
    return np.stack([x, np.cross(z, x), z])


def inverse_depth_map(depth_mm: np.ndarray, valid: np.ndarray | None = None) -> np.ndarray:
    """``(H, W)`` depth in mm, 0 for background -> inverse depth in 1/mm, 0 also where ``valid`` is False."""
    with np.errstate(divide="ignore"):
        inverse = (1 / depth_mm).astype(np.float32)
    inverse[inverse == np.inf] = 0
    return inverse if valid is None else inverse * valid
