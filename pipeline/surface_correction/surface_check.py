"""Whether a surface is where registered frames show it: the quick question that every registration asks.

From the case's own frame a plane sweep, see :mod:`.plane_sweep`, asks the others in two halves. Where both put the
surface elsewhere, to the same side, it is wrong, or the case's pose is.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from ..case.frame import PosedFrame
from ..surface.mesh import TriangleMesh
from .frame_flow import Surface, SurfaceFrame, SurfaceView, cosines_between
from .plane_sweep import STEP_PX, swept_depths

LONGER_SIDE_PX = 240
"""Frames are compared at this size: coarse ones find what is far off, on smooth places too."""
LEAST_FRAMES, MOST_FRAMES, LEAST_ANGLE_DEG = 10, 14, 15.0
"""Fewer, or nearer to one another, do not tell."""
PLACE_PX, LEAST_TOLD = 8, 0.25
"""Side of the places that are judged, and the part of one that must be told of by both halves."""
WRONG_PX = 1.25
"""By how much both halves must put a place elsewhere, in pixels on the surface."""
LEAST_WRONG = 0.01
"""Part of the places below which nothing is said: up to 0.007 on a true surface, 0.009 and more on wrong ones."""
TINT = 0.6
NEARER, FARTHER = (0.85, 0.1, 0.1), (0.1, 0.25, 0.9)
"""Colours of what lies nearer to the lens than the surface, and farther."""


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
        wrong, nearer = (
            cv2.resize(each.astype(np.uint8), image.shape[1::-1], interpolation=cv2.INTER_NEAREST)[..., None] > 0
            for each in (self.wrong, self.off_mm > 0)
        )
        return grey + TINT * wrong * (np.where(nearer, NEARER, FARTHER) - grey)


def check_surface(
    mesh: TriangleMesh, pivot_model: np.ndarray, source: PosedFrame, others: Sequence[PosedFrame]
) -> SurfaceCheck | None:
    """Ask frames at their poses where a surface is; ``None`` if they are too few, or too near to one another.

    Parameters
    ----------
    mesh
        Model frame, mm.
    pivot_model
        ``(3,)`` the middle of what the case's frame shows, mm.
    source, others
        The case's frame, and those that are registered, at :data:`LONGER_SIDE_PX`.
    """
    cosines = cosines_between(np.stack([each.cam_from_model for each in (source, *others)]), pivot_model)
    if len(others) < LEAST_FRAMES or cosines.min() > np.cos(np.radians(LEAST_ANGLE_DEG)):
        return None
    view = SurfaceView(Surface(mesh, None), SurfaceFrame(source), source.cam_from_model)
    laid = [(SurfaceFrame(each), each.cam_from_model) for each in others]
    normals = mesh.face_normals[view.hits.face].reshape(view.points.shape)
    # the sweep says how much nearer the surface is than it should be
    along = -np.abs((view.rays * normals).sum(axis=-1))
    halves, told = list[np.ndarray](), _places(view.shown).all(axis=-1)
    for half in (laid[::2], laid[1::2]):
        off_mm, says = swept_depths(view, half, STEP_PX * view.pixel_mm)
        off_mm = cv2.medianBlur(off_mm, 5)
        told &= _places(says).mean(axis=-1) > LEAST_TOLD
        halves.append(np.ma.median(np.ma.array(_places(off_mm * along), mask=~_places(says)), axis=-1).filled(0.0))
    one, other = halves
    wrong = told & (one * other > 0) & (np.minimum(np.abs(one), np.abs(other)) > WRONG_PX * view.pixel_mm)
    return SurfaceCheck(np.where(told, (one + other) / 2, np.nan), wrong, len(others))


def _places(image: np.ndarray) -> np.ndarray:
    """``(h, w, N)`` the pixels of each place; a rest at the right and below is left out."""
    height, width = (side // PLACE_PX for side in image.shape)
    cut = image[: height * PLACE_PX, : width * PLACE_PX].reshape(height, PLACE_PX, width, PLACE_PX)
    return cut.swapaxes(1, 2).reshape(height, width, -1)
