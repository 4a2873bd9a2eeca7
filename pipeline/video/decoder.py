"""Decodes a film, or a part of it, frame by frame, in the child process of the reader. Needs ``av`` and ``cv2``.

Frames are counted from 0 as a player shows them: in display order, without those that an edit list hides and those
before the first key frame. Counts and seeking of containers are unreliable, so neither is trusted.
The times of all packets are read, without decoding; a packet is a frame as far as the first decoded ones bear that out,
else all are decoded to learn their times. After a seek a frame's own time says which it is. Where packets have no times
of their own, as in AVI with B-frames, frames are decoded from the beginning and counted, up to a damaged one.
"""

import json
from bisect import bisect_left
from collections.abc import Generator, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import islice, pairwise
from pathlib import Path

import av
import cv2
from av.container import InputContainer
from av.video.frame import VideoFrame
from av.video.stream import VideoStream

from ..errors import InputError
from .container import frames_of, opened, packets_of
from .picture import Converter, comb_ratio

_LEADS_S = (2.0, 10.0, 60.0)
"""How long before a frame a seek aims, tried in turn; then decoding starts at the beginning."""

_FIRST = 10
"""Frames that are decoded to see whether each packet is one."""

_LONGEST_S = 172_800.0
"""No film lasts two days: a header that says so was never completed."""

_ALIVE = 100
"""After so many packets or frames of which none is sent, an empty part says that work goes on."""


def film(
    path: Path, width: int, every: int, from_s: float, to_s: float | None, numbers: Sequence[int] | None
) -> Iterator[bytes]:
    """First what the film is, then each frame: a line of JSON, and a small RGB picture if it has the size of the first.

    The line has number, time in s, comb ratio, and width and height in px.

    Parameters
    ----------
    path
        The video.
    width
        Of the small pictures; a smaller video stays as it is.
    every
        Only every so many frames.
    from_s, to_s
        Only frames displayed from ... to before these times; to the end if ``to_s`` is ``None``.
    numbers
        Instead of the times: number of the first frame, and the one after the last.
    """
    survey = yield from _surveyed(path)
    first, last = survey.between(from_s, to_s) if numbers is None else survey.checked(*numbers)
    converter, size_wh, small_wh = Converter(), (0, 0), (0, 0)
    for index, frame in survey.frames(first):
        if index >= last:
            return
        converter.look_at(frame)
        if index < first or (index - first) % every:
            if index % _ALIVE == 0:
                yield b""
            continue
        coded = converter.rgb(frame, exact=max(frame.width, frame.height) <= width)
        try:
            image = converter.upright(coded)
        except InputError as error:
            raise InputError(f"{path.name}: {error}") from None
        height_px, width_px = image.shape[:2]
        if size_wh == (0, 0):
            size_wh, small_wh = (width_px, height_px), _small_size(width_px, height_px, width)
            yield survey.info(first, last, size_wh, small_wh, converter.turned)
        described = index, survey.times_s[index], comb_ratio(coded[..., 1]), width_px, height_px
        head = json.dumps(described).encode() + b"\n"
        if (width_px, height_px) != size_wh:
            yield head
            continue
        small = image if small_wh == size_wh else cv2.resize(image, small_wh, interpolation=cv2.INTER_AREA)
        yield head + small.tobytes()


@dataclass(frozen=True)
class _Survey:
    """What is known of a film before its frames are decoded.

    Attributes
    ----------
    path
        The film.
    numbers
        Time of a frame in ticks of the stream -> its number; empty where frames must be counted.
    times_s
        Of the frames in display order, from the beginning of the film as players count it.
    fps
        As the header states; 0 if it does not.
    missing_s
        How much shorter the film is than its header promises; 0 where that may be rounding, or where it lies.
    pixel_aspect
        Width of a stored pixel over its height, as the film states it.
    """

    path: Path
    numbers: dict[int, int]
    times_s: list[float]
    fps: float
    missing_s: float
    pixel_aspect: float

    def info(self, first: int, last: int, size_wh: tuple[int, int], small_wh: tuple[int, int], turned: str) -> bytes:
        """For the reader."""
        return json.dumps(
            {
                "frames": last - first,
                "fps": self.fps,
                "size_wh": size_wh,
                "small_wh": small_wh,
                "unique_times": bool(self.numbers),
                "missing_s": self.missing_s,
                "turned": turned,
                "pixel_aspect": 1 / self.pixel_aspect if "90" in turned else self.pixel_aspect,
                "span_s": self.times_s[last - 1] - self.times_s[first],
            }
        ).encode()

    def between(self, from_s: float, to_s: float | None) -> tuple[int, int]:
        """Number of the first frame between two times, and the one after the last."""
        first = bisect_left(self.times_s, from_s)
        last = len(self.times_s) if to_s is None else bisect_left(self.times_s, to_s)
        if first >= last:
            raise InputError(
                f"{self.path.name}: expected frames from {from_s:g} s to "
                f"{'the end' if to_s is None else f'{to_s:g} s'}, found none; the film is {self.times_s[-1]:.2f} s long"
            )
        return first, last

    def checked(self, first: int, last: int) -> tuple[int, int]:
        """Two numbers as :meth:`between` gives them, checked."""
        frames = len(self.times_s)
        if not 0 <= first < last <= frames:
            wrong = first if not 0 <= first < frames else last - 1
            raise InputError(
                f"{self.path.name}: expected a frame from 0 to {frames - 1}, found {wrong}; the file has {frames} "
                f"frames"
            )
        return first, last

    def frames(self, first: int) -> Iterator[tuple[int, VideoFrame]]:
        """Numbered frames, from number ``first`` or one before it on; damaged ones are left out."""
        for lead_s in _LEADS_S:
            if not self.numbers or self.times_s[first] - self.times_s[0] <= lead_s:
                break
            with opened(self.path) as (container, stream):
                numbered = self._sought(container, stream, first, lead_s)
                begun = next(numbered, None)
                if begun is not None and begun[0] <= first:
                    yield begun
                    yield from numbered
                    return
        with opened(self.path) as (container, stream):
            yield from self._numbered(frames_of(container, stream))

    def _sought(
        self, container: InputContainer, stream: VideoStream, first: int, lead_s: float
    ) -> Iterator[tuple[int, VideoFrame]]:
        with suppress(av.FFmpegError):  # then from the beginning
            container.seek(list(self.numbers)[first] - round(lead_s / stream.time_base), stream=stream)
        yield from self._numbered(frames_of(container, stream))

    def _numbered(self, frames: Iterator[tuple[int | None, VideoFrame | None]]) -> Iterator[tuple[int, VideoFrame]]:
        for counted, (time, frame) in enumerate(frames):
            if frame is None and not self.numbers:
                return  # nobody knows how many are lost
            number = counted if time is None or not self.numbers else self.numbers.get(time)
            if frame is not None and number is not None:
                yield number, frame


