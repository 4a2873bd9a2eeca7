"""Decodes full frames in a thread, those asked for last first, and keeps the latest ones."""

import threading
from collections import OrderedDict
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ..pipeline.errors import InputError
from ..pipeline.video.film_reader import WIDEST, Film
from ..pipeline.video.frame_scores import FrameScore

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
