"""A video, frame by frame as small pictures, or a single frame: decoded apart, one at a time, in display order."""

import json
import math
from bisect import bisect_left
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType

import cv2
import numpy as np

from ..errors import InputError
from .decoding_process import DecodingError, decoded_apart, undecodable

SMALL_WIDTH = 480
"""Width in px of the small pictures."""

WIDEST = 1 << 16
"""No film is wider: its frames come at their own size."""

MOST = 200
"""Thumbnails that are kept."""

MOST_PIXELS = 320 * 180
"""Pixels of one thumbnail: all of them take 35 MB."""


@dataclass(frozen=True)
class FilmInfo:
    """What is known of a film before its frames.

    Attributes
    ----------
    frames
        How many the file holds between the chosen times, decodable or not.
    fps
        As the header states; 0 if it does not.
    size_wh
        (width, height) as displayed.
    small_wh
        Of the small pictures.
    unique_times
        Whether a frame can be found by its time.
    missing_s
        How much shorter the film is than its header promises; above 0 the file is cut off.
    span_s
        Time from the first of the chosen frames to the last.
    turned
        How frames are shown differently from how they are stored, such as ``"rotated by 180°"``; else empty.
    pixel_aspect
        Width of a pixel over its height, as the film states it.
    """

    frames: int
    fps: float
    size_wh: tuple[int, int]
    small_wh: tuple[int, int]
    unique_times: bool
    missing_s: float
    span_s: float = 0.0
    turned: str = ""
    pixel_aspect: float = 1.0

    @property
    def cut_off(self) -> str:
        """A sentence if the file is cut off, without its name; else empty."""
        if not self.missing_s > 0:
            return ""
        return f"the file is cut off: it ends {self.missing_s:.1f} s before its header says; what is there is used"

    @property
    def notes(self) -> list[str]:
        """What the user should know of how the film is stored, in sentences without its name."""
        notes = [self.cut_off] if self.cut_off else []
        if self.turned:
            notes.append(
                f"the film states that it is shown {self.turned}: its frames are taken so, and K must fit that"
            )
        if self.pixel_aspect != 1:
            notes.append(
                f"the film states pixels {self.pixel_aspect:.4g} times as wide as high: frames keep them so, and "
                "K must be for these"
            )
        return notes


@dataclass(frozen=True)
class FilmFrame:
    """A small picture of a film's frame for scoring it; the chosen frame is read again, at full size, for a case.

    Attributes
    ----------
    index
        Counted from 0 in display order.
    time_s
        As the container states, from its beginning.
    comb
        Difference of neighbouring rows over that of rows of one field, at full resolution.
    image
        ``(h, w, 3)`` uint8 RGB, the small picture.
    """

    index: int
    time_s: float
    comb: float
    image: np.ndarray


