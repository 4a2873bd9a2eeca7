"""Points of a surface whose shading frames show: what a lamp is found from."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Protocol

import numpy as np

from ..camera.pinhole import PinholeCamera
from ..images.pixel_values import linear_from_codes, sample_bilinear
from ..images.transfer import SRGB, Transfer
from ..projection.visible_surface import central_point
from ..projection.z_buffer import DepthRaster, rasterise_depth, reached_from, seen_normals
from ..surface.mesh import TriangleMesh
from ..transforms import inverse_rigid, transform_points
from .lens_light import LensLight, shading, working_distance_mm

MOST_POINTS = 4000
"""Points of all frames together."""
DARK, BRIGHT = 0.01, 0.97
"""Linear light below which noise counts, and the code value of a channel above which it may be cut off."""
LEAST_FACING = 0.25
"""Least cosine between normal and line of sight: beyond it a small error of either is a large one of the light."""
AROUND_PX, STEEPEST_PX = 3, 3.0
"""No point is so near to a change of depth that is steeper than the latter: pixels of depth a pixel."""
TOLERANCE_PX = 2.0
"""Depth in pixels by which a point may lie off the surface that a frame shows at its place."""
SHADOW_BIAS = 1e-3
"""How far behind what a lamp sees a point still counts as lit, in parts of its distance."""
ROUGHNESS = 0.3
"""Of the gloss: bone, tissue and wet films between them, whose normals are finer than the surface's."""


class Image(Protocol):
    """A frame at its pose, as :class:`oneframe.case.frame.PosedFrame` is."""

    @property
    def image(self) -> np.ndarray: ...
    @property
    def valid(self) -> np.ndarray: ...
    @property
    def camera(self) -> PinholeCamera: ...
    @property
    def cam_from_model(self) -> np.ndarray: ...


