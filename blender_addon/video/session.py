"""A scored video in memory, and its full frames, which a thread decodes.

The scene stores the video's path only: in a file that is opened again, scoring is offered.
"""

import os
import threading
import time
from collections import OrderedDict
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from hashlib import sha256
from pathlib import Path

import bpy
import numpy as np
from bpy.props import BoolProperty, FloatProperty, IntProperty, StringProperty

from ..class_registration import at_end, attached, prop
from ..pipeline.errors import InputError
from ..pipeline.video.film_reader import WIDEST, Film, Thumbnails
from ..pipeline.video.frame_scores import FilmScores, FrameScore, best_frames, score_frames
from ..state import from_scene
from ..state.events import redraw

AHEAD = 4
"""Frames decoded with the one asked for, in the direction of the last step: the start of a decoder takes longer."""

MOST_BYTES = 120e6
"""Of the frames that are kept; one is always kept."""


class FrameFetcher:
    """The full frames of a scored film; positions are those in its list of scores."""

    def __init__(self, path: Path, frames: Sequence[FrameScore]) -> None:
        self._path, self._frames = path, frames
        self._positions = {score.index: at for at, score in enumerate(frames)}
        self._lock = threading.Lock()
        self._kept: OrderedDict[int, np.ndarray] = OrderedDict()
        self._failed: dict[int, str] = {}
        self._wanted: int | None = None
        self._before = -1
        self._thread: threading.Thread | None = None

    def frame(self, at: int) -> np.ndarray | None:
        """``(H, W, 3)`` uint8 RGB, or ``None`` as long as it is not decoded."""
        with self._lock:
            found = self._kept.get(at)
            if found is not None:
                self._kept.move_to_end(at)
            return found

    def failure(self, at: int) -> str:
        """Why a frame cannot be decoded; empty if it can, or nobody knows yet."""
        return self._failed.get(at, "")

    def want(self, at: int) -> None:
        """Decode a frame; what was wanted before is no longer."""
        with self._lock:
            self._wanted = at
            if at in self._kept or at in self._failed or (self._thread is not None and self._thread.is_alive()):
                return
            self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Want nothing: the thread ends at its next frame."""
        with self._lock:
            self._wanted = None

    def wait(self, at: int) -> None:
        """Decode a frame now."""
        self.want(at)
        thread = self._thread
        if thread is not None:
            thread.join()

    def _run(self) -> None:
        while True:
            with self._lock:
                at = self._wanted
                if at is None or at in self._kept or at in self._failed:
                    self._thread = None
                    return
            try:
                self._decode(at)
            except InputError as error:
                self._failed[at] = str(error)
            if self.frame(at) is None:
                self._failed.setdefault(at, f"cannot decode frame {self._frames[at].index}")

    def _decode(self, at: int) -> None:
        first, last = (at - AHEAD, at) if at == self._before - 1 else (at, at + AHEAD)
        first, last = max(first, 0), min(last, len(self._frames) - 1)
        numbers = self._frames[first].index, self._frames[last].index + 1
        with Film(self._path, numbers=numbers, width=WIDEST) as film:
            for frame in film:
                position = self._positions.get(frame.index)
                if position is None:
                    continue
                self._keep(position, frame.image)
                wanted = self._wanted
                if wanted is None or not (position < wanted <= last or wanted in self._kept):
                    break
        self._before = at

    def _keep(self, at: int, image: np.ndarray) -> None:
        with self._lock:
            self._kept[at] = image
            self._kept.move_to_end(at)
            while len(self._kept) > 1 and sum(kept.nbytes for kept in self._kept.values()) > MOST_BYTES:
                self._kept.popitem(last=False)


BEST = 5
"""Frames that the Timeline marks."""

Key = tuple[str, int, float, float]
"""Path of the video, every so many frames, from ... to in s; 0 for the end."""


class ONEFRAME_PG_video(bpy.types.PropertyGroup):
    """The video of a scene."""

    path: str = prop(StringProperty, "Video", "The film of the microscope", subtype="FILE_PATH")
    every: int = prop(IntProperty, "Every", "Only every so many frames were scored", default=1, min=1)
    from_s: float = prop(FloatProperty, "From (s)", "Where the scored part begins", min=0)
    to_s: float = prop(FloatProperty, "To (s)", "Where it ends; 0 for the end of the film", min=0)
    visible: bool = prop(BoolProperty, "Film", "The film is shown", default=True, update=redraw, options={"HIDDEN"})
    taken_path: str = prop(
        StringProperty, description="The frame that was taken from the video", subtype="FILE_PATH", options={"HIDDEN"}
    )


@dataclass
class FilmSession:
    """A film with its scores.

    Attributes
    ----------
    path, scores, thumbnails
        The film, and what was found in its one pass.
    best
        Positions of the best frames in the list of scores, the best first.
    times_s
        ``(N,)`` of all frames.
    shown
        Position of the frame in view.
    shown_since
        When it came into view, by the clock of :mod:`time`.
    picture
        ``(H, W, 3)`` uint8 RGB that stands for it: full, or a thumbnail until that is decoded.
    is_full
        Whether that is the full frame.
    """

    path: Path
    scores: FilmScores
    thumbnails: Thumbnails
    best: tuple[int, ...] = ()
    times_s: np.ndarray = field(default_factory=lambda: np.empty(0))
    shown: int = 0
    shown_since: float = 0.0
    picture: np.ndarray = field(default_factory=lambda: np.zeros((1, 1, 3), np.uint8))
    is_full: bool = False

    def __post_init__(self) -> None:
        frames = self.scores.frames
        positions = {score.index: at for at, score in enumerate(frames)}
        self.best = tuple(positions[score.index] for score in best_frames(frames, BEST))
        self.times_s = np.array([score.time_s for score in frames])
        # while it is there
        _ = self.digest
        self.fetcher = FrameFetcher(self.path, frames)
        self.show(self.best[0] if self.best else int(np.argmax([score.total for score in frames])))

    @cached_property
    def digest(self) -> str:
        """That of the file's size, beginning and end, which tells it from other films."""
        part = 1 << 20
        with self.path.open("rb") as file:
            size = file.seek(0, os.SEEK_END)
            ends = []
            for begin in (0, max(size - part, 0)):
                file.seek(begin)
                ends.append(file.read(part))
        return sha256(b"%d" % size + b"".join(ends)).hexdigest()

    @property
    def score(self) -> FrameScore:
        """That of the frame in view."""
        return self.scores.frames[self.shown]

    def show(self, at: int) -> None:
        """Bring a frame into view: at once as a thumbnail, unless it is decoded already."""
        self.shown = min(max(at, 0), len(self.times_s) - 1)
        self.shown_since = time.monotonic()
        full = self.fetcher.frame(self.shown)
        self.is_full = full is not None
        self.picture = self.thumbnails.nearest(self.score.index)[1] if full is None else full

    def rank(self, at: int) -> int:
        """1 for the best frame; 0 for all but the best ones."""
        return self.best.index(at) + 1 if at in self.best else 0


