"""A frame whose camera and pose are known: of a case, of a video, or a photograph to compare with."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ..camera.pinhole import PinholeCamera


@dataclass(frozen=True)
class PosedFrame:
    """An undistorted image with its camera and pose.

    Attributes
    ----------
    image, valid
        ``(H, W, 3)`` float32 code values 0..1, not linearised; ``(H, W)`` bool, False where it shows no surface.
    camera, cam_from_model
        Intrinsics, and pose (4x4, mm).
    covariance
        ``(6, 6)`` of the pose, as :class:`.PoseUncertainty` has it; ``None`` if it is not known.
    path, alignment
        Provenance: the image's file, and how its pose was found, see :mod:`.alignment_record`.
    """

    image: np.ndarray
    valid: np.ndarray
    camera: PinholeCamera
    cam_from_model: np.ndarray
    covariance: np.ndarray | None = None
    path: Path = Path()
    alignment: Mapping[str, object] = field(default_factory=dict)
