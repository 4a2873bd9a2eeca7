"""Whether a surface is where registered frames show it: the quick question that every registration asks.

A plane sweep (Collins 1996) from the case's frame: each of its pixels is tried at depths about the surface's, where the
other frames are laid on it. It asks them in two halves. Where both put the surface elsewhere, to the same side, it is
wrong, or the case's pose is.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from ..case.frame import PosedFrame
from ..light.local_mean import without_light
from ..projection.z_buffer import rasterise_depth
from ..surface.mesh import TriangleMesh
from ..transforms import camera_centre, inverse_rigid, transform_points
from .known_views import grey_codes

LONGER_SIDE_PX = 240
"""Frames are compared at this size: coarse ones find what is far off, on smooth places too."""
LEAST_FRAMES, MOST_FRAMES, LEAST_ANGLE_DEG = 10, 14, 15.0
"""Fewer, or nearer to one another, do not tell."""
STEP_PX, STEPS = 1.6, 6
"""Between the depths, in pixels on the surface, and how many there are on each side."""
WINDOW_PX = 9, 9
LEAST_LIKE, LEAST_BEND = 0.7, 0.01
"""Correlation below which a depth says nothing; and how much less alike the frames are a step nearer and farther: less,
and any depth would do, as where a surface is smooth, wet and dark."""
PLACE_PX, LEAST_TOLD = 8, 0.25
"""Side of the places that are judged, and the part of one that must be told of by both halves."""
WRONG_PX = 1.25
"""By how much both halves must put a place elsewhere, in pixels on the surface."""
LEAST_WRONG = 0.01
"""Part of the places below which nothing is said: up to 0.007 on a true surface, 0.009 and more on wrong ones."""
TINT, NEARER, FARTHER = 0.6, (0.85, 0.1, 0.1), (0.1, 0.25, 0.9)


@dataclass(frozen=True)
class SurfaceCheck:
    """What frames tell of a surface, by places of the case's frame, rows and columns of a grid.

    Attributes
    ----------
    off_mm
        ``(h, w)`` how much nearer to the lens what frames show lies than the surface, along its normal; NaN where they
        do not tell.
    wrong
        ``(h, w)`` bool: more than it could be by chance.
    frames
        How many were asked.
    """

    off_mm: np.ndarray
    wrong: np.ndarray
    frames: int

    @property
    def share(self) -> float:
        """The part of the places told of at which the surface is wrong, 0..1."""
        return float(self.wrong.sum() / max(int(np.isfinite(self.off_mm).sum()), 1))

    @property
    def words(self) -> str:
        """What is wrong, in a sentence; empty where nothing is to be said."""
        if self.share < LEAST_WRONG:
            return ""
        low, high = np.percentile(self.off_mm[self.wrong], (2, 98))
        return (
            f"the surface is probably wrong, or the case's pose: of what {self.frames} frames tell of, "
            f"{self.share:.0%} lies {low:+.1f} to {high:+.1f} mm elsewhere (positive: nearer to the lens)"
        )

    def picture(self, image: np.ndarray) -> np.ndarray:
        """The case's frame ``(H, W, 3)`` in grey, and where the surface is wrong: red is nearer, blue farther."""
        grey = image.mean(axis=2, keepdims=True)
        side = cv2.resize(
            np.where(self.wrong, np.sign(self.off_mm), 0), image.shape[1::-1], interpolation=cv2.INTER_NEAREST
        )
        return grey + TINT * np.abs(side[..., None]) * (np.where(side[..., None] > 0, NEARER, FARTHER) - grey)


