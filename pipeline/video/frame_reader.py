"""Single frames of a video, by number from 0 in display order; see :mod:`oneframe.video.decoder`.

The decoder runs in a process of its own: a damaged video may crash it or fill its memory.
"""

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..errors import InputError
from ..files.child_process import ChildError, called_apart
from ..files.content import reading, write_bytes_atomically
from ..files.numbers import npy_array
from ..files.outputs import check_outputs, writing
from ..images.png import encode_png
from .decoder import frame_as_npy, info_as_json

CPU_SECONDS, CPU_SECONDS_PER_MB = 4.0, 3.0
"""A video without usable timestamps is decoded from its beginning."""

WAITING = 20
"""Longest time of waiting in relation to that of computing: disks and networks may be slow."""


@dataclass(frozen=True)
class VideoInfo:
    """Number of frames as counted, frames per second as the header states, (width, height) as displayed."""

    frames: int
    fps: float
    size_wh: tuple[int, int]


def video_info(path: Path) -> VideoInfo:
    """Number of frames, frame rate and size of a video.

    Raises
    ------
    InputError
        No file, not a video, or its first frame cannot be decoded.
    """
    found = json.loads(_decoded(info_as_json, Path(path)))
    width, height = found["size_wh"]
    return VideoInfo(found["frames"], found["fps"], (width, height))


def read_video_frame(path: Path, index: int) -> np.ndarray:
    """Frame ``index``, counted from 0, as ``(H, W, 3)`` uint8 RGB, identical to that of sequential decoding.

    Raises
    ------
    InputError
        No file, not a video, no such frame, or a frame that cannot be decoded (damaged or cut-off file).
    """
    return npy_array(_decoded(frame_as_npy, Path(path), index), Path(path).name)


def write_video_frame(path: Path, index: int, *, image: Path | None = None) -> Path:
    """Write frame ``index`` as PNG: next to the video as ``NAME_frame_000123.png``, or to ``image``.

    Returns
    -------
    The path of the image.

    Raises
    ------
    InputError
        As :func:`read_video_frame`; or the file exists with other content, which is never overwritten.
    RunError
        The file cannot be written.
    """
    path = Path(path)
    image = image or path.with_name(f"{path.stem}_frame_{index:06d}.png")
    # decoding takes long; its result alone says whether an existing image may stay
    check_outputs([image], {"video": path})
    data = encode_png(read_video_frame(path, index))
    if image.exists() and image.read_bytes() != data:
        raise InputError(
            f"{image}: expected no such file, or one with this frame, found another image; "
            "use that one, rename it, or remove it"
        )
    with writing(image):
        write_bytes_atomically(image, data)
    return image


def _decoded(function: Callable[..., bytes], path: Path, *arguments: int) -> bytes:
    """The answer of a function of the decoder about a file."""
    # OpenCV does not say why it cannot open a file
    with reading(path, "a video"), open(path, "rb"):
        megabytes = path.stat().st_size / 2**20
    if not megabytes:
        raise InputError(f"{path.name}: expected a video, cannot open it, it is empty; copy it again")
    cpu_seconds = CPU_SECONDS + CPU_SECONDS_PER_MB * megabytes
    try:
        return called_apart(
            function, b"", (str(path), *arguments), seconds=WAITING * cpu_seconds, cpu_seconds=cpu_seconds
        )
    except ChildError as error:
        raise InputError(
            f"{path.name}: expected a video, cannot decode it ({error}); copy it again, or convert it to MP4 (H.264)"
        ) from None
