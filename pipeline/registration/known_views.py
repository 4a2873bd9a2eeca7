"""Known views: what the aligned frame shows of the surface, seen from any pose.

Features that a frame shares with a bank of them localise it without any rough pose. RootSIFT (Arandjelović & Zisserman
2012): SIFT finds features at any scale and roll, so the views of the bank differ in tilt only.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import cv2
import numpy as np

from ..alignment.levenberg_marquardt import Loss, fit_poses
from ..alignment.reprojection import Correspondences, Poses
from ..camera.pinhole import PinholeCamera
from ..colour.ray_tracer import RayTracer
from ..colour.seen_frame import SeenFrame
from ..colour.shading import ColouredSurface
from ..light.local_mean import without_light
from ..poses.distributions import ReferencePose
from ..surface.mesh import TriangleMesh
from ..transforms import inverse_rigid, rigid, rotation_angle_deg, transform_points

NEAR_TILT_DEG, NEAR_ROLL_DEG, NEAR_SHARE, NEAR_WIDTHS = 8.0, 20.0, 0.06, 0.1
"""How far a pose may be from a view that stands for its own: tilt, rotation, share of the distance, and shift in the
image, relative to its width."""

STEP_PX = 4
"""Between the pixels whose flow is used."""

LEAST_TEXTURE = 6.0
"""Standard deviation in code values around a pixel without which its flow says nothing."""


@dataclass(frozen=True)
class KnownView:
    """A view at a known pose.

    Attributes
    ----------
    grey
        ``(H, W)`` uint8.
    depth_mm
        ``(H, W)`` float32, along the optical axis.
    shown
        ``(H, W)`` bool: the pixel shows surface that the aligned frame saw.
    camera, cam_from_model
        Intrinsics, and pose (4x4, mm).
    """

    grey: np.ndarray
    depth_mm: np.ndarray
    shown: np.ndarray
    camera: PinholeCamera
    cam_from_model: np.ndarray

    @cached_property
    def detail(self) -> np.ndarray:
        """``(H, W)`` uint8: the view without its light."""
        return without_light(self.grey, self.shown)

    @cached_property
    def textured(self) -> np.ndarray:
        """``(N, 2)`` pixels well inside of what is shown whose flow says something."""
        detail = self.detail.astype(np.float32)
        mean, square = (cv2.GaussianBlur(each, (0, 0), 3.0) for each in (detail, detail**2))
        texture = np.sqrt(np.maximum(square - mean**2, 0))
        inside = cv2.erode(self.shown.astype(np.uint8), np.ones((9, 9), np.uint8)) > 0
        v, u = np.nonzero((inside & (texture > LEAST_TEXTURE))[STEP_PX // 2 :: STEP_PX, STEP_PX // 2 :: STEP_PX])
        return STEP_PX // 2 + STEP_PX * np.stack([u, v], axis=1)

    @cached_property
    def points(self) -> np.ndarray:
        """``(N, 3)`` points of the surface at :attr:`textured`, model frame, mm."""
        return self.lifted(self.textured)

    def placed(self, cam_from_model: np.ndarray) -> np.ndarray:
        """``(H, W, 2)`` float32: where another pose shows what each pixel shows; background at the mean depth."""
        other_from_cam, k = cam_from_model @ inverse_rigid(self.cam_from_model), self.camera.k
        turn, shift = k @ other_from_cam[:3, :3] @ np.linalg.inv(k), k @ other_from_cam[:3, 3]
        u = np.arange(self.camera.width, dtype=np.float32)
        v = np.arange(self.camera.height, dtype=np.float32)[:, None]
        x, y, z = (
            np.float32(a) * u + (np.float32(b) * v + np.float32(c)) + np.float32(d) * self._nearness
            for (a, b, c), d in zip(turn, shift, strict=True)
        )
        return np.dstack([x / z, y / z])

    def stands_for(self, cam_from_model: np.ndarray) -> bool:
        """Whether another pose is so near that the view is almost the one from there."""
        if not self.shown.any():
            return False
        other_from_cam = cam_from_model @ inverse_rigid(self.cam_from_model)
        middle = np.stack([self._middle_cam, transform_points(other_from_cam, self._middle_cam)])
        before_px, after_px = self.camera.project(middle)
        return bool(
            other_from_cam[2, 2] > np.cos(np.radians(NEAR_TILT_DEG))
            and rotation_angle_deg(other_from_cam[:3, :3]) < NEAR_ROLL_DEG
            and abs(middle[1, 2] / middle[0, 2] - 1) < NEAR_SHARE
            and np.linalg.norm(after_px - before_px) < NEAR_WIDTHS * self.camera.width
        )

    @cached_property
    def _nearness(self) -> np.ndarray:
        nearness = np.divide(1.0, self.depth_mm, out=np.zeros_like(self.depth_mm), where=self.depth_mm > 0)
        return np.where(nearness > 0, nearness, nearness[self.shown].mean())

    @cached_property
    def _middle_cam(self) -> np.ndarray:
        v, u = np.nonzero(self.shown)
        ray = self.camera.rays_cam(np.array([[u.mean(), v.mean()]]))[0]
        return ray * float(np.median(self.depth_mm[self.shown]))

    def lifted(self, pixels: np.ndarray) -> np.ndarray:
        """``(N, 2)`` pixels -> ``(N, 3)`` points of the surface, model frame, mm: at the depth of the nearest pixel."""
        u, v = np.rint(pixels).astype(int).T
        points_cam = self.camera.rays_cam(pixels) * self.depth_mm[v, u][:, None]
        return transform_points(inverse_rigid(self.cam_from_model), points_cam)


class KnownViews:
    """Renders known views of one surface with one camera."""

    def __init__(self, mesh: TriangleMesh, case_view: SeenFrame) -> None:
        """Prepare a surface (model frame) that is coloured by its aligned frame."""
        self.case_view = case_view
        self._tracer = RayTracer(ColouredSurface(mesh, (case_view,)), case_view.camera)
        self._latest: KnownView | None = None

    def near(self, cam_from_model: np.ndarray) -> KnownView:
        """A view that is not far from a pose (4x4, mm): the latest one if it may stand for the pose's own."""
        view = self._latest
        if view is None or not view.stands_for(cam_from_model):
            view = self._latest = self.at(cam_from_model)
        return view

    def at(self, cam_from_model: np.ndarray) -> KnownView:
        """The view of a pose (4x4, mm)."""
        seen = self._tracer.render(cam_from_model)
        return KnownView(
            grey=grey_codes(seen.rgb),
            depth_mm=seen.depth_mm,
            shown=seen.observed,
            camera=self.case_view.camera,
            cam_from_model=cam_from_model,
        )