def check_surface(
    mesh: TriangleMesh, pivot_model: np.ndarray, case_frame: PosedFrame, others: Sequence[PosedFrame]
) -> SurfaceCheck | None:
    """Ask frames at their poses where a surface is; ``None`` if they are too few, or too near to one another.

    The mesh is in the model frame, mm, as is the ``(3,)`` pivot, the middle of what the case's frame shows; all frames
    are at :data:`LONGER_SIDE_PX`.
    """
    ways = camera_centre(np.stack([each.cam_from_model for each in (case_frame, *others)])) - pivot_model
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    if len(others) < LEAST_FRAMES or (ways @ ways.T).min() > np.cos(np.radians(LEAST_ANGLE_DEG)):
        return None
    camera, raster = case_frame.camera, rasterise_depth(mesh, case_frame.camera, case_frame.cam_from_model)
    shown = raster.face >= 0
    depth_mm = 1 / np.where(shown, raster.inverse_depth, 1)
    rays_cam, normals_cam = (
        camera.rays_cam(camera.pixel_grid()),
        mesh.face_normals @ case_frame.cam_from_model[:3, :3].T,
    )
    pixel_mm = float(np.median(depth_mm[shown])) / camera.fx
    # the sweep says how much nearer the surface is than it should be
    along = -np.abs((rays_cam * normals_cam[raster.face]).sum(axis=-1))
    halves, told = list[np.ndarray](), _places(shown).all(axis=-1)
    for half in (others[::2], others[1::2]):
        off_mm, says = _swept_depths(case_frame, depth_mm, half, STEP_PX * pixel_mm)
        off_mm, says = _places(cv2.medianBlur(off_mm, 5) * along), _places(says & shown)
        told &= says.mean(axis=-1) > LEAST_TOLD
        halves.append(np.ma.median(np.ma.array(off_mm, mask=~says), axis=-1).filled(0.0))
    one, other = halves
    wrong = told & (one * other > 0) & (np.minimum(np.abs(one), np.abs(other)) > WRONG_PX * pixel_mm)
    return SurfaceCheck(np.where(told, (one + other) / 2, np.nan), wrong, len(others))


def _swept_depths(
    case_frame: PosedFrame, depth_mm: np.ndarray, others: Sequence[PosedFrame], step_mm: float
) -> tuple[np.ndarray, np.ndarray]:
    """``(H, W)`` by how many mm of depth the surface is nearer than where frames agree, and bool: whether they do.

    They agree where small windows correlate, in the mean over the better half: something hides the surface in some.
    """
    own, details = _detail(case_frame), [_detail(each) for each in others]
    mean, deviation = _moments(own)
    rays_cam = case_frame.camera.rays_cam(case_frame.camera.pixel_grid()).reshape(-1, 3)
    poses = [each.cam_from_model @ inverse_rigid(case_frame.cam_from_model) for each in others]
    likeness = np.empty((2 * STEPS + 1, *own.shape), np.float32)
    for number, best_half in enumerate(likeness):
        points_cam = rays_cam * (depth_mm.reshape(-1, 1) + (number - STEPS) * step_mm)
        likes = []
        for other, detail, pose in zip(others, details, poses, strict=True):
            x, y = np.moveaxis(other.camera.project(transform_points(pose, points_cam)).reshape(*own.shape, 2), -1, 0)
            laid = cv2.remap(detail, x.astype(np.float32), y.astype(np.float32), cv2.INTER_LINEAR)
            laid_mean, laid_deviation = _moments(laid)
            both = cv2.boxFilter(own * laid, -1, WINDOW_PX)
            likes.append((both - mean * laid_mean) / (deviation * laid_deviation))
        half = len(likes) // 2
        best_half[:] = np.partition(np.array(likes), half, axis=0)[half:].mean(axis=0)
    best = np.clip(likeness.argmax(axis=0), 1, 2 * STEPS - 1)
    nearer, most, farther = (np.take_along_axis(likeness, best[None] + by, axis=0)[0] for by in (-1, 0, 1))
    bend = most - (nearer + farther) / 2
    # the vertex of the parabola through all three
    beside = np.clip((farther - nearer) / np.maximum(4 * bend, 1e-6), -1, 1)
    return ((best - STEPS + beside) * step_mm).astype(np.float32), (most > LEAST_LIKE) & (bend > LEAST_BEND)


def _detail(frame: PosedFrame) -> np.ndarray:
    return without_light(grey_codes(frame.image), frame.valid).astype(np.float32)


def _moments(image: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    mean = cv2.boxFilter(image, -1, WINDOW_PX)
    return mean, np.sqrt(np.maximum(cv2.boxFilter(image * image, -1, WINDOW_PX) - mean * mean, 1))


def _places(image: np.ndarray) -> np.ndarray:
    """``(h, w, N)`` the pixels of each place; a rest at the right and below is left out."""
    height, width = (side // PLACE_PX for side in image.shape)
    cut = image[: height * PLACE_PX, : width * PLACE_PX].reshape(height, PLACE_PX, width, PLACE_PX)
    return cut.swapaxes(1, 2).reshape(height, width, -1)
