"""What frames show of a surface: the point at each pixel, and the flow from one frame to another one over it.

A frame is laid on another one by the surface and both poses, in the light that the other one has: what is left to move
is the error of the surface and of the poses. The flow is that of dense inverse search (Kroeger et al. 2016).
"""

from functools import cached_property
from typing import NamedTuple

import cv2
import numpy as np

from ..case.frame import PosedFrame
from ..colour.lens_shading import CornerNormals, LensShading, shifted_codes
from ..images.transfer import SRGB, Transfer
from ..light.local_mean import without_light
from ..projection.rays import MeshRays
from ..surface.mesh import TriangleMesh
from ..transforms import camera_centre, transform_points

GRID_PX = 7
"""Between the pixels whose flow is used."""
TOLERANCE_PX = 3.0
"""How far behind what a frame shows a point may lie and count as shown, in the size of a pixel on the surface."""
CLOSING_PX = 1.0
"""Flow there and back that misses the pixel by more is not used."""
JUMP_PX = 3.0
"""Where the place in the other frame changes by more than the flow and this, an edge of the surface lies between."""
WINDOW_PX, LEAST_TEXTURE = 9, 3.0
"""Window of a structure tensor, and root of its smaller eigenvalue, codes a pixel, below which flow says nothing."""
BORDER_PX = 5


class SurfaceFrame:
    """A frame, and what its image alone tells."""

    def __init__(self, frame: PosedFrame, curve: Transfer = SRGB) -> None:
        self.camera, self.valid, self.start = frame.camera, frame.valid, frame.cam_from_model
        # in linear light to the power of the codes: a factor of light is one of these
        grey = cv2.cvtColor(frame.image.astype(np.float32), cv2.COLOR_RGB2GRAY)
        self.codes = shifted_codes(grey, curve) + np.float32(curve.shift)

    @cached_property
    def grey(self) -> np.ndarray:
        """``(H, W)`` the codes as 0..255."""
        return _grey(self.codes)

    @cached_property
    def detail(self) -> np.ndarray:
        """``(H, W)`` float32: the codes without what changes slowly."""
        return without_light(self.grey, self.valid).astype(np.float32)

    @cached_property
    def textured(self) -> np.ndarray:
        """``(H, W)`` bool: the flow says something in both directions."""
        # its gradients are over two pixels
        return (cv2.cornerMinEigenVal(self.detail, WINDOW_PX, ksize=3) > (2 * LEAST_TEXTURE) ** 2) & self.valid


def _grey(codes: np.ndarray) -> np.ndarray:
    return np.rint(255 * np.clip(codes, 0, 1))


class Surface:
    """A surface that is looked at from many poses, and the light at the lens, if it is known."""

    def __init__(self, mesh: TriangleMesh, light: LensShading | None) -> None:
        self.mesh, self.light, self.rays = mesh, light, MeshRays(mesh)

    @cached_property
    def normals(self) -> CornerNormals:
        """For the light."""
        return CornerNormals(self.mesh)


class SurfaceView:
    """What a frame shows of a surface at a pose.

    Attributes
    ----------
    surface, frame, pose
        The surface, the frame, and ``cam_from_model`` (4x4, mm).
    rays
        ``(H, W, 3)`` directions of the pixels' rays, model frame, as long as one mm of depth.
    hits
        What each of them meets, row by row.
    depth_mm
        ``(H, W)`` depth; infinite where there is no surface.
    points
        ``(H, W, 3)`` mm.
    shown
        ``(H, W)`` bool: there is surface.
    """

    def __init__(self, surface: Surface, frame: SurfaceFrame, pose: np.ndarray) -> None:
        """Look at it."""
        self.surface, self.frame, self.pose = surface, frame, pose
        shape, centre = frame.camera.shape_hw, camera_centre(pose)
        self.rays = frame.camera.rays_cam(frame.camera.pixel_grid()) @ pose[:3, :3]
        flat = self.rays.reshape(-1, 3).astype(np.float32)
        self.hits = surface.rays.first_hits(np.broadcast_to(centre, flat.shape).astype(np.float32), flat)
        self.shown = (self.hits.face >= 0).reshape(shape)
        self.depth_mm = np.where(self.shown, self.hits.distance.reshape(shape), np.inf).astype(float)
        self.points = centre + self.rays * np.where(self.shown, self.depth_mm, 1)[..., None]

    @property
    def pixel_mm(self) -> float:
        """The size of a pixel on the surface, facing the lens."""
        return float(np.median(self.depth_mm[self.shown])) / self.frame.camera.fx if self.shown.any() else 1.0

    def relit(self, codes: np.ndarray, pose: np.ndarray) -> np.ndarray:
        """Codes ``(H, W)`` of another frame, laid on this one, in the light of this lens, not that of ``pose``."""
        return codes * self._lit / self._lit_from(pose)

    @cached_property
    def _lit(self) -> np.ndarray:
        return self._lit_from(self.pose)

    def _lit_from(self, pose: np.ndarray) -> np.ndarray:
        light = self.surface.light
        return np.ones(1) if light is None else light.factors(*self._lit_points, pose).reshape(self.shown.shape)

    @cached_property
    def _lit_points(self) -> tuple[np.ndarray, np.ndarray]:
        at = self.points.reshape(-1, 3).astype(np.float32)
        return at, self.surface.normals.at(self.hits.face, at, self.hits.front)


