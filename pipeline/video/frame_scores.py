"""How well each frame of a film shows the tissue: sharp, well exposed, still, without glare, instruments and hands."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from ..errors import InputError
from .film_reader import Film, FilmFrame, FilmInfo, Thumbnails
from .frame_measures import BURNT_OUT, GRID_WH, VIEW_WIDTH, FrameMeasures, lit_part, measured, view_of

COMBED = 1.1
"""Comb ratio from which on a frame shows two moments in its fields."""

OBSTRUCTION_SHARE, GLARE_SHARE = 0.02, 0.03
"""Covered shares of the view that divide the score by e."""

EXPOSURE_STOPS = 0.45
BRIGHTEST_SHARE = 0.15
"""So many of the frames that are not burnt out, the brightest, are well exposed."""

SHARPEST, SHARPNESS_POWER = 95, 4
"""Percentile of the details that counts as sharp, and power of the sharpness in the score."""

MOTION_VIEW_PX, LARGEST_NOISE_PX = 0.6, 0.6
"""Movement that halves the score, px of the view, beyond that of the film's stillest frames, which is noise up to the
second."""

COMBED_FACTOR = 0.3

USUAL = 10
"""Percentile of the film's frames: what so many show of glare and of cold colours is the tissue's own."""

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
        0..1, relative to the film's sharpest frames, of what is not covered.
    exposure
        Brightness in stops relative to the film's well exposed frames.
    glare, obstructed
        Shares of the view, 0..1, beyond what most frames show: what is pale, and highlights; metal and gloves.
    motion_px
        Movement since the frame before, px of the full frame.
    comb
        Ratio of the differences between neighbouring rows and rows of a field; above :data:`COMBED` it is interlaced.
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
    inside
        ``(h, w)`` bool in the small pictures: what the optics let through; ``None`` for everything.
    broken
        Whether frames are missing that the file should hold.
    """

    info: FilmInfo
    frames: tuple[FrameScore, ...]
    inside: np.ndarray | None
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
        return FilmScores(film.info, frames, scorer.inside(), broken)


class FilmScorer:
    """Scores frames as they come; memory does not grow with their pictures."""

    def __init__(self, info: FilmInfo, progress: Callable[[float], None] | None = None) -> None:
        self._info, self._progress = info, progress
        self._frames: list[tuple[int, float, float]] = []
        self._measures: list[FrameMeasures] = []
        self._previous: np.ndarray | None = None
        self._brightness = np.zeros(info.small_wh[::-1])

    def add(self, frame: FilmFrame) -> None:
        """Take the next frame."""
        cv2.accumulate(cv2.cvtColor(frame.image, cv2.COLOR_RGB2GRAY), self._brightness)
        self._measures.append(measured(frame.image, self._previous))
        self._previous = view_of(frame.image)
        self._frames.append((frame.index, frame.time_s, frame.comb))
        if self._progress:
            self._progress(min(len(self._frames) / max(self._info.frames, 1), 1.0))

    def finished(self) -> tuple[FrameScore, ...]:
        """The scores of all frames."""
        if not self._frames:
            return ()
        inside, cells = self.inside(), np.ones(GRID_WH[::-1], np.bool_)
        if inside is not None:
            inside = view_of(inside.astype(np.uint8) * 255) > 250
            # without the edge of the view, which is sharp in every frame
            inner = cv2.erode(inside.astype(np.uint8), np.ones((5, 5), np.uint8)).astype(np.float32)
            share = np.asarray(cv2.resize(inner, GRID_WH, interpolation=cv2.INTER_AREA))
            cells = share >= min(0.99, float(np.max(share)))
        scale = self._info.size_wh[0] / min(VIEW_WIDTH, self._info.small_wh[0])
        shown = 1.0 if inside is None else float(inside.mean())
        return _combined(self._frames, self._measures, cells, shown, scale)

    def inside(self) -> np.ndarray | None:
        """``(h, w)`` bool, in the small pictures: what the optics let through, if there is a border."""
        return lit_part(self._brightness / max(len(self._frames), 1))


def _combined(
    frames: Sequence[tuple[int, float, float]],
    measures: Sequence[FrameMeasures],
    cells: np.ndarray,
    shown: float,
    scale: float,
) -> tuple[FrameScore, ...]:
    """Totals of the frames of a film.

    Parameters
    ----------
    frames
        Index, time in s and comb ratio of each.
    measures
        Of each.
    cells
        ``(12, 16)`` bool: those inside the view.
    shown
        Share of the picture that is inside the view.
    scale
        Pixels of the full frame in a pixel of the view.
    """
    details = np.array([each.details[cells].mean(dtype=np.float64) for each in measures])
    luma, bright, covered, pale, white, motion = (
        np.array([getattr(each, name) for each in measures])
        for name in ("luma", "bright", "covered", "glare", "highlights", "motion")
    )
    # nothing comes before the first
    motion[:1] = motion[1:2] if len(motion) > 1 else 0
    whole = bright < BURNT_OUT
    typical_luma = np.percentile(luma[whole] if whole.mean() > BRIGHTEST_SHARE else luma, 100 * (1 - BRIGHTEST_SHARE))
    exposure = np.log2(luma / typical_luma)
    # dark frames have details of noise
    is_exposed = np.abs(exposure) < 1
    sharpest = np.percentile(details[is_exposed] if is_exposed.any() else details, SHARPEST)
    sharpness = np.minimum(details / max(float(sharpest), 1e-9), 1)
    obstructed, pale, white = (
        np.maximum(each - np.percentile(each, USUAL), 0) / shown for each in (covered, pale, white)
    )
    glare = pale + white
    moved = np.maximum(motion - min(float(np.percentile(motion, USUAL)), LARGEST_NOISE_PX), 0)
    comb = np.array([each[2] for each in frames])
    total = (
        sharpness**SHARPNESS_POWER
        * np.exp(-obstructed / OBSTRUCTION_SHARE)
        * np.exp(-glare / GLARE_SHARE)
        * np.exp(-((exposure / EXPOSURE_STOPS) ** 2))
        / (1 + (moved / MOTION_VIEW_PX) ** 2)
        * np.where(comb > COMBED, COMBED_FACTOR, 1.0)
    )
    return tuple(
        FrameScore(
            index, time_s, float(sharpness[k]), float(exposure[k]), float(glare[k]), float(obstructed[k]),
            float(motion[k] * scale), float(comb_ratio), float(total[k]),
        )
        for k, (index, time_s, comb_ratio) in enumerate(frames)
    )  # fmt: skip


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
