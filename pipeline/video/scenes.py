"""Scenes: frames that show the same view, found again after cuts, hands and blur. Needs ``cv2``.

Each scene has a key view. A frame belongs to a scene if a similarity transform, estimated from points tracked from the
key view (Lucas & Kanade 1981, RANSAC), brings enough of its parts into agreement with the key view. An instrument or a
hand may cover the others.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from .frame_measures import local_contrast

MOST_POINTS = 150
"""Points tracked from a key view."""

SAME_SHARE = 0.2
"""Least share of parts that must agree; by chance it is one in fifty."""

SURE_SHARE = 0.45
"""Share of parts from which on no other scene is tried."""

_PART_CORRELATION = 0.55
_PARTS_WH = (8, 6)
_MOST_SCENES = 8
_LARGEST_SHIFT = 0.35
_SCALES = (0.8, 1.25)


@dataclass(frozen=True, slots=True)
class Placement:
    """Where a frame belongs.

    ``key_from_view``, ``(2, 3)`` float64, goes from pixels of the frame's view to those of the scene's key view.
    """

    scene: int
    key_from_view: np.ndarray


@dataclass
class _Scene:
    key: np.ndarray
    smooth_key: np.ndarray
    points: np.ndarray
    last: np.ndarray


class SceneTracker:
    """Places frames into scenes, in the order of the film."""

    def __init__(self, inside: np.ndarray | None = None) -> None:
        """``inside``, bool of the size of the views: what the optics let through."""
        self._inside = None if inside is None else inside.astype(np.uint8)
        self._scenes: list[_Scene] = []
        self._order: list[int] = []

    def place(self, view: np.ndarray) -> Placement:
        """Place the next view, ``(h, w, 3)`` uint8 RGB; it opens a new scene if it belongs to none."""
        contrast = local_contrast(view)
        best, best_share, best_transform = -1, SAME_SHARE, np.eye(2, 3)
        for number in self._order[:_MOST_SCENES]:
            found = self._match(self._scenes[number], contrast)
            if found is not None and found[1] > best_share:
                best, best_transform, best_share = number, found[0], found[1]
                if best_share > SURE_SHARE:
                    break
        if best < 0:
            best = len(self._scenes)
            points = cv2.goodFeaturesToTrack(contrast, MOST_POINTS, 0.02, 4, mask=self._inside)
            points = np.empty((0, 1, 2), np.float32) if points is None else points
            self._scenes.append(_Scene(contrast, _smooth(contrast), points, np.eye(2, 3)))
        else:
            self._scenes[best].last = best_transform
            self._order.remove(best)
        self._order.insert(0, best)
        return Placement(best, best_transform)

    def _match(self, scene: _Scene, contrast: np.ndarray) -> tuple[np.ndarray, float] | None:
        """``key_from_view`` and the share of parts that agree."""
        if len(scene.points) < 8:
            return None
        view_from_key = cv2.invertAffineTransform(scene.last)
        guess = cv2.transform(scene.points, view_from_key)
        tracked, good, _ = cv2.calcOpticalFlowPyrLK(
            scene.key, contrast, scene.points, guess.astype(np.float32), winSize=(15, 15), maxLevel=2,
            flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
        )  # fmt: skip
        good = good.ravel().astype(bool)
        if good.sum() < 8:
            return None
        transform, _ = cv2.estimateAffinePartial2D(
            tracked[good], scene.points[good], ransacReprojThreshold=1.5, maxIters=200
        )
        if transform is None or not _plausible(transform, contrast.shape):
            return None
        return transform, self._agreement(scene, contrast, transform)

    def _agreement(self, scene: _Scene, contrast: np.ndarray, key_from_view: np.ndarray) -> float:
        height, width = contrast.shape
        moved = cv2.warpAffine(_smooth(contrast), key_from_view, (width, height))
        covered = cv2.warpAffine(np.ones((height, width), np.float32), key_from_view, (width, height))
        if self._inside is not None:
            covered = covered * self._inside

        def mean(image: np.ndarray) -> np.ndarray:
            return cv2.resize(image, _PARTS_WH, interpolation=cv2.INTER_AREA)

        key = scene.smooth_key
        share = mean(covered)
        parts = share > 0.7
        if not parts.any():
            return 0.0
        share = np.maximum(share, 1e-3)
        one, other = mean(key * covered) / share, mean(moved * covered) / share
        both = mean(key * moved * covered) / share - one * other
        spreads = (mean(key * key * covered) / share - one**2) * (mean(moved * moved * covered) / share - other**2)
        correlation = both / np.sqrt(np.maximum(spreads, 1.0))
        return float((correlation[parts] > _PART_CORRELATION).sum() / max(parts.sum(), parts.size / 2))


def _smooth(contrast: np.ndarray) -> np.ndarray:
    return cv2.GaussianBlur(contrast.astype(np.float32) - 128, (0, 0), 1.5)


def _plausible(transform: np.ndarray, shape: tuple[int, ...]) -> bool:
    height, width = shape
    scale = float(np.hypot(transform[0, 0], transform[1, 0]))
    centre = np.array([width / 2, height / 2])
    shift = transform[:, :2] @ centre + transform[:, 2] - centre
    return _SCALES[0] < scale < _SCALES[1] and bool((np.abs(shift) < _LARGEST_SHIFT * np.array([width, height])).all())
