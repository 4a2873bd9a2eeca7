"""The pinhole camera: intrinsics K, projection and viewing rays, with (0, 0) at the centre of the top-left pixel."""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from ..errors import InputError
from ..files.keys import described
from ..transforms import checked_matrix, transform_points

SHORTEST_FOCAL_PX, LONGEST_FOCAL_PX = 1e-3, 1e9
"""Beyond these no image is meant, and squares may overflow."""

FARTHEST_PRINCIPAL_POINT = 5.0
"""Distance from the middle of the image, in image sizes: a crop of a larger image has one outside, none this far."""

LARGEST_RATIO_ERROR = 0.01
"""By which the sides of an image may be longer or shorter, relative to each other, than those that K is for."""

PixelOrigin = Literal["center", "corner"]


@dataclass(frozen=True)
class PinholeCamera:
    """A pinhole camera without skew or distortion.

    Attributes
    ----------
    width, height
        Image size in pixels.
    fx, fy
        Focal lengths in pixels.
    cx, cy
        Principal point in pixels; (0, 0) is the centre of the top-left pixel, so the image spans -0.5 .. width - 0.5.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float

    @classmethod
    def from_matrix(
        cls,
        k: object,
        *,
        size: tuple[int, int],
        pixel_origin: PixelOrigin = "center",
        where: str = "K",
    ) -> "PinholeCamera":
        """Check a 3x3 intrinsic matrix and a size from the user, and make a camera of them.

        Parameters
        ----------
        k
            Anything that should be a 3x3 matrix in pixels.
        size
            (width, height) in pixels.
        pixel_origin
            Where K has (0, 0): the "center" of the top-left pixel, or its "corner".
        where
            Names the place in messages.
        """
        matrix = checked_matrix(k, 3, where)
        if not np.allclose(matrix[2], [0, 0, 1]) or matrix[1, 0] != 0:
            raise InputError(f"{where}: expected [[fx, 0, cx], [0, fy, cy], [0, 0, 1]], found {matrix.tolist()}")
        if matrix[0, 1] != 0:
            raise InputError(
                f"{where}: expected no skew, found {matrix[0, 1]:g}; Blender's camera has none: "
                "rectify the frame (warp it with K_new @ inv(K), K_new without skew) and give K_new"
            )
        fx, fy = float(matrix[0, 0]), float(matrix[1, 1])
        if min(fx, fy) < SHORTEST_FOCAL_PX or max(fx, fy) > LONGEST_FOCAL_PX:
            raise InputError(f"{where}: expected positive focal lengths in pixels, found fx = {fx:g}, fy = {fy:g}")
        if pixel_origin not in ("center", "corner"):
            raise InputError(f'{where}: expected pixel_origin "center" or "corner", found {described(pixel_origin)}')
        width, height = _checked_size(size, where)
        shift = 0.5 if pixel_origin == "corner" else 0.0
        cx, cy = float(matrix[0, 2]) - shift, float(matrix[1, 2]) - shift
        if max(abs(cx / width - 0.5), abs(cy / height - 0.5)) > FARTHEST_PRINCIPAL_POINT:
            raise InputError(
                f"{where}: expected the principal point near the {width}x{height} image, found ({cx:g}, {cy:g})"
            )
        return cls(width, height, fx, fy, cx, cy)

    @property
    def k(self) -> np.ndarray:
        """``(3, 3)`` px_from_cam; (0, 0) is the centre of the top-left pixel."""
        return np.array([[self.fx, 0, self.cx], [0, self.fy, self.cy], [0, 0, 1.0]])

    @property
    def size_wh(self) -> tuple[int, int]:
        """(width, height) in pixels."""
        return self.width, self.height

    @property
    def shape_hw(self) -> tuple[int, int]:
        """(height, width): the shape of an image array."""
        return self.height, self.width

    def project(self, points_cam: np.ndarray) -> np.ndarray:
        """``(N, 3)`` points in the camera frame, mm -> ``(N, 2)`` pixels; NaN for points at or behind the camera.

        The equation of Zhang & Noble: (u, v, w) = K X, pixel = (u / w, v / w).
        """
        z = points_cam[..., 2]
        behind = ~(z > 0)
        pixels = np.empty((*points_cam.shape[:-1], 2))
        # column by column: numpy is slow along an axis of two
        with np.errstate(divide="ignore", invalid="ignore"):
            for axis, focal, centre in ((0, self.fx, self.cx), (1, self.fy, self.cy)):
                pixels[..., axis] = points_cam[..., axis] / z
                pixels[..., axis] *= focal
                pixels[..., axis] += centre
        pixels[behind] = np.nan
        return pixels

    def rays_cam(self, pixels: np.ndarray) -> np.ndarray:
        """``(N, 2)`` pixels -> ``(N, 3)`` ray directions in the camera frame, scaled so that z = 1."""
        directions = np.empty((*pixels.shape[:-1], 3))
        directions[..., :2] = (pixels - [self.cx, self.cy]) / [self.fx, self.fy]
        directions[..., 2] = 1.0
        return directions

    def pixel_grid(self) -> np.ndarray:
        """``(height, width, 2)`` coordinates of all pixel centres."""
        grid = np.empty((*self.shape_hw, 2))
        grid[..., 0], grid[..., 1] = np.arange(self.width), np.arange(self.height)[:, None]
        return grid

    def coarse_grid(self, along: int) -> np.ndarray:
        """``(N, 2)`` centres, px, of nearly square tiles of the image, row by row; ``along`` on the longer side."""
        step = max(self.size_wh) / along
        columns, rows = (max(2, round(size / step)) for size in self.size_wh)
        u, v = np.meshgrid(
            (np.arange(columns) + 0.5) * self.width / columns - 0.5,
            (np.arange(rows) + 0.5) * self.height / rows - 0.5,
        )
        return np.stack([u.ravel(), v.ravel()], axis=1)

    def contains(self, pixels: np.ndarray) -> np.ndarray:
        """``(N, 2)`` pixels -> ``(N,)`` bool: inside the image, up to the outer edges of its pixels."""
        u, v = pixels[..., 0], pixels[..., 1]
        return (u >= -0.5) & (u <= self.width - 0.5) & (v >= -0.5) & (v <= self.height - 0.5)

    def zoomed(self, factor: float) -> "PinholeCamera":
        """The camera with another focal length, relative to its own."""
        return replace(self, fx=factor * self.fx, fy=factor * self.fy)

    def resized(self, width: int, height: int) -> "PinholeCamera":
        """The camera of the image resampled to another size: c' = (c + 0.5) s - 0.5."""
        sx, sy = width / self.width, height / self.height
        return replace(
            self,
            width=width,
            height=height,
            fx=self.fx * sx,
            fy=self.fy * sy,
            cx=(self.cx + 0.5) * sx - 0.5,
            cy=(self.cy + 0.5) * sy - 0.5,
        )

    def within(self, longer_side_px: int) -> "PinholeCamera":
        """The camera of the image made so small that its longer side has at most so many pixels."""
        factor = min(longer_side_px / max(self.size_wh), 1.0)
        return self.resized(max(round(self.width * factor), 1), max(round(self.height * factor), 1))

    def for_images(self, size_wh: tuple[int, int], name: str) -> "PinholeCamera":
        """The camera for images of the same picture in another size; ``name`` is theirs, for the message."""
        across, down = size_wh[0] / self.width, size_wh[1] / self.height
        if abs(across / down - 1) > LARGEST_RATIO_ERROR:
            raise InputError(
                f"{name}: expected the proportions that K is for, {self.width}x{self.height} px, found "
                f"{size_wh[0]}x{size_wh[1]}; crop, or give their K"
            )
        return self if size_wh == self.size_wh else self.resized(*size_wh)