class Flow(NamedTuple):
    """Where one frame shows what another one does.

    Attributes
    ----------
    pixels
        ``(N, 2)`` columns and rows in the view.
    placed, found
        ``(N, 2)`` where surface and poses place them in the other frame, and where it shows them.
    share
        The part of the textured pixels, shown by both, for which the flow comes back, 0..1.
    """

    pixels: np.ndarray
    placed: np.ndarray
    found: np.ndarray
    share: float


def flow_between(view: SurfaceView, other: SurfaceView) -> Flow:
    """The flow from a view to another one that is laid on it."""
    height, width = view.depth_mm.shape
    points_cam = transform_points(other.pose, view.points.reshape(-1, 3)).reshape(view.points.shape)
    place = np.where(view.shown[..., None], other.frame.camera.project(points_cam), -10).astype(np.float32)
    inside = ((place >= 1) & (place <= np.array([width, height]) - 2)).all(axis=-1)
    place[~inside] = -10
    x, y = cv2.split(place)
    met = np.where(other.shown, other.depth_mm, 1e9).astype(np.float32)
    tolerance_mm = TOLERANCE_PX * points_cam[..., 2] / other.frame.camera.fx
    both = inside & view.frame.valid & (points_cam[..., 2] < cv2.remap(met, x, y, cv2.INTER_NEAREST) + tolerance_mm)
    both &= cv2.remap(other.frame.valid.astype(np.uint8), x, y, cv2.INTER_NEAREST) > 0
    laid = view.relit(cv2.remap(other.frame.codes, x, y, cv2.INTER_LINEAR), other.pose)
    own, laid = (without_light(each, both) for each in (view.frame.grey, _grey(laid)))
    there = _dense(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM, own, laid)
    # the way back only tests, to a pixel
    back = _dense(cv2.DISOPTICAL_FLOW_PRESET_FAST, laid, own)
    inner = cv2.erode(both.astype(np.uint8), np.ones((BORDER_PX, BORDER_PX), np.uint8))
    grid = np.zeros_like(both)
    grid[GRID_PX:-GRID_PX:GRID_PX, GRID_PX:-GRID_PX:GRID_PX] = True
    v, u = np.nonzero(grid & (inner > 0) & view.frame.textured)
    if not len(u):
        # nothing that both show, as at the poses of another case
        return Flow(np.zeros((0, 2), int), np.zeros((0, 2)), np.zeros((0, 2)), 0.0)
    moved = there[v, u] + np.stack([u, v], axis=1).astype(np.float32)
    to_u, to_v = moved.T[..., None]
    returns, found = (cv2.remap(each, to_u, to_v, cv2.INTER_LINEAR)[:, 0] for each in (back, place))
    placed, moved_px = place[v, u], np.linalg.norm(there[v, u], axis=1)
    used = np.linalg.norm(there[v, u] + returns, axis=1) < CLOSING_PX
    used &= cv2.remap(inner, to_u, to_v, cv2.INTER_NEAREST)[:, 0] > 0
    used &= np.abs(found - placed).max(axis=1) < JUMP_PX * (1 + moved_px)
    pixels = np.stack([u, v], axis=1)
    share = float(used.sum() / max(len(u), 1))
    return Flow(pixels[used], placed[used].astype(float), found[used].astype(float), share)


def _dense(preset: int, one: np.ndarray, other: np.ndarray) -> np.ndarray:
    return cv2.DISOpticalFlow.create(preset).calc(one, other, np.zeros((*one.shape, 2), np.float32))


def cosines_between(poses: np.ndarray, pivot: np.ndarray) -> np.ndarray:
    """``(F, F)`` between the directions in which the cameras of ``cam_from_model`` ``(F, 4, 4)`` are from a pivot."""
    ways = camera_centre(poses) - pivot
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    return np.clip(ways @ ways.T, -1, 1)