_sessions: dict[Key, FilmSession] = {}
"""One: a session holds up to 200 MB."""


def key_of(scene: bpy.types.Scene) -> Key | None:
    """What the scene's video is; ``None`` if it has none."""
    settings = scene.oneframe_video
    if not settings.path:
        return None
    # Blender's 0.4 is a little more, and would leave out the frame at 0.4 s
    from_s, to_s = (from_scene.shortest(value) for value in (settings.from_s, settings.to_s))
    return str(from_scene.absolute_path(settings.path)), settings.every, from_s, to_s


def of(scene: bpy.types.Scene) -> FilmSession | None:
    """The scene's video if it is scored."""
    key = key_of(scene)
    return None if key is None else _sessions.get(key)


def scored(scene: bpy.types.Scene) -> FilmSession:
    """The scene's video."""
    found = of(scene)
    if found is None:
        raise InputError(
            "expected a video, found none; open one" if key_of(scene) is None else "press Score Again first"
        )
    return found


def scorer(key: Key) -> Callable[[Callable[[float], None]], FilmSession]:
    """A function that decodes and scores a film, for a thread."""
    path, every, from_s, to_s = key

    def score(progress: Callable[[float], None]) -> FilmSession:
        thumbnails = Thumbnails()
        scores = score_frames(
            Path(path), every=every, from_s=from_s, to_s=to_s or None, progress=progress, thumbnails=thumbnails
        )
        return FilmSession(Path(path), scores, thumbnails)

    return score


def keep(scene: bpy.types.Scene, session: FilmSession) -> None:
    """Keep a scored film in memory as that of the scene."""
    key = key_of(scene)
    _forget()
    if key is not None:
        _sessions[key] = session


def return_to(scene: bpy.types.Scene) -> FilmSession | None:
    """After undo: give the scene back the film that is open, if it took that away; scoring it again takes minutes."""
    if not _sessions or of(scene) is not None:
        return None
    settings = scene.oneframe_video
    ((key, film),) = _sessions.items()
    settings.path, settings.every, settings.from_s, settings.to_s = key
    return film


def _forget() -> None:
    for session in _sessions.values():
        session.fetcher.stop()
    _sessions.clear()


PARTS = (at_end(_forget), attached(bpy.types.Scene, "oneframe_video", ONEFRAME_PG_video))