def _checked_size(size: object, where: str) -> tuple[int, int]:
    try:
        width, height = (float(side) for side in size)  # type: ignore[attr-defined]
        fits = all(side.is_integer() and 1 <= side <= 65536 for side in (width, height))
    except (TypeError, ValueError, OverflowError):
        fits = False
    if not fits:
        raise InputError(
            f"{where}: expected size = [width, height] in whole pixels from 1 to 65536, found {described(size)}"
        )
    return int(width), int(height)


def whereabouts(points: np.ndarray, camera: PinholeCamera, cam_from_points: np.ndarray) -> str | None:
    """Which side of the image points are on, e.g. ``"left of the frame and below it"``.

    Parameters
    ----------
    points
        ``(N, 3)`` mm.
    camera, cam_from_points
        Intrinsics and pose (4x4, mm).

    Returns
    -------
    ``None`` if the bounds of those in front of the camera reach into the image.
    """
    points_cam = transform_points(cam_from_points, points)
    points_cam = points_cam[points_cam[:, 2] > 0]
    if len(points_cam) == 0:
        return "behind the camera"
    u, v = camera.project(points_cam).T
    sides = (
        (u.max() < -0.5, "left of"), (u.min() > camera.width - 0.5, "right of"),
        (v.max() < -0.5, "above"), (v.min() > camera.height - 0.5, "below"),
    )  # fmt: skip
    words = [word for beyond, word in sides if beyond]
    if not words:
        return None
    return " and ".join([f"{words[0]} the frame", *(f"{word} it" for word in words[1:])])
