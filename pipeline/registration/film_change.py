"""Places of the surface that a film shows as the aligned frame does, and then no longer: bone that is drilled.

Where a frame agrees with its pose is counted by blocks of the aligned frame's image. Instruments, blood and glare come
and go; where a surface is steep, agreement comes and goes with the direction of view. So a place has changed if it
agreed first, and not to the end of the film, in frames that look from the same side.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from ..camera.pinhole import PinholeCamera
from ..transforms import camera_centre, transform_points
from .blocks import BLOCK_PX
from .flow_refinement import FlowFit
from .verdict import agreeing_blocks

MOST_FRAMES = 300
"""That are compared: of more, evenly chosen ones."""
LEAST_FRAMES, LEAST_SHARE = 4, 0.15
"""That agree first; and that no longer do, also as a share of the film."""
SAME_SIDE_DEG = 6.0
LEAST_PLACES = 4
"""Adjacent places without which it is chance."""
UNKNOWN, AGREES, DIFFERS = 0, 1, 2


@dataclass(frozen=True)
class FilmChange:
    """What a film no longer shows.

    Attributes
    ----------
    since
        Number of the first frame in which some of it has changed.
    places
        ``(h, w)`` bool: blocks of the aligned frame's image that have changed at the end.
    share
        Of the blocks that the film shows, 0..1.
    """

    since: int
    places: np.ndarray
    share: float

    def words(self) -> str:
        """What to think of it."""
        return (
            f"from frame {self.since} on, {self.share:.0%} of what the case's frame shows no longer looks as it did: "
            "is bone being removed? Depths and structures there are those before; no later frame gives colour"
        )


class FilmAgreement:
    """Collects where the frames of a film agree with an aligned frame."""

    def __init__(self, camera: PinholeCamera, cam_from_model: np.ndarray, pivot_model: np.ndarray) -> None:
        """Prepare the aligned frame's camera and pose ``(4, 4)``, and the ``(3,)`` middle of what it shows, mm."""
        self._camera, self._pose, self._pivot = camera, cam_from_model, pivot_model
        self._shape = -(-camera.height // BLOCK_PX), -(-camera.width // BLOCK_PX)
        self._numbers, self._sides, self._maps = list[int](), list[np.ndarray](), list[np.ndarray]()

    def add(self, number: int, fit: FlowFit) -> None:
        """Add a frame that is accepted."""
        pixels = self._camera.project(transform_points(self._pose, fit.points_model))
        places, known, agrees = agreeing_blocks(fit, np.clip(pixels, 0, np.array(self._camera.size_wh) - 1))
        shown, (column, row) = np.full(self._shape, UNKNOWN, np.uint8), places.T
        shown[row, column] = np.where(known, np.where(agrees, AGREES, DIFFERS), UNKNOWN)
        side = camera_centre(fit.cam_from_model) - self._pivot
        self._numbers.append(number)
        self._sides.append(side / np.linalg.norm(side))
        self._maps.append(shown)

    def change(self) -> FilmChange | None:
        """What has changed at the end, if anything has."""
        chosen = slice(None, None, max(1, -(-len(self._maps) // MOST_FRAMES)))
        numbers, sides, maps = self._numbers[chosen], np.array(self._sides[chosen]), np.array(self._maps[chosen])
        least = max(LEAST_FRAMES, int(np.ceil(LEAST_SHARE * len(maps))))
        if len(maps) < LEAST_FRAMES + least:
            return None
        near = sides @ sides.T > np.cos(np.radians(SAME_SIDE_DEG))
        agrees, differs = ((maps == each).reshape(len(maps), -1) for each in (AGREES, DIFFERS))
        # after the last frame that agrees
        last = len(maps) - 1 - np.argmax(agrees[::-1], axis=0)
        order = np.arange(len(maps))[:, None]
        differs &= (order > last) & (agrees.sum(axis=0) >= LEAST_FRAMES)
        seen_alike = differs & (near.astype(np.float32) @ agrees > 0)
        changed = (seen_alike.sum(axis=0) >= least).reshape(self._shape)
        _, labels, stats, _ = cv2.connectedComponentsWithStats(changed.astype(np.uint8), connectivity=8)
        changed &= stats[labels, cv2.CC_STAT_AREA] >= LEAST_PLACES
        if not changed.any():
            return None
        first = np.where(changed.ravel(), np.argmax(differs, axis=0), len(maps)).min()
        return FilmChange(numbers[first], changed, float(changed.sum() / (maps > UNKNOWN).any(axis=0).sum()))
