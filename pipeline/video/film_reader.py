"""A whole video, frame by frame as small pictures: decoded apart, one frame at a time, in display order."""

import json
import math
import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType

import numpy as np

from ..errors import InputError
from ..files.child_process import ChildError, streamed_apart
from ..images.image_check import LARGEST_FRAME
from .container import check_container
from .film_decoder import FRAME_HEAD, film_in_parts, frames_in_parts

SMALL_WIDTH = 480
"""Width in px of the small pictures."""

PART_SECONDS = 120.0
"""Longest wait for a frame: the first one waits until the whole file has been looked through."""


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
    """

    frames: int
    fps: float
    size_wh: tuple[int, int]
    small_wh: tuple[int, int]
    unique_times: bool
    missing_s: float
    span_s: float = 0.0


@dataclass(frozen=True)
class FilmFrame:
    """A frame of a film.

    Attributes
    ----------
    index
        Counted from 0 in display order.
    time_s
        As the container states.
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
        width: int = SMALL_WIDTH,
    ) -> None:
        """Start decoding; leave the context to stop. Pictures wider than ``width`` px come in this width.

        Raises
        ------
        InputError
            No file, not a video, no frames between these times, or frames too large.
        """
        self.path = Path(path)
        check_container(self.path)
        self._parts = streamed_apart(
            film_in_parts,
            (str(self.path), width, every, from_s, to_s),
            seconds=PART_SECONDS,
            most_bytes=FRAME_HEAD.size + 3 * LARGEST_FRAME,
        )
        try:
            first = next(self._parts, None)
        except ChildError as error:
            raise _undecodable(self.path, error) from None
        if first is None:
            raise InputError(f"{self.path.name}: expected a video, cannot decode any frame of it; copy it again")
        found = json.loads(first)
        self.info = FilmInfo(
            math.ceil(found["frames"] / every),
            found["fps"],
            tuple(found["size_wh"]),
            tuple(found["small_wh"]),
            found["unique_times"],
            found["missing_s"],
            found["span_s"],
        )
        self.broken = False
        """Whether decoding ended before the end."""

    def __enter__(self) -> "Film":
        return self

    def __exit__(self, kind: type[BaseException] | None, value: BaseException | None, _: TracebackType | None) -> None:
        self.close()

    def close(self) -> None:
        """End the process that decodes."""
        self._parts.close()  # type: ignore[attr-defined]

    def __iter__(self) -> Iterator[FilmFrame]:
        width, height = self.info.small_wh
        try:
            for part in self._parts:
                index, time_ms, comb = FRAME_HEAD.unpack_from(part)
                pixels = np.frombuffer(part, np.uint8, 3 * width * height, FRAME_HEAD.size)
                yield FilmFrame(index, time_ms / 1000, comb, pixels.reshape(height, width, 3))
        except ChildError:
            # what could be decoded is used
            self.broken = True


def read_film_frames(path: Path, numbers: Sequence[int]) -> Iterator[tuple[int, np.ndarray]]:
    """The frames with these numbers, in increasing order, by decoding the whole film; see :func:`read_video_frame`.

    Yields
    ------
    Number and ``(H, W, 3)`` uint8 RGB; nothing for a frame that cannot be decoded.
    """
    parts = streamed_apart(
        frames_in_parts, (str(path), *sorted(numbers)), seconds=PART_SECONDS, most_bytes=16 + 3 * LARGEST_FRAME
    )
    head = struct.Struct("<QII")
    try:
        for part in parts:
            index, width, height = head.unpack_from(part)
            pixels = np.frombuffer(part, np.uint8, 3 * width * height, head.size)
            yield index, pixels.reshape(height, width, 3)
    except ChildError as error:
        raise _undecodable(path, error) from None
    finally:
        parts.close()  # type: ignore[attr-defined]


def _undecodable(path: Path, error: ChildError) -> InputError:
    return InputError(
        f"{path.name}: expected a video, cannot decode it ({error}); copy it again, or convert it to MP4 (H.264)"
    )
