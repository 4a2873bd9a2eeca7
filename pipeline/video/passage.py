"""A passage of a film: at most a minute of frames in memory, compared with the clear views of their scenes."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import cv2
import numpy as np

from .clear_view import clear_view
from .frame_measures import BRIGHT_LUMA, BURNT_OUT, DETAIL_WH, GRID_WH, FrameMeasures, normalised_lab
from .obstruction import Obstruction, ObstructionFinder
from .scenes import Placement, SceneTracker

MOST_FRAMES = 1200
"""In a passage: its views take 60 MB."""

SAMPLES = 36
"""Frames of which a clear view is made."""

EARLIER_SAMPLES = 5
"""Samples as which an earlier passage's clear view of the same scene counts."""

_ROUNDS = 3

_BURNT_OUT_WORTH, _LEAST_WORTH = 0.1, 0.15
"""Weight of an overexposed frame as a sample, and least weight of a sample relative to the best."""

CLEAREST, MOST_DIFFERENT = 0.25, 0.01
"""If all but this share of a scene's frames differ from its clear view over more than that share of it, the camera goes
around the tissue, and no one view is what all frames show."""

_LEAST_CELL = 0.3
"""Share of a cell that must be inside the view."""


@dataclass(frozen=True)
class SceneView:
    """A scene's clear view during a passage.

    Attributes
    ----------
    reference
        ``(h, w, 3)`` CIELAB, float16.
    seen
        ``(h, w)`` bool: where it is known.
    still
        Whether the clearest frames look like it.
    """

    reference: np.ndarray
    seen: np.ndarray
    still: bool = True

    def finder(self) -> ObstructionFinder:
        """Finds what stands in front of it."""
        return ObstructionFinder(self.reference.astype(np.float32), self.seen, still=self.still)


@dataclass(frozen=True, slots=True)
class ComparedFrame:
    """A frame compared with its scene.

    Attributes
    ----------
    scene
        Number of the scene.
    sharpness
        0..1: details of the uncovered cells relative to the scene's sharpest frames.
    level
        Details of the scene's sharpest frames.
    obstructed, glare
        Shares of the view, 0..1.
    gain
        From the frame's code values to the brightness of the clear view.
    placement
        Of the frame in its scene.
    clear_view
        That it was compared with.
    """

    scene: int
    sharpness: float
    level: float
    obstructed: float
    glare: float
    gain: float
    placement: Placement
    clear_view: SceneView


@dataclass
class PassageComparison:
    """Compares passages of a film, one after the other; remembers the latest clear view of recent scenes."""

    inside: np.ndarray | None = None
    tracker: SceneTracker = field(init=False)
    known: dict[int, SceneView] = field(default_factory=dict)
    lit: np.ndarray = field(init=False)
    cells: np.ndarray = field(init=False)

    def __post_init__(self) -> None:
        self.tracker = SceneTracker(self.inside)
        self.lit = np.ones(DETAIL_WH[::-1], np.float32)
        if self.inside is not None:
            inner = cv2.erode(self.inside.astype(np.uint8), np.ones((5, 5), np.uint8))
            share = cv2.resize(inner.astype(np.float32), DETAIL_WH, interpolation=cv2.INTER_AREA)
            self.lit = (share > 0.99).astype(np.float32)
        share = cv2.resize(self.lit, GRID_WH, interpolation=cv2.INTER_AREA)
        self.cells = share > min(_LEAST_CELL, float(np.max(share)) / 2)

    def compare(self, frames: Sequence[FrameMeasures], step: Callable[[], None] | None = None) -> list[ComparedFrame]:
        """Compare the next passage's frames; ``step`` is called twice for each."""
        step = step or (lambda: None)
        placements = []
        for frame in frames:
            placements.append(self.tracker.place(frame.view))
            step()
        results: dict[int, ComparedFrame] = {}
        for scene in dict.fromkeys(placement.scene for placement in placements):
            numbers = [number for number, placement in enumerate(placements) if placement.scene == scene]
            compared = self._compare_scene(
                scene, [frames[number] for number in numbers], [placements[number] for number in numbers]
            )
            for _ in numbers:
                step()
            results.update(zip(numbers, compared, strict=True))
        for old in list(self.known)[:-8]:
            del self.known[old]
        return [results[number] for number in range(len(frames))]

    def _compare_scene(
        self, scene: int, frames: Sequence[FrameMeasures], placements: Sequence[Placement]
    ) -> list[ComparedFrame]:
        details = self._details(frames)
        typical = np.percentile(details, 75, axis=0) + 1e-9
        sharpness = np.median(np.minimum(details / typical, 1.5), axis=1)
        sharpness[np.array([frame.bright for frame in frames]) >= BURNT_OUT] *= _BURNT_OUT_WORTH
        luma = np.array([frame.luma for frame in frames])
        typical_gain = BRIGHT_LUMA / float(np.median([frame.bright for frame in frames]))
        gains = typical_gain * float(np.median(luma)) / luma
        obstructed = np.zeros(len(frames))
        earlier, found = self.known.get(scene), []
        for _ in range(_ROUNDS):
            chosen = _sample(sharpness, obstructed)
            reference, seen = self._clear_view([frames[k] for k in chosen], [placements[k] for k in chosen],
                                               gains[chosen], earlier)  # fmt: skip
            view = SceneView(reference.astype(np.float16), seen)
            found = self._found(view, frames, placements, gains)
            now = np.array([each.share + each.glare_share for each in found])
            settled = np.abs(now - obstructed).max() < 0.01
            obstructed, gains = now, np.array([each.gain for each in found])
            if settled:
                break
        if np.quantile([each.share for each in found], CLEAREST) > MOST_DIFFERENT:
            view = replace(view, still=False)
            found = self._found(view, frames, placements, gains)
        self.known.pop(scene, None)
        self.known[scene] = view
        covered = np.stack([
            _covered_cells(each, placement)[self.cells] for each, placement in zip(found, placements, strict=True)
        ])  # fmt: skip
        sharp, level = _sharpness(details, covered)
        return [
            ComparedFrame(
                scene, float(sharp[k]), level, found[k].share, found[k].glare_share, found[k].gain, placements[k], view
            )
            for k in range(len(frames))
        ]

    def _found(
        self, view: SceneView, frames: Sequence[FrameMeasures], placements: Sequence[Placement], gains: np.ndarray
    ) -> list[Obstruction]:
        """What stands in front of a scene's clear view in each frame."""
        finder = view.finder()
        return [
            finder.find(*registered(frame.view, placement, self.inside), gain)
            for frame, placement, gain in zip(frames, placements, gains, strict=True)
        ]

    def _clear_view(
        self,
        frames: Sequence[FrameMeasures],
        placements: Sequence[Placement],
        gains: np.ndarray,
        earlier: SceneView | None,
    ) -> tuple[np.ndarray, np.ndarray]:
        moved = [
            registered(frame.view, placement, self.inside) for frame, placement in zip(frames, placements, strict=True)
        ]
        samples = [normalised_lab(view, gain) for (view, _), gain in zip(moved, gains, strict=True)]
        valid = [each for _, each in moved]
        if earlier is not None:
            samples += [earlier.reference.astype(np.float32)] * EARLIER_SAMPLES
            valid += [earlier.seen] * EARLIER_SAMPLES
        return clear_view(np.stack(samples), np.stack(valid))

    def _details(self, frames: Sequence[FrameMeasures]) -> np.ndarray:
        """``(N, C)`` details in the cells inside the view, without those at its border."""

        def cells(fine: np.ndarray) -> np.ndarray:
            return cv2.resize(fine, GRID_WH, interpolation=cv2.INTER_AREA)

        weight = cells(self.lit)[self.cells]
        return np.stack([cells(frame.details * self.lit)[self.cells] for frame in frames]) / weight


