"""Camera intrinsics from the files of calibration programs, or as a user types them, checked."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import InputError
from ..files.content import LARGEST_FILE, read_content
from .calibration import Calibration, calibration_of
from .calibration_content import content_table
from .distortion import Distortion, checked_distortion
from .pinhole import PinholeCamera

_ANY_SIZE = (65536, 65536)
"""Stands for an unknown size in the check of K; the largest that the check accepts."""


@dataclass(frozen=True)
class CameraFile:
    """The intrinsics read from a file.

    Attributes
    ----------
    path
        The file.
    fx, fy, cx, cy
        Pixels; (0, 0) is the centre of the top-left pixel.
    size
        (width, height) of the images that K is for; ``None`` if the file does not say.
    distortion
        k1, k2, p1, p2, k3; ``None`` if there is none.
    """

    path: Path
    fx: float
    fy: float
    cx: float
    cy: float
    size: tuple[int, int] | None
    distortion: tuple[float, float, float, float, float] | None

    def camera(self, size_wh: tuple[int, int]) -> PinholeCamera:
        """The camera with this K, unchanged, for images of (width, height); see :mod:`oneframe.camera.plausibility`."""
        k = [[self.fx, 0, self.cx], [0, self.fy, self.cy], [0, 0, 1]]
        return PinholeCamera.from_matrix(k, size=size_wh, where=f"{self.path.name}: K")

    def distortion_for(self, camera: PinholeCamera) -> Distortion | None:
        """The distortion for a camera of this file, ``None`` if there is none."""
        if self.distortion is None:
            return None
        return checked_distortion(self.distortion, camera, f"{self.path.name}: distortion")


def read_camera(path: Path, place: str = "") -> CameraFile:
    """Read intrinsics from any of the formats of :mod:`.calibration_content`.

    Of a file with several cameras, ``place`` is the key of one: that of an image in BOP's ``scene_camera.json``,
    ``"camera 3"`` of COLMAP's ``cameras.txt``.
    """
    path = Path(path)
    content: Any = content_table(read_content(path, "a file with a camera", most=LARGEST_FILE), path)
    if place and not (isinstance(content, dict) and place in content):
        raise InputError(f"{path.name}: expected a camera {place!r} in it, found none; write the key of one after #")
    found = calibration_of(content[place] if place else content, path.name)
    return _camera_file(path, found, f"{path.name}: {found.place}: K" if found.place else f"{path.name}: K")


def typed_camera(
    focal_and_centre: Sequence[float],
    *,
    size: Sequence[int] | None = None,
    distortion: Sequence[float] | None = None,
    name: str,
) -> CameraFile:
    """Intrinsics as a user typed them, as if they had been read from a file.

    Parameters
    ----------
    focal_and_centre
        fx, fy, cx, cy, px; (0, 0) is the centre of the top-left pixel.
    size
        (width, height) of the images that K is for; ``None`` if the user did not say.
    distortion
        k1, k2, p1, p2 and k3, which may be left out.
    name
        Stands for the file's name in messages.
    """
    if distortion is not None and len(distortion) not in (4, 5):
        raise InputError(f"{name}: expected a distortion k1 k2 p1 p2 [k3], found {len(distortion)} numbers")
    fx, fy, cx, cy = focal_and_centre
    matrix = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]])
    size_wh = None if size is None else (float(size[0]), float(size[1]))
    coefficients = (*(distortion or ()), *[0.0] * 5)[:5]
    given = coefficients if any(coefficients) else ()
    return _camera_file(Path(name), Calibration("", matrix, size_wh, given, "center"), name)


def _camera_file(path: Path, found: Calibration, where: str) -> CameraFile:
    size: Any = _ANY_SIZE if found.size is None else found.size
    camera = PinholeCamera.from_matrix(
        found.matrix, size=size, pixel_origin=found.pixel_origin or "center", where=where  # type: ignore[arg-type]
    )  # fmt: skip
    return CameraFile(
        path,
        camera.fx,
        camera.fy,
        camera.cx,
        camera.cy,
        size=None if found.size is None else camera.size_wh,
        distortion=found.distortion or None,  # type: ignore[arg-type]
    )
