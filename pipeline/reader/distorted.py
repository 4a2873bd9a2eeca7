"""A view as a camera with a distorting lens takes it: its image and all of its truths, moved alike."""

from collections.abc import Sequence
from functools import cached_property
from typing import Any

import cv2
import numpy as np

from ..camera.distortion import checked_distortion, distorted_pixels
from ..errors import InputError
from .view import View

EXACT_PX = 0.01
"""How near the lens must put a place of the view to its pixel: beyond what a barrel reaches there is none."""


class DistortedView:
    """The arrays of a :class:`.View`, in the image of a lens with distortion; its k, pose and number.

    Each pixel takes all arrays but ``rgb`` from one pixel of the view, the nearest, so they agree; ``rgb`` is
    interpolated. Where the view ends, or the lens puts nothing, all is 0 and points are NaN: beside a barrel's corners.
    """

    def __init__(self, view: View, coefficients: Sequence[float] | None = None) -> None:
        """Prepare a view.

        ``coefficients`` are OpenCV's k1, k2, p1, p2, k3; those of the case's frame if left out.
        """
        camera = view.files.description.camera
        if coefficients is None:
            found = view.files.description.content["frame"].get("distortion")
            if not found:
                raise InputError(f"view {view.index}: expected coefficients, as the frame had no distortion")
            coefficients = list(found.values())
        self._lens = checked_distortion(coefficients, camera, f"view {view.index}: distortion")
        self.view, self.coefficients, self._size_wh = view, tuple(coefficients), camera.size_wh

    @cached_property
    def _places(self) -> np.ndarray:
        """``(H, W, 2)`` float32: the pixel of the view that each pixel shows; -1, outside of it, for none."""
        width, height = self._size_wh
        pixels = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1).reshape(-1, 1, 2).astype(float)
        criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 50, 1e-9)
        k, lens = self.view.k, np.array(self.coefficients, float)
        places = cv2.undistortPointsIter(pixels, k, lens, np.eye(3), k, criteria)
        if self._lens is not None:
            # a search that went astray, and the lens of a view is invertible within it alone
            back = distorted_pixels(self.view.files.description.camera, self._lens, places)
            places[~((np.abs(back - pixels) < EXACT_PX) & (np.abs(places) < width + height)).all(axis=-1)] = -1
        return places.reshape(height, width, 2).astype(np.float32)

    def __getattr__(self, name: str) -> Any:
        """An array of the view, moved; or its number, k or pose."""
        if name == "view":  # while it is unpickled
            raise AttributeError(name)
        value = getattr(self.view, name)
        if name in ("index", "k", "cam_from_model"):
            return value
        if not isinstance(value, np.ndarray) or value.shape[1::-1] != self._size_wh:
            raise AttributeError(f"{name}: expected an array of the view's pixels")
        if name == "rgb":
            return cv2.remap(value, self._places[..., 0], self._places[..., 1], cv2.INTER_LINEAR)
        u, v = np.rint(self._places).astype(int).reshape(-1, 2).T
        inside = (u >= 0) & (v >= 0) & (u < self._size_wh[0]) & (v < self._size_wh[1])
        moved = np.full((len(u), *value.shape[2:]), np.nan if name == "points_model" else 0, value.dtype)
        moved[inside] = value[v[inside], u[inside]]
        return moved.reshape(value.shape)