def registered(view: np.ndarray, placement: Placement, inside: np.ndarray | None) -> tuple[np.ndarray, np.ndarray]:
    """A view ``(h, w, 3)`` in the pixels of its scene's key view, and ``(h, w)`` bool, where it shows something."""
    height, width = view.shape[:2]
    moved = cv2.warpAffine(view, placement.key_from_view, (width, height), flags=cv2.INTER_LINEAR)
    lit = np.full((height, width), 255, np.uint8) if inside is None else inside.astype(np.uint8) * 255
    return moved, cv2.warpAffine(lit, placement.key_from_view, (width, height), flags=cv2.INTER_LINEAR) > 250


def _covered_cells(found: Obstruction, placement: Placement) -> np.ndarray:
    """``(6, 8)`` share of each cell of the frame that is covered."""
    height, width = found.mask.shape
    mask = (found.mask | found.glare).astype(np.float32)
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    back = cv2.warpAffine(mask, placement.key_from_view, (width, height), flags=flags)
    return cv2.resize(back, GRID_WH, interpolation=cv2.INTER_AREA)


def _sample(sharpness: np.ndarray, obstructed: np.ndarray) -> np.ndarray:
    """Numbers of the frames for a clear view: the better half of the best frames of each moment."""
    worth = sharpness * np.exp(-obstructed)
    moments = np.array_split(np.arange(len(worth)), min(2 * SAMPLES, len(worth)))
    best = np.array([moment[np.argmax(worth[moment])] for moment in moments])
    best = best[worth[best] >= _LEAST_WORTH * worth.max()]
    keep = max(min(len(best), SAMPLES // 3), 2 * len(best) // 3)
    return np.sort(best[np.argsort(-worth[best], kind="stable")[:keep]])


def _sharpness(details: np.ndarray, covered: np.ndarray) -> tuple[np.ndarray, float]:
    """``(N,)`` sharpness of frames and the level of their scene from ``(N, C)`` details and covered shares of cells."""
    free = covered < 0.1
    visible = np.where(free, details, np.nan)
    counted = free.sum(axis=0) >= max(1, 0.05 * len(details))
    best = np.nanpercentile(np.where(counted, visible, details), 85, axis=0) + 1e-9
    ratio = np.where(free, np.minimum(details / best, 1), 0)
    weight = free * np.sqrt(best)
    total = weight.sum(axis=1)
    sharp = np.where(total > 0, (ratio * weight).sum(axis=1) / np.maximum(total, 1e-9), 0)
    return sharp, float(np.median(best))
