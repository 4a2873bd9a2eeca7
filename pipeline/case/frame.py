"""Frames: as their files hold them, and with camera and pose, on disk or in memory."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ..camera.distortion import Distortion, undistort
from ..camera.pinhole import PinholeCamera
from ..errors import InputError
from ..images.image_reader import read_image
from ..images.masked_frame import encoded_frame, joined_mask, shown_by_mask


@dataclass(frozen=True)
class Frame:
    """A frame in memory, as its file holds it: with the lens's distortion, before it has a camera or a pose.

    Attributes
    ----------
    path
        Its file, an image or a video.
    colours, shown
        ``(H, W, 3)`` float32 code values 0..1, and ``(H, W)`` bool, False where it shows no surface.
    mask
        The file of a mask that it was joined with.
    pixel_aspect
        Width of a pixel over its height, as its film states it.
    notes
        What the user should know about it.
    """

    path: Path
    colours: np.ndarray
    shown: np.ndarray
    mask: Path | None = None
    pixel_aspect: float = 1.0
    notes: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """The name of its file, for messages."""
        return self.path.name

    @property
    def size_wh(self) -> tuple[int, int]:
        """(width, height) in pixels."""
        return self.shown.shape[1], self.shown.shape[0]

    @property
    def masked(self) -> float:
        """Fraction of its pixels that show no surface, 0..1."""
        return float(1 - self.shown.mean())

    def with_mask(self, path: Path) -> "Frame":
        """The frame without what a mask's file hides, in addition to what its own alpha hides."""
        mask = shown_by_mask(*read_image(path, path.name), path.name)
        return replace(self, shown=joined_mask(self.shown, mask, self.name, path.name), mask=path)

    def encoded(self) -> bytes:
        """The frame as the PNG of a case folder."""
        if not self.shown.any():
            raise InputError(f"{self.name}: expected a frame that shows something, its alpha is 0 everywhere")
        return encoded_frame(self.colours, self.shown)


def read_frame(path: Path) -> Frame:
    """Read a frame."""
    return Frame(path, *read_image(path, path.name))


@dataclass(frozen=True)
class UnreadFrame:
    """A posed frame on disk, as a case or a list of photographs names it: its image may not be read yet, or ever.

    Attributes
    ----------
    image
        The image's file.
    camera, distortion
        Intrinsics, and OpenCV distortion or ``None``.
    cam_from_mesh
        4x4, mm: from the frame of the surface's file.
    """

    image: Path
    camera: PinholeCamera
    distortion: Distortion | None
    cam_from_mesh: np.ndarray


@dataclass(frozen=True)
class PosedFrame:
    """An undistorted image with its camera and pose.

    Attributes
    ----------
    image, valid
        ``(H, W, 3)`` float32 code values 0..1, not linearised; ``(H, W)`` bool, False where it shows no surface.
    camera, cam_from_model
        Intrinsics, and pose (4x4, mm).
    path
        The image's file.
    """

    image: np.ndarray
    valid: np.ndarray
    camera: PinholeCamera
    cam_from_model: np.ndarray
    path: Path = Path()


def load_posed_frame(frame: UnreadFrame, mesh_from_model: np.ndarray, *, name: str) -> PosedFrame:
    """Read and undistort a posed frame; ``name`` begins messages."""
    image, valid = load_frame(frame.image, frame.camera, frame.distortion, name=name)
    return PosedFrame(image, valid, frame.camera, frame.cam_from_mesh @ mesh_from_model, path=frame.image)


def load_frame(
    path: Path, camera: PinholeCamera, distortion: Distortion | None, *, name: str
) -> tuple[np.ndarray, np.ndarray]:
    """Read and undistort the frame of a case; ``name`` begins messages.

    Returns
    -------
    ``(H, W, 3)`` float32 code values 0..1, and ``(H, W)`` bool, False where it has no image.
    """
    image, valid = read_image(path, f"{name}: image {path.name}")
    height, width = image.shape[:2]
    if (width, height) != camera.size_wh:
        raise InputError(
            f"{name}: expected a frame of {camera.width}x{camera.height} px as its camera has, "
            f"{path.name} has {width}x{height}; K belongs to one size: give the K of this image"
        )
    if distortion is not None:
        image, inside = undistort(image, camera, distortion)
        valid &= inside
    return image, valid
