"""Lens distortion in OpenCV's model (k1, k2, p1, p2, k3), and its removal from a frame.

Undistorting needs the *forward* model only: each pixel of the undistorted image samples the frame where the lens puts
its ray.
"""

from dataclasses import astuple, dataclass

import numpy as np

from ..errors import InputError
from ..files.keys import described
from ..images.pixel_values import sample_bilinear
from .pinhole import PinholeCamera

FOLD_GRID = 101
"""Grid lines along each side of the frame in the test for folds; folds narrower than 1 % of the frame may be missed."""

LEAST_OF_FRAME = 0.5
"""That a lens must be able to show: folds in the corners lie outside an endoscope's circle."""

FAR_OUTSIDE_PX = -1e5
"""A place that no image has, for OpenCV's tables too, which take no NaN."""

_BLOCK = 1 << 18
"""Pixels that are resampled at a time, which bounds the memory that it takes."""


@dataclass(frozen=True)
class Distortion:
    """Brown-Conrady coefficients, named and ordered as in OpenCV; dimensionless."""

    k1: float
    k2: float
    p1: float
    p2: float
    k3: float

    def distort(self, normalised: np.ndarray) -> np.ndarray:
        """``(N, 2)`` ideal (x / z, y / z) -> ``(N, 2)`` distorted ones (OpenCV, *Camera Calibration*)."""
        x, y = normalised[..., 0], normalised[..., 1]
        r2 = x * x + y * y
        radial = 1 + r2 * (self.k1 + r2 * (self.k2 + r2 * self.k3))
        return np.stack(
            [
                x * radial + 2 * self.p1 * x * y + self.p2 * (r2 + 2 * x * x),
                y * radial + self.p1 * (r2 + 2 * y * y) + 2 * self.p2 * x * y,
            ],
            axis=-1,
        )

    def reach(self, camera: PinholeCamera) -> float:
        """How far from the axis, in x / z, the lens neither folds the frame over nor moves it by its own size."""
        ideal, radii = _grid(camera)
        with np.errstate(over="ignore", invalid="ignore"):
            points = self.distort(ideal)
            across, down = np.diff(points[:-1], axis=1), np.diff(points[:, :-1], axis=0)
            # coefficients that overflow give NaN, which is not positive
            fits = across[..., 0] * down[..., 1] > across[..., 1] * down[..., 0]
            moved = np.abs(points - ideal) * [camera.fx, camera.fy]
            fits &= (moved < max(camera.size_wh)).all(axis=-1)[1:, 1:]
        return float(np.minimum(radii[1:, 1:], radii[:-1, :-1])[~fits].min(initial=np.inf))


def checked_distortion(values: object, camera: PinholeCamera, where: str) -> Distortion | None:
    """Check coefficients from the user for a camera; all zeros give ``None``. ``where`` is their place in messages."""
    try:
        given: list[object] = [] if isinstance(values, str) else list(values)  # type: ignore[call-overload]
        if any(isinstance(value, str | bool) for value in given):
            raise TypeError
        numbers = [float(value) for value in given]  # type: ignore[arg-type]
    except (TypeError, ValueError, OverflowError):
        raise InputError(f"{where}: expected [k1, k2, p1, p2, k3], found {described(values)}") from None
    if len(numbers) == 4:
        numbers.append(0.0)
    if len(numbers) != 5 or not np.isfinite(numbers).all():
        raise InputError(f"{where}: expected five finite numbers [k1, k2, p1, p2, k3], found {described(values)}")
    distortion = Distortion(*numbers)
    if not any(astuple(distortion)):
        return None
    if np.mean(_grid(camera)[1] < distortion.reach(camera)) < LEAST_OF_FRAME:
        raise InputError(
            f"{where}: expected a distortion that is invertible over the frame, found {described(values)}, which "
            "folds most of it over, or moves it by more than its size; use OpenCV's order [k1, k2, p1, p2, k3] (p1, p2 "
            "before k3)"
        )
    return distortion


def lens_doubts(distortion: Distortion | None, camera: PinholeCamera) -> list[str]:
    """What a user should know of the lens: where it ends."""
    reach = np.inf if distortion is None else distortion.reach(camera)
    masked = np.mean(_grid(camera)[1] >= reach)
    text = (
        f"the distortion folds the picture over from {reach * camera.fx:.0f} px off the principal point: what lies "
        f"beyond, {masked:.0%} of the frame, is masked"
    )
    return [text] if masked else []


def _grid(camera: PinholeCamera) -> tuple[np.ndarray, np.ndarray]:
    """(x / z, y / z) on a grid over the frame, and their distances from the axis."""
    u, v = (np.linspace(-0.5, side - 0.5, FOLD_GRID) for side in camera.size_wh)
    ideal = camera.rays_cam(np.stack(np.meshgrid(u, v), axis=-1))[..., :2]
    return ideal, np.hypot(ideal[..., 0], ideal[..., 1])


def undistort(image: np.ndarray, camera: PinholeCamera, distortion: Distortion) -> tuple[np.ndarray, np.ndarray]:
    """Resample a distorted ``(H, W, C)`` frame to the pinhole ``camera``, bilinearly.

    Returns
    -------
    The undistorted frame, and ``(H, W)`` bool: pixels whose content was inside the distorted frame.
    """
    resampled, inside = np.empty_like(image), np.empty(camera.shape_hw, dtype=bool)
    rows = max(1, _BLOCK // camera.width)
    for top in range(0, camera.height, rows):
        v, u = np.mgrid[top : min(top + rows, camera.height), : camera.width]
        pixels = distorted_pixels(camera, distortion, np.stack([u, v], axis=-1))
        inside[top : top + rows] = ((pixels >= 0) & (pixels <= [camera.width - 1, camera.height - 1])).all(axis=-1)
        block = resampled[top : top + rows]
        block[...] = sample_bilinear(image, pixels.reshape(-1, 2)).reshape(block.shape)
    return resampled, inside


def distorted_pixels(camera: PinholeCamera, distortion: Distortion, pixels: np.ndarray) -> np.ndarray:
    """``(..., 2)``: where in the distorted frame pixels of the pinhole image lie, px; beyond its reach far outside."""
    ideal = camera.rays_cam(np.asarray(pixels, np.float64))[..., :2]
    places = distortion.distort(ideal) * [camera.fx, camera.fy] + [camera.cx, camera.cy]
    places[np.hypot(ideal[..., 0], ideal[..., 1]) >= distortion.reach(camera)] = FAR_OUTSIDE_PX
    return places
