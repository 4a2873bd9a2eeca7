"""A frame whose camera and pose are known: of a case, of a video, or a photograph to compare with; on disk, or read."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..camera.distortion import Distortion
from ..camera.pinhole import PinholeCamera


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
