"""Sequential decoding of a whole video, in the child process of the reader. Needs ``cv2``.

Frames leave this process as small pictures, one at a time, so that memory does not grow with the length of the film.
Numbers and times of frames are those of :mod:`oneframe.video.decoder`.
"""

import json
import math
import struct
from bisect import bisect_left
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np

from ..errors import InputError
from ..images.image_check import LARGEST_FRAME
from .decoder import open_video, packet_times_ms

FRAME_HEAD = struct.Struct("<Qdd")
"""Number of the frame, its time in ms, its comb ratio; then the pixels of the small picture."""

_LEAD_MS = 2000.0
"""How long before the first frame a seek aims."""

_LONGEST_S = 172_800.0
"""No film lasts two days: a header that says so was never completed."""

_COMB_COLUMNS = 4
"""Every so many columns are looked at for combs."""


def film(path: Path, width: int, every: int, from_s: float, to_s: float | None) -> Iterator[bytes]:
    """First what the film is (JSON), then each frame: :data:`FRAME_HEAD` and a small RGB picture.

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

    Raises
    ------
    InputError
        Not a video, frames too large to use, or none between these times.
    """
    times_ms = packet_times_ms(path)
    times_ms.sort()
    capture = open_video(path)
    _check_size(capture, path)
    unique = all(one < other for one, other in pairwise(times_ms))
    first = bisect_left(times_ms, from_s * 1000) if unique else 0
    last = bisect_left(times_ms, to_s * 1000) if unique and to_s is not None else len(times_ms)
    if first >= last:
        raise InputError(
            f"{path.name}: expected frames from {from_s:g} s to {'the end' if to_s is None else f'{to_s:g} s'}, found "
            f"none; the film is {times_ms[-1] / 1000:.2f} s long"
        )
    fps = float(capture.get(cv2.CAP_PROP_FPS))
    missing_s = _missing_s(capture, times_ms)
    capture, position = _started(path, capture, times_ms, first) if unique else (capture, 0)
    sent_wh: list[int] = []
    before_ms = -math.inf
    for index in range(position, last):
        if not capture.grab():
            break
        time_ms = float(capture.get(cv2.CAP_PROP_POS_MSEC))
        if not unique and time_ms <= before_ms:
            # MPEG's last frame may come without a time
            time_ms = before_ms + 1000 / max(fps, 1.0)
        before_ms = time_ms
        if unique:
            # a damaged frame may be missing
            index = bisect_left(times_ms, time_ms)
            if index >= last:
                break
        elif time_ms < from_s * 1000 or (to_s is not None and time_ms >= to_s * 1000):
            continue
        if index < first or (index - first) % every:
            continue
        ok, image = capture.retrieve()
        if not ok or image is None or image.dtype != np.uint8 or image.ndim != 3:
            continue
        height_px, width_px = image.shape[:2]
        small_wh = _small_size(width_px, height_px, width)
        if not sent_wh:
            info = {"frames": last - first, "fps": fps, "size_wh": [width_px, height_px], "small_wh": small_wh}
            span_s = (times_ms[last - 1] - times_ms[first]) / 1000
            yield json.dumps({**info, "unique_times": unique, "missing_s": missing_s, "span_s": span_s}).encode()
            sent_wh = small_wh
        if small_wh != sent_wh:
            raise InputError(
                f"{path.name}: expected frames of one size, frame {index} has {width_px}x{height_px} px; convert it to "
                "MP4 (H.264)"
            )
        head = FRAME_HEAD.pack(index, time_ms, comb_ratio(image[..., 1]))
        small = image if tuple(small_wh) == (width_px, height_px) else _shrunk(image, small_wh)
        yield head + cv2.cvtColor(small, cv2.COLOR_BGR2RGB).tobytes()


def comb_ratio(plane: np.ndarray) -> float:
    """How much more neighbouring rows differ than rows of one field do: above 1 if the fields show other moments."""
    rows = plane[: len(plane) // 2 * 2, ::_COMB_COLUMNS]
    if len(rows) < 4:
        return 0.0
    upper, lower = np.ascontiguousarray(rows[0::2]), np.ascontiguousarray(rows[1::2])
    across = cv2.norm(upper, lower, cv2.NORM_L1) / upper.size
    within = cv2.norm(upper[1:], upper[:-1], cv2.NORM_L1) / upper[1:].size
    return float(across / (within + 0.5))


def _started(path: Path, capture: cv2.VideoCapture, times_ms: list[float], first: int) -> tuple[cv2.VideoCapture, int]:
    """Seek to before frame ``first``; returns the capture and the number of its next frame.

    A seek lands on any frame; which one it is, its own time tells.
    """
    if times_ms[first] - times_ms[0] < 2 * _LEAD_MS:
        return capture, 0
    capture.set(cv2.CAP_PROP_POS_MSEC, times_ms[first] - _LEAD_MS)
    if capture.grab():
        landed_ms = float(capture.get(cv2.CAP_PROP_POS_MSEC))
        if landed_ms < times_ms[first]:
            return capture, bisect_left(times_ms, landed_ms) + 1
    return open_video(path), 0


def _missing_s(capture: cv2.VideoCapture, times_ms: list[float]) -> float:
    """How much shorter the film is than its header promises; 0 where that may be rounding, or where it lies."""
    fps, frames = float(capture.get(cv2.CAP_PROP_FPS)), float(capture.get(cv2.CAP_PROP_FRAME_COUNT))
    if not (fps > 0 and frames > 0):
        return 0.0
    found_s = (times_ms[-1] - times_ms[0]) / 1000
    promised_s = frames / fps
    return promised_s - found_s if 1.1 * found_s + 0.25 < promised_s < _LONGEST_S else 0.0


def _check_size(capture: cv2.VideoCapture, path: Path) -> None:
    width, height = capture.get(cv2.CAP_PROP_FRAME_WIDTH), capture.get(cv2.CAP_PROP_FRAME_HEIGHT)
    if width * height > LARGEST_FRAME:
        raise InputError(
            f"{path.name}: expected frames of at most {LARGEST_FRAME / 1e6:.1f} million pixels, found "
            f"{width:.0f}x{height:.0f}; scale the video down"
        )


def _small_size(width_px: int, height_px: int, width: int) -> list[int]:
    if width_px <= width:
        return [width_px, height_px]
    return [width, max(1, round(height_px * width / width_px))]


def _shrunk(image: np.ndarray, size_wh: list[int]) -> np.ndarray:
    return cv2.resize(image, tuple(size_wh), interpolation=cv2.INTER_AREA)