class Film:
    """A video that is being decoded: a context manager, and an iterator over its frames."""

    def __init__(
        self,
        path: Path,
        *,
        every: int = 1,
        from_s: float = 0.0,
        to_s: float | None = None,
        numbers: tuple[int, int] | None = None,
        width: int = SMALL_WIDTH,
    ) -> None:
        """Start decoding; leave the context to stop. Pictures wider than ``width`` px come in this width.

        Parameters
        ----------
        path
            The video.
        every
            Only every so many frames.
        from_s, to_s
            Only frames displayed from ... to before these times.
        numbers
            Instead of the times: number of the first frame, and the one after the last.
        width
            Of the pictures, px.
        """
        self.path = Path(path)
        self._parts = decoded_apart(self.path, width, every, from_s, to_s, numbers)
        try:
            first = next(self._parts, None)
        except DecodingError as error:
            raise undecodable(self.path, error) from None
        if first is None:
            if numbers is not None:
                raise InputError(
                    f"{self.path.name}: cannot decode frame {numbers[0]}; the file is damaged or cut off: copy it "
                    f"again, or use another frame"
                )
            raise InputError(f"{self.path.name}: expected a video, cannot decode any frame of it; copy it again")
        found = json.loads(first)
        sizes = {name: tuple(found[name]) for name in ("size_wh", "small_wh")}
        self.info = FilmInfo(**found | sizes | {"frames": math.ceil(found["frames"] / every)})
        self.broken = False
        """Whether decoding ended before the end."""
        self.other_sizes: dict[int, tuple[int, int]] = {}
        """Number -> (width, height) of frames that are left out so far because they have not the size of the first."""

    def __enter__(self) -> "Film":
        return self

    def __exit__(self, kind: type[BaseException] | None, value: BaseException | None, _: TracebackType | None) -> None:
        self.close()

    def close(self) -> None:
        """End the process that decodes."""
        self._parts.close()  # type: ignore[attr-defined]

    def problem(self, index: int) -> str:
        """Why a frame before the present one has not come, in a short sentence."""
        if index not in self.other_sizes:
            return "it cannot be decoded"
        (width, height), film_wh = self.other_sizes[index], self.info.size_wh
        return f"it has {width}x{height} px, the film's first frame {film_wh[0]}x{film_wh[1]}"

    def __iter__(self) -> Iterator[FilmFrame]:
        width, height = self.info.small_wh
        try:
            for part in self._parts:
                begin = part.index(b"\n") + 1
                index, time_s, comb, *size_wh = json.loads(part[:begin])
                if tuple(size_wh) != self.info.size_wh:
                    self.other_sizes[index] = tuple(size_wh)
                    continue
                pixels = np.frombuffer(part, np.uint8, 3 * width * height, begin)
                yield FilmFrame(index, time_s, comb, pixels.reshape(height, width, 3))
        except DecodingError:
            # what could be decoded is used
            self.broken = True


def read_video_frame(path: Path, index: int) -> np.ndarray:
    """Frame ``index``, counted from 0, as ``(H, W, 3)`` uint8 RGB, identical to that of sequential decoding."""
    return film_frame(path, index)[0].image


def film_frame(path: Path, index: int) -> tuple[FilmFrame, FilmInfo]:
    """Frame ``index`` in its own size, and what is known of its film."""
    with Film(path, numbers=(index, index + 1), width=WIDEST) as film:
        for frame in film:
            return frame, film.info
    raise undecodable(film.path, DecodingError("its decoder crashes"))


class Thumbnails:
    """Keeps every so many of the frames that it is given; twice as many apart whenever there are too many."""

    def __init__(self) -> None:
        self._apart, self._given = 1, 0
        self._indices: list[int] = []
        self._images: list[np.ndarray] = []

    def __len__(self) -> int:
        return len(self._images)

    def add(self, frame: FilmFrame) -> None:
        """Take the next frame of the film."""
        number, self._given = self._given, self._given + 1
        if number % self._apart:
            return
        self._indices.append(frame.index)
        self._images.append(_small(frame.image))
        if len(self._images) > MOST:
            self._apart *= 2
            self._indices, self._images = self._indices[::2], self._images[::2]

    def nearest(self, index: int) -> tuple[int, np.ndarray]:
        """Number and picture, ``(h, w, 3)`` uint8 RGB, of the frame that is nearest to frame ``index``."""
        after = bisect_left(self._indices, index)
        near = range(max(after - 1, 0), min(after + 1, len(self._indices)))
        at = min(near, key=lambda number: abs(self._indices[number] - index))
        return self._indices[at], self._images[at]


def _small(image: np.ndarray) -> np.ndarray:
    height, width = image.shape[:2]
    scale = min(1.0, (MOST_PIXELS / (width * height)) ** 0.5)
    if scale == 1.0:
        return image.copy()
    size_wh = max(1, round(width * scale)), max(1, round(height * scale))
    return cv2.resize(image, size_wh, interpolation=cv2.INTER_AREA)
