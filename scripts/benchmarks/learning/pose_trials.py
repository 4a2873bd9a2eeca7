"""Poses of photographs by a trained network, and refined from there by render and flow, beside the true ones."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from scipy.optimize import least_squares

from oneframe.blender.case.load_case import load_posed_frame, read_photographs
from oneframe.blender.colour.reference_view import colouring_view_of
from oneframe.camera.pinhole import PinholeCamera
from oneframe.case.loaded_case import LoadedCase
from oneframe.registration.flow_refinement import refined_by_flow
from oneframe.registration.known_views import KnownViews, grey_codes
from oneframe.transforms import inverse_rigid, rigid, rotation_angle_deg, rotation_from_vector, transform_points

from ..alignment.refinement_scenes import visible_points

LONGER_SIDE_PX = 640
"""Errors are told in pixels of this size, at which frames are registered too."""

FEWEST = 12
"""Points without which there is no pose."""
SUREST = 0.7
"""Part of the points that is used."""
NEAREST_MM = 1.0
OUTLIER = 3.0
"""Times the median of the stated errors."""
FARTHEST_DEG = 60
"""Between the directions from which frame and photograph look; farther ones show too little that the frame saw."""


class Training(NamedTuple):
    """What a network was trained on, and for how long."""

    scene: str
    dataset: str
    views: int
    steps: int


@dataclass(frozen=True)
class PoseTrial:
    """A photograph's errors by one training, before and after refinement, see :class:`PoseError`.

    Attributes
    ----------
    seconds
        Processor time of the training.
    """

    scene: str
    dataset: str
    views: int
    steps: int
    seconds: float
    photograph: str
    angle_deg: float
    percent: float
    px: float
    refined_angle_deg: float
    refined_percent: float
    refined_px: float

    @property
    def training(self) -> Training:
        """Of the network."""
        return Training(self.scene, self.dataset, self.views, self.steps)


@dataclass(frozen=True)
class PoseError:
    """How far a pose is from the true one; infinite without a pose.

    Attributes
    ----------
    angle_deg, percent, px
        Rotation; shift of the middle of the visible surface, of its distance; mean shift of the visible surface in the
        image.
    """

    angle_deg: float = float("inf")
    percent: float = float("inf")
    px: float = float("inf")


@dataclass(frozen=True)
class Photograph:
    """A photograph at the size of registration, with its true pose.

    Attributes
    ----------
    name
        Of its file.
    image, valid
        ``(H, W, 3)`` uint8, and ``(H, W)`` bool.
    camera, cam_from_model
        Intrinsics, and pose (4x4, mm).
    points
        ``(N, 3)`` mm, visible points of the surface, model frame.
    """

    name: str
    image: np.ndarray
    valid: np.ndarray
    camera: PinholeCamera
    cam_from_model: np.ndarray
    points: np.ndarray

    def error(self, pose: np.ndarray | None) -> PoseError:
        """Of a pose ``(4, 4)``, if there is one."""
        if pose is None:
            return PoseError()
        true, found = (transform_points(each, self.points) for each in (self.cam_from_model, pose))
        shift = np.linalg.norm(found.mean(axis=0) - true.mean(axis=0)) / np.linalg.norm(true.mean(axis=0))
        angle_deg = rotation_angle_deg(pose[:3, :3] @ self.cam_from_model[:3, :3].T)
        px = np.linalg.norm(self.camera.project(found) - self.camera.project(true), axis=1).mean()
        return PoseError(angle_deg, float(100 * shift), float(px) if found[:, 2].min() > 0 else float("inf"))


def photographs_of(loaded: LoadedCase, listed: Path) -> list[Photograph]:
    """Read the photographs of a list that are near enough, at the size of registration.

    Errors as :func:`.read_photographs`.
    """
    small, own_pose = small_camera(loaded.case.camera), loaded.frame.cam_from_model
    middle, read = visible_points(loaded.surface.mesh, small, own_pose).mean(axis=0), []
    for unread in read_photographs(listed, loaded.case)[0]:
        frame = load_posed_frame(unread, loaded.surface.mesh_from_model, name=listed.name)
        if _angle_between_deg(own_pose, frame.cam_from_model, middle) > FARTHEST_DEG:
            continue
        image = cv2.resize(frame.image, small.size_wh, interpolation=cv2.INTER_AREA)
        valid = cv2.resize(frame.valid.astype(np.uint8), small.size_wh, interpolation=cv2.INTER_NEAREST) > 0
        points = visible_points(loaded.surface.mesh, small, frame.cam_from_model)
        codes = np.rint(255 * np.clip(image, 0, 1)).astype(np.uint8)
        read.append(Photograph(frame.path.name, codes, valid, small, frame.cam_from_model, points))
    return read


def _angle_between_deg(one: np.ndarray, other: np.ndarray, middle: np.ndarray) -> float:
    """Between the directions in which two poses see a point (model frame)."""
    rays = [inverse_rigid(pose)[:3, 3] - middle for pose in (one, other)]
    return float(np.degrees(np.arccos(np.clip(rays[0] @ rays[1] / np.prod(np.linalg.norm(rays, axis=1)), -1, 1))))


def small_camera(camera: PinholeCamera) -> PinholeCamera:
    """The camera at the size of registration."""
    factor = min(LONGER_SIDE_PX / max(camera.size_wh), 1.0)
    return camera.resized(round(camera.width * factor), round(camera.height * factor))


def known_views(loaded: LoadedCase) -> KnownViews:
    """What the case's frame shows, for the refinement."""
    frame = loaded.frame
    small = small_camera(frame.camera)
    image = cv2.resize(frame.image, small.size_wh, interpolation=cv2.INTER_AREA)
    valid = cv2.resize(frame.valid.astype(np.uint8), small.size_wh, interpolation=cv2.INTER_NEAREST) > 0
    view = colouring_view_of(replace(loaded, frames=(replace(frame, image=image, valid=valid, camera=small),)))
    return KnownViews(view.mesh, view.view)