@dataclass(frozen=True)
class ShadedPoints:
    """What frames show of points of a surface: N sightings.

    Attributes
    ----------
    point, frame
        ``(N,)`` which point, which frame.
    points, normals
        ``(N, 3)`` model frame, mm; unit normals on the lens' side.
    log_light
        ``(N,)`` logarithm of the frame's linear light there.
    poses
        ``cam_from_model`` of each frame.
    middle_model
        ``(3,)`` mm: the point whose distance is the working distance, what the first frame shows at its middle.
    """

    point: np.ndarray
    frame: np.ndarray
    points: np.ndarray
    normals: np.ndarray
    log_light: np.ndarray
    poses: tuple[np.ndarray, ...]
    middle_model: np.ndarray = field(default_factory=lambda: np.zeros(3))

    def where(self, chosen: np.ndarray) -> "ShadedPoints":
        """Some of the sightings."""
        arrays = {name: getattr(self, name)[chosen] for name in ("point", "frame", "points", "normals", "log_light")}
        return replace(self, **arrays)

    def shared(self) -> "ShadedPoints":
        """Those of points that more than one frame shows."""
        return self.where(np.bincount(self.point, minlength=1)[self.point] > 1)

    @cached_property
    def _cam(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Points and normals ``(N, 3)`` in the axes of their frame's camera, mm, and its working distance ``(N,)``."""
        points, normals, distances = np.empty_like(self.points), np.empty_like(self.points), np.empty(len(self.frame))
        for number, pose in enumerate(self.poses):
            own = self.frame == number
            points[own] = transform_points(pose, self.points[own])
            normals[own] = self.normals[own] @ pose[:3, :3].T
            distances[own] = working_distance_mm(pose, self.middle_model)
        return points, normals, distances

    def shading(self, light: LensLight) -> np.ndarray:
        """``(N,)`` what each gets of the light of its frame's lens, no shadows cast."""
        points, normals, distances = self._cam
        return shading(light, points, normals, np.eye(4), distances)

    def gloss(self, light: LensLight) -> np.ndarray:
        """``(N,)`` what a wet surface mirrors of the lamp: 1 where it faces the middle between lamp and lens.

        The lobe of Trowbridge & Reitz (1975), of :data:`ROUGHNESS`: broader than highlights are seen to be.
        """
        points, normals, distances = self._cam
        towards_lamp = np.array(light.place_cam_mm) - points
        r, away = (np.linalg.norm(each, axis=1) for each in (towards_lamp, points))
        half = towards_lamp / r[:, None] - points / away[:, None]
        cosine = np.einsum("nk,nk->n", half, normals) / np.linalg.norm(half, axis=1)
        facing = -np.einsum("nk,nk->n", points, normals) / away
        squared = ROUGHNESS**2
        lobe = (squared / (1 + (squared - 1) * cosine**2)) ** 2 * (distances / r) ** light.falloff
        met = np.einsum("nk,nk->n", towards_lamp, normals) > 0
        return np.where(met, lobe / np.maximum(facing, LEAST_FACING), 0.0)

    @cached_property
    def off_axis(self) -> np.ndarray:
        """``(N,)`` 0..1: how far from the lens' axis a sighting is, squared, relative to the farthest one."""
        points = self._cam[0]
        squared = (points[:, :2] ** 2).sum(axis=1) / points[:, 2] ** 2
        relative: np.ndarray = squared / max(float(squared.max(initial=0.0)), 1e-12)
        return relative

    @cached_property
    def log_cosine(self) -> np.ndarray:
        """``(N,)`` logarithm of the cosine between the line of sight and the lens' axis: what vignetting multiplies."""
        points = self._cam[0]
        return np.log(points[:, 2] / np.linalg.norm(points, axis=1))

    def lit(self, light: LensLight, mesh: TriangleMesh) -> np.ndarray:
        """``(N,)`` bool: nothing stands between the point and the lamp."""
        lit = np.zeros(len(self.frame), bool)
        for number, pose in enumerate(self.poses):
            own = self.frame == number
            lit[own] = reached_from(mesh, light.place_model(pose), self.points[own], SHADOW_BIAS)
        return lit


@dataclass(frozen=True)
class _View:
    """A frame: its linear light, the surface in it, and 1 where it cannot be used, ``(H, W)`` each."""

    frame: Image
    light: np.ndarray
    raster: DepthRaster
    unusable: np.ndarray


def shaded_points(mesh: TriangleMesh, frames: Sequence[Image], curve: Transfer = SRGB) -> ShadedPoints:
    """The points that frames show well exposed, away from steps of depth and edges; ``mesh`` in the model frame."""
    views = [_view(mesh, frame, curve) for frame in frames]
    usable = sum(float((view.unusable == 0).sum()) for view in views)
    step = max(1, round(np.sqrt(usable / MOST_POINTS)))
    lifted = [_lifted(mesh, view, step) for view in views]
    points, normals = (np.concatenate([each[part] for each in lifted]) for part in (0, 1))
    seen = [_seen(view, points, normals) for view in views]
    point = np.concatenate([each[0] for each in seen])
    return ShadedPoints(
        point=point,
        frame=np.repeat(np.arange(len(views)), [len(each[0]) for each in seen]),
        points=points[point],
        normals=normals[point],
        log_light=np.concatenate([each[1] for each in seen]),
        poses=tuple(frame.cam_from_model for frame in frames),
        middle_model=central_point(views[0].raster.depth_mm, frames[0].camera, frames[0].cam_from_model),
    )


def _view(mesh: TriangleMesh, frame: Image, curve: Transfer) -> _View:
    raster = rasterise_depth(mesh, frame.camera, frame.cam_from_model)
    light = linear_from_codes(frame.image, curve).mean(axis=2)
    unusable = ~frame.valid | (frame.image.max(axis=2) > BRIGHT) | (light < DARK) | (raster.face < 0)
    light = _spread(np.where(unusable, 0, light), np.add) / np.maximum(_spread(~unusable * 1.0, np.add), 1e-9)
    depth = np.where(raster.face >= 0, raster.depth_mm, np.inf)
    with np.errstate(invalid="ignore"):
        steepest = STEEPEST_PX * (2 * AROUND_PX + 1) * depth / min(frame.camera.fx, frame.camera.fy)
        steps = ~(_spread(depth, np.maximum, AROUND_PX) - _spread(depth, np.minimum, AROUND_PX) <= steepest)
    near = _spread(unusable, np.logical_or, 2) | steps
    return _View(frame, light, raster, near.astype(np.float64))


def _spread(image: np.ndarray, operation: np.ufunc, reach: int = 2) -> np.ndarray:
    """An image whose pixels are the sum, maximum ... of the square around them."""
    for axis in (0, 1):
        padded = np.pad(image, [(reach, reach) if each == axis else (0, 0) for each in (0, 1)], mode="edge")
        size = image.shape[axis]
        image = operation.reduce([padded.take(range(at, at + size), axis) for at in range(2 * reach + 1)])
    return image


def _lifted(mesh: TriangleMesh, view: _View, step: int) -> tuple[np.ndarray, np.ndarray]:
    """``(N, 3)`` points at every ``step``-th pixel across and down that can be used, and their normals."""
    v, u = (step // 2 + step * each for each in np.nonzero(view.unusable[step // 2 :: step, step // 2 :: step] == 0))
    frame, raster = view.frame, view.raster
    uv, pose = np.stack([u, v], axis=1).astype(np.float64), frame.cam_from_model
    points = transform_points(inverse_rigid(pose), frame.camera.rays_cam(uv) / raster.inverse_depth[v, u][:, None])
    return points, seen_normals(mesh, frame.camera, pose, raster.face[v, u], uv).astype(np.float64)


def _seen(view: _View, points: np.ndarray, normals: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Indices of the points that a frame shows, and the logarithm of its light there."""
    camera, pose = view.frame.camera, view.frame.cam_from_model
    points_cam = transform_points(pose, points)
    with np.errstate(divide="ignore", invalid="ignore"):
        pixels = camera.project(points_cam)
        off = np.abs(points_cam[:, 2] * sample_bilinear(view.raster.inverse_depth, pixels) - 1)
        facing = -np.einsum("nk,nk->n", normals @ pose[:3, :3].T, points_cam) / np.linalg.norm(points_cam, axis=1)
    # 0 outside the frame too, where there is no surface either
    shown = (off < TOLERANCE_PX / min(camera.fx, camera.fy)) & (facing > LEAST_FACING)
    index = np.flatnonzero(shown & (sample_bilinear(view.unusable, pixels) == 0))
    return index, np.log(sample_bilinear(view.light, pixels[index]))