def _surveyed(path: Path) -> Generator[bytes, None, _Survey]:
    with opened(path) as (container, stream):
        shown, decoding_times, read = [], [], 0
        for read, packet in enumerate(packets_of(container, stream)):
            if packet.size and not packet.is_discard:
                shown.append(packet.pts)
                decoding_times.append(packet.dts)
            if read % _ALIVE == 0:
                yield b""
        if not shown:
            raise InputError(f"{path.name}: expected a video, found no frames in it; copy it again")
        pixel_aspect = float(stream.sample_aspect_ratio or 1) or 1.0
        fps, tick_s = float(stream.guessed_rate or 0), float(stream.time_base)
        promised_s = float((stream.duration or 0) * stream.time_base)
        # that of a whole file may count from 0, wherever its first frame is
        promised_end_s = 0.0 if promised_s else (container.duration or 0) / av.time_base
        # the last one is empty
        lost_s = (stream.frames - read) / fps if stream.frames and fps else None
        start_s = None if container.start_time is None else container.start_time / av.time_base
    times = yield from _times_of_frames(path, _in_order(shown))
    ticks = times or _in_order(decoding_times)
    if ticks:
        begin_s = ticks[0] * tick_s if start_s is None or not times else min(start_s, ticks[0] * tick_s)
        times_s = [tick * tick_s - begin_s for tick in ticks]
    else:
        times_s = [number / (fps or 25.0) for number in range(len(shown))]
    found_s = times_s[-1] - times_s[0]
    end_s = max((time for time in (*shown, *decoding_times) if time is not None), default=0) * tick_s
    missing_s = max(promised_s - found_s, promised_end_s - max(end_s, found_s)) if lost_s is None else lost_s
    missing_s = missing_s if 0.1 * found_s + 0.25 < missing_s < _LONGEST_S else 0.0
    return _Survey(path, {time: number for number, time in enumerate(times)}, times_s, fps, missing_s, pixel_aspect)


def _times_of_frames(path: Path, of_packets: list[int]) -> Generator[bytes, None, list[int]]:
    """Times of the frames in display order, given those of the packets; none where frames must be counted."""
    if not of_packets:
        return []
    with opened(path) as (container, stream):
        first = [*islice(frames_of(container, stream), _FIRST)]
    if not first:
        return of_packets
    begin = bisect_left(of_packets, min(time or 0 for time, _ in first))
    as_packets = of_packets[begin : begin + len(first)] == [time for time, _ in first]
    if as_packets or any(frame is None for _, frame in first):
        return of_packets[begin:]
    # some packets are no frames of their own: hidden ones, or single fields
    times = []
    with opened(path) as (container, stream):
        for number, (time, frame) in enumerate(frames_of(container, stream)):
            times += [] if frame is None else [time]
            if number % _ALIVE == 0:
                yield b""
    return _in_order(times)


def _in_order(times: Sequence[int | None]) -> list[int]:
    """Times from the first to the last; none at all unless all are there and unique."""
    known = sorted(time for time in times if time is not None)
    return known if len(known) == len(times) and all(one < other for one, other in pairwise(known)) else []


def _small_size(width_px: int, height_px: int, width: int) -> tuple[int, int]:
    small_px = min(width, width_px)
    return small_px, max(1, round(height_px * small_px / width_px))
