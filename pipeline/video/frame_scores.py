"""How well each frame of a film shows the tissue: sharp, well exposed, still, without glare, instruments and hands."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from ..errors import InputError
from .film_reader import Film, FilmFrame, FilmInfo, Thumbnails
from .frame_measures import BURNT_OUT, VIEW_WIDTH, FrameMeasures, measured, motion_px, view_of
from .passage import MOST_FRAMES, ComparedFrame, PassageComparison
from .view_circle import Circle, lit_part, view_circle

COMBED = 1.1
"""Comb ratio from which on a frame shows two moments in its fields."""

OBSTRUCTION_SHARE, GLARE_SHARE = 0.02, 0.03
"""Covered shares of the view that divide the score by e."""

EXPOSURE_STOPS = 0.45
BRIGHTEST_SHARE = 0.15
"""So many of the frames that are not burnt out, the brightest, are well exposed."""

MOTION_VIEW_PX = 0.6
COMBED_FACTOR = 0.3

SCENE_SECONDS, SCENE_FRAMES = 1.0, 8
"""A scene that is shown for less time counts less: it may be a hand before the lens."""

APART_SECONDS, NEAREST_SECONDS = 1.0, 0.12
"""Chosen frames lie this far apart; less, rather than take a worse one, but never less than the second."""

LEAST_OF_BEST = 0.75
"""Worst score that is chosen, relative to the best."""

LEAST = 0.01
"""Frames of a lower score show nothing: black, or nothing that any other frame shows too."""


@dataclass(frozen=True, slots=True)
class FrameScore:
    """The score of a frame, and what it rests on.

    Attributes
    ----------
    index, time_s
        Number of the frame from 0 in display order, and the container's time.
    sharpness
        0..1, relative to the sharpest frames of the same scene.
    exposure
        Brightness of the tissue in stops relative to the scene's well exposed frames.
    glare, obstructed
        Shares of the view, 0..1: light that other frames do not show; instruments, hands, blood.
    motion_px
        Movement since the frame before, px of the full frame.
    comb
        Ratio of the differences between neighbouring rows and rows of a field; above :data:`COMBED` it is interlaced.
    scene
        Frames of one scene show the same view.
    total
        0..1; larger is better.
    """

    index: int
    time_s: float
    sharpness: float
    exposure: float
    glare: float
    obstructed: float
    motion_px: float
    comb: float
    scene: int
    total: float


@dataclass(frozen=True)
class FilmScores:
    """The scores of a film.

    Attributes
    ----------
    info
        Of the film.
    frames
        In display order; only those that could be decoded.
    compared
        What each frame was compared with, for its mask.
    inside
        ``(h, w)`` bool in pixels of the small view: what the optics let through; ``None`` for everything.
    circle
        That of the microscope or endoscope in px of the full frame, if it shows one.
    broken
        Whether frames are missing that the file should hold.
    """

    info: FilmInfo
    frames: tuple[FrameScore, ...]
    compared: tuple[ComparedFrame, ...]
    inside: np.ndarray | None
    circle: Circle | None
    broken: bool


def score_frames(
    path: Path,
    *,
    every: int = 1,
    from_s: float = 0.0,
    to_s: float | None = None,
    progress: Callable[[float], None] | None = None,
    thumbnails: Thumbnails | None = None,
) -> FilmScores:
    """Score the frames of a video.

    Parameters
    ----------
    path
        The video.
    every
        Score only every so many frames.
    from_s, to_s
        Score only frames displayed from ... to before these times.
    progress
        Called after each frame with the fraction done; an exception that it raises stops the work. Any thread.
    thumbnails
        Gets small pictures of the film, which is decoded only once.

    Raises
    ------
    InputError
        No file, not a video, no frames, or frames too large.
    """
    with Film(path, every=every, from_s=from_s, to_s=to_s) as film:
        scorer, count = FilmScorer(film.info, progress), 0
        for frame in film:
            scorer.add(frame)
            if thumbnails is not None:
                thumbnails.add(frame)
            count += 1
        frames = scorer.finished()
        broken = film.broken or count < film.info.frames or film.info.missing_s > 0
        if not frames:
            raise InputError(f"{film.path.name}: expected a video, cannot decode any frame of it; copy it again")
        return FilmScores(film.info, frames, scorer.compared, scorer.inside, scorer.circle(), broken)


class FilmScorer:
    """Scores frames as they come; memory does not grow with their pictures."""

    def __init__(self, info: FilmInfo, progress: Callable[[float], None] | None = None) -> None:
        self._info, self._progress, self._steps = info, progress, 0
        self._seen: list[tuple[int, float, float, float, float]] = []
        self._compared: list[ComparedFrame] = []
        self._pending: list[FrameMeasures] = []
        self._comparison: PassageComparison | None = None
        self._previous: np.ndarray | None = None
        self._brightness: np.ndarray | None = None

    def add(self, frame: FilmFrame) -> None:
        """Take the next frame."""
        grey = cv2.cvtColor(frame.image, cv2.COLOR_RGB2GRAY)
        if self._brightness is None:
            self._brightness = np.zeros(grey.shape, np.float64)
        cv2.accumulate(grey, self._brightness)
        found = measured(frame.image)
        motion = 0.0 if self._previous is None else motion_px(found.view, self._previous)
        self._previous = found.view
        self._seen.append((frame.index, frame.time_s, frame.comb, motion, found.bright))
        self._pending.append(found)
        self._step()
        if len(self._pending) >= MOST_FRAMES:
            self._compare()

    def finished(self) -> tuple[FrameScore, ...]:
        """The scores of all frames."""
        self._compare()
        if not self._seen:
            return ()
        scale = self._info.size_wh[0] / min(VIEW_WIDTH, self._info.small_wh[0])
        return combined(self._seen, self._compared, scale)

    @property
    def compared(self) -> tuple[ComparedFrame, ...]:
        """What the frames were compared with."""
        return tuple(self._compared)

    @property
    def inside(self) -> np.ndarray | None:
        """``(h, w)`` bool, in pixels of the view: what the optics let through, if there is a border."""
        return None if self._comparison is None else self._comparison.inside

    def circle(self) -> Circle | None:
        """The circle of the view, px of the full frame."""
        if self._brightness is None:
            return None
        circle = view_circle(self._brightness / max(len(self._seen), 1))
        if circle is None:
            return None
        across, down = (full / small for full, small in zip(self._info.size_wh, self._info.small_wh, strict=True))
        return circle.scaled(across, down)

    def _step(self) -> None:
        """Each frame takes three: it is measured, placed and compared."""
        self._steps += 1
        if self._progress:
            self._progress(min(self._steps / (3 * max(self._info.frames, 1)), 1.0))

    def _compare(self) -> None:
        if not self._pending:
            return
        if self._comparison is None:
            self._comparison = PassageComparison(self._lit())
        self._compared += self._comparison.compare(self._pending, self._step)
        self._pending = []

    def _lit(self) -> np.ndarray | None:
        """Where the optics let light through, in pixels of the view."""
        if self._brightness is None:
            return None
        part = lit_part(self._brightness / max(len(self._seen), 1))
        if part is None:
            return None
        return view_of(part.astype(np.uint8) * 255) > 250


def combined(
    seen: Sequence[tuple[int, float, float, float, float]], compared: Sequence[ComparedFrame], scale: float
) -> tuple[FrameScore, ...]:
    """Totals of the frames of a film.

    Parameters
    ----------
    seen
        Index, time in s, comb ratio, motion in px of the view, and brightest code value of each frame.
    compared
        Each frame's comparison with its scene.
    scale
        Pixels of the full frame in a pixel of the view.
    """
    index, time_s, comb, motion, bright = (np.array(column) for column in zip(*seen, strict=True))
    scene = np.array([each.scene for each in compared])
    gain = np.array([each.gain for each in compared])
    level = np.array([each.level for each in compared])
    sharpness, obstructed, glare = (
        np.array([getattr(each, name) for each in compared]) for name in ("sharpness", "obstructed", "glare")
    )
    exposure, weight = np.zeros(len(seen)), np.zeros(len(seen))
    step_s = float(np.median(np.diff(time_s))) if len(seen) > 1 else 0.0
    enough = min(max(SCENE_FRAMES, SCENE_SECONDS / max(step_s, 1e-3)), 0.1 * len(seen))
    for number in np.unique(scene):
        own = scene == number
        exposure[own] = np.log2(_typical_gain(gain[own], bright[own]) / gain[own])
        weight[own] = min(1.0, own.sum() / max(enough, 1.0))
    moved = np.maximum(motion - np.percentile(motion, 10), 0)
    substantial = weight > 0.5
    best_level = float(level[substantial].max()) if substantial.any() else float(level.max())
    total = (
        sharpness**2
        * np.minimum(level / best_level, 1) ** 0.5
        * np.exp(-obstructed / OBSTRUCTION_SHARE)
        * np.exp(-glare / GLARE_SHARE)
        * np.exp(-((exposure / EXPOSURE_STOPS) ** 2))
        / (1 + (moved / MOTION_VIEW_PX) ** 2)
        * np.where(comb > COMBED, COMBED_FACTOR, 1.0)
        * weight
    )
    return tuple(
        FrameScore(
            int(index[k]), float(time_s[k]), float(sharpness[k]), float(exposure[k]), float(glare[k]),
            float(obstructed[k]), float(motion[k] * scale), float(comb[k]), int(scene[k]), float(total[k]),
        )
        for k in range(len(seen))
    )  # fmt: skip


def _typical_gain(gain: np.ndarray, bright: np.ndarray) -> float:
    """The gain of well exposed frames: the brightest, as long as their highlights alone are burnt out."""
    whole = bright < BURNT_OUT
    return float(np.percentile(gain[whole] if whole.mean() > BRIGHTEST_SHARE else gain, 100 * BRIGHTEST_SHARE))


def best_frames(scores: Sequence[FrameScore], count: int, *, apart_s: float = APART_SECONDS) -> tuple[FrameScore, ...]:
    """At most ``count`` frames, the best first; of equal ones the earlier.

    Parameters
    ----------
    scores
        In display order.
    count
        How many.
    apart_s
        Time between two of them. Where that leaves too few, it is halved as often as needed, down to
        :data:`NEAREST_SECONDS`: a good frame's neighbour is worth more than a frame with an instrument in it.
    """
    best = max((each.total for each in scores), default=0.0)
    good = sorted(
        (each for each in scores if each.total >= max(LEAST_OF_BEST * best, LEAST)), key=lambda each: -each.total
    )
    chosen: list[FrameScore] = []
    while good:
        for score in good:
            if len(chosen) == count:
                return _best_first(chosen)
            if all(
                abs(score.time_s - other.time_s) >= apart_s - 1e-6 and score.index != other.index for other in chosen
            ):
                chosen.append(score)
        if apart_s <= NEAREST_SECONDS:
            break
        apart_s = max(apart_s / 2, NEAREST_SECONDS)
    return _best_first(chosen)


def _best_first(scores: list[FrameScore]) -> tuple[FrameScore, ...]:
    return tuple(sorted(scores, key=lambda each: (-each.total, each.index)))