def grey_codes(image: np.ndarray) -> np.ndarray:
    """``(H, W, 3)`` float32 code values 0..1 or uint8 -> ``(H, W)`` uint8."""
    codes = image if image.dtype == np.uint8 else np.rint(255 * np.clip(image, 0, 1)).astype(np.uint8)
    return cv2.cvtColor(codes, cv2.COLOR_RGB2GRAY)


TILTS_DEG = ((0.0, 1), (25.0, 6), (50.0, 8))
"""Tilts of the views, and how many directions they go in."""

FEATURES, CONTRAST, SHARE = 4000, 0.0075, 0.6
EDGE_PX = 4
"""Features nearer to the border of what a view shows are left out: the border is not in the frame."""

NEIGHBOURS, RATIO = 6, 0.85
"""Nearest features of the bank, and how much nearer the best one must be than the first at another place."""

SAME_PLACE = 0.02
"""Distance of features at one place, as a share of the surface's size in the aligned frame."""

INLIER_PX = 4.0
"""How far a feature may lie from its place at the pose: beside edges of the surface its depth is coarse."""

TRIALS, CONFIDENCE = 3000, 0.9999
LEAST_INLIERS = 10
LOSS_PX = 2.0


class ViewBank:
    """Features of the known views, with their places on the surface."""

    def __init__(self, views: Sequence[KnownView]) -> None:
        """Find the features of views; the first is the aligned frame's."""
        descriptors, points = zip(*(_lifted_features(view) for view in views), strict=True)
        self._points = np.concatenate(points)
        self._matcher = cv2.FlannBasedMatcher({"algorithm": 1, "trees": 4}, {"checks": 64})
        self._matcher.add([np.concatenate(descriptors)])
        # its trees are random: the same ones every time
        cv2.setRNGSeed(0)
        self._matcher.train()
        spread = np.ptp(points[0], axis=0) if len(points[0]) else np.zeros(3)
        self._same_mm = SAME_PLACE * float(np.linalg.norm(spread))

    def __len__(self) -> int:
        """The number of features."""
        return len(self._points)

    def matches(self, grey: np.ndarray, valid: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """What a frame shares with the bank: ``(N, 2)`` pixels, and ``(N, 3)`` points of the surface, mm.

        ``grey`` is ``(H, W)`` uint8, ``valid`` ``(H, W)`` bool.
        """
        keypoints, descriptors = _features(grey, valid)
        if len(keypoints) == 0 or len(self._points) < NEIGHBOURS:
            return np.empty((0, 2)), np.empty((0, 3))
        found = self._matcher.knnMatch(descriptors, k=NEIGHBOURS)
        index = np.array([[match.trainIdx for match in row] for row in found])
        distance = np.array([[match.distance for match in row] for row in found])
        apart = np.linalg.norm(self._points[index] - self._points[index[:, :1]], axis=2) > self._same_mm
        # where all neighbours lie at one place, the last one bounds the next place's distance from below
        other = np.where(apart.any(axis=1), np.argmax(apart, axis=1), NEIGHBOURS - 1)
        clear = distance[:, 0] < RATIO * distance[np.arange(len(distance)), other]
        return keypoints[clear], self._points[index[clear, 0]]


def bank_of(views: KnownViews, pivot_model: np.ndarray) -> ViewBank:
    """The bank of the views around an aligned frame; ``pivot_model`` ``(3,)`` mm is the middle of what it shows."""
    reference = ReferencePose(views.case_view.cam_from_model, pivot_model)
    poses = []
    for tilt_deg, count in TILTS_DEG:
        tilt = np.radians(tilt_deg)
        for angle in 2 * np.pi * np.arange(count) / count:
            poses.append(reference.orbit((tilt * np.cos(angle), tilt * np.sin(angle)), 0.0, reference.distance_mm))
    return ViewBank([views.at(pose) for pose in poses])


class Localised(NamedTuple):
    """A ``(4, 4)`` pose, and how many features agree with it."""

    cam_from_model: np.ndarray
    inliers: int


def localised(bank: ViewBank, camera: PinholeCamera, grey: np.ndarray, valid: np.ndarray) -> Localised | None:
    """The pose that most features agree with (RANSAC by AP3P, then a robust fit); ``None`` without enough of them.

    ``grey`` is ``(H, W)`` uint8, ``valid`` ``(H, W)`` bool.
    """
    pixels, points = bank.matches(grey, valid)
    if len(pixels) < LEAST_INLIERS:
        return None
    found, rotation_vector, position, inliers = cv2.solvePnPRansac(
        points, pixels, camera.k, np.zeros(0),
        iterationsCount=TRIALS, reprojectionError=INLIER_PX, confidence=CONFIDENCE, flags=cv2.SOLVEPNP_AP3P,
    )  # fmt: skip
    if not found or inliers is None or len(inliers) < LEAST_INLIERS:
        return None
    start = rigid(cv2.Rodrigues(rotation_vector)[0], position.ravel())
    chosen = inliers.ravel()
    known = Correspondences.about(points[chosen], pixels[chosen], camera)
    fitted, _ = fit_poses(known, Poses.of(start[None], known.pivot_model), loss=Loss(LOSS_PX))
    pose = fitted.matrix(0, known.pivot_model)
    with np.errstate(invalid="ignore"):
        residuals_px = np.linalg.norm(camera.project(transform_points(pose, points)) - pixels, axis=1)
        return Localised(pose, int(np.count_nonzero(residuals_px < INLIER_PX)))


def _features(grey: np.ndarray, mask: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """``(N, 2)`` pixels and ``(N, 128)`` descriptors, compared by their Euclidean distance.

    Of an image of a share of the size, as SIFT doubles what it is given: finer features take longer, and blur has none.
    """
    small = cv2.resize(grey, [round(SHARE * side) for side in grey.shape[::-1]], interpolation=cv2.INTER_AREA)
    mask = cv2.resize(mask.astype(np.uint8), small.shape[::-1], interpolation=cv2.INTER_NEAREST)
    keypoints, descriptors = cv2.SIFT.create(FEATURES, contrastThreshold=CONTRAST).detectAndCompute(small, mask)
    if descriptors is None:
        return np.empty((0, 2)), np.empty((0, 128), np.float32)
    root = np.sqrt(descriptors / np.maximum(descriptors.sum(axis=1, keepdims=True), 1e-6))
    pixels = (np.array([keypoint.pt for keypoint in keypoints]) + 0.5) * np.divide(grey.shape, small.shape)[::-1] - 0.5
    return pixels, root.astype(np.float32)


def _lifted_features(view: KnownView) -> tuple[np.ndarray, np.ndarray]:
    """Descriptors, and ``(N, 3)`` points of the surface."""
    inside = cv2.erode(view.shown.astype(np.uint8), np.ones((2 * EDGE_PX + 1,) * 2, np.uint8)) > 0
    pixels, descriptors = _features(view.grey, inside)
    return descriptors, view.lifted(pixels)