def refined(views: KnownViews, photograph: Photograph, pose: np.ndarray | None) -> np.ndarray | None:
    """The pose refined by render and flow."""
    fit = None if pose is None else refined_by_flow(views, grey_codes(photograph.image), photograph.valid, pose)
    return None if fit is None else fit.cam_from_model


def summary(trials: Sequence[PoseTrial]) -> str:
    """A line with the medians of one training."""
    names = "angle_deg", "percent", "px", "refined_angle_deg", "refined_percent", "refined_px"
    medians = [float(np.median([getattr(trial, name) for trial in trials])) for name in names]
    return (
        "{}, {}, {} views, {} steps: ".format(*trials[0].training)
        + "{:.2f}°, {:.2f} %, {:.2f} px; refined {:.2f}°, {:.2f} %, {:.2f} px".format(*medians)
        + f" (medians of {len(trials)} photographs; {trials[0].seconds:.0f} s)"
    )


def pose_of(points: np.ndarray, pixels: np.ndarray, errors_mm: np.ndarray, camera: PinholeCamera) -> np.ndarray | None:
    """``cam_from_model`` from ``(N, 3)`` points, mm, at ``(N, 2)`` pixels, with ``(N,)`` the errors they state."""
    sure = errors_mm <= np.quantile(errors_mm, SUREST) if len(points) else np.zeros(0, bool)
    if np.count_nonzero(sure) < FEWEST:
        return None
    points, pixels, errors_mm = points[sure], pixels[sure], errors_mm[sure]
    pivot = points.mean(axis=0)
    extent = np.linalg.norm(points - pivot, axis=1).mean() / np.linalg.norm(pixels - pixels.mean(axis=0), axis=1).mean()
    found, turn, position, _ = cv2.solvePnPRansac(
        points - pivot, pixels, camera.k, np.zeros(0),
        reprojectionError=float(max(OUTLIER * np.median(errors_mm) / extent, 1.0)),
        iterationsCount=1000, confidence=0.9999, flags=cv2.SOLVEPNP_SQPNP,
    )  # fmt: skip
    if not found:
        return None
    rotation, position = cv2.Rodrigues(turn)[0], position[:, 0]

    def residuals(twist: np.ndarray) -> np.ndarray:
        placed = (points - pivot) @ (rotation_from_vector(twist[3:]) @ rotation).T + position + twist[:3]
        # outliers may lie behind the camera
        placed[:, 2] = np.maximum(placed[:, 2], NEAREST_MM)
        scale_px = errors_mm * camera.fx / placed[:, 2]
        return ((camera.project(placed) - pixels) / scale_px[:, None]).ravel()

    twist = least_squares(residuals, np.zeros(6), loss="soft_l1", x_scale=[1, 1, 10, 0.1, 0.1, 0.1]).x
    rotation, position = rotation_from_vector(twist[3:]) @ rotation, position + twist[:3]
    return rigid(rotation, position - rotation @ pivot)
