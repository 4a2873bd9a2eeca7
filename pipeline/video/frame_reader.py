"""Single frames of a video, by number from 0 in display order; see :mod:`oneframe.video.decoder`.

The decoder runs in a process of its own: a damaged video may crash it or fill its memory.
"""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..errors import InputError
from ..files.content import write_bytes_atomically
from ..files.outputs import writing
from .decoder import PICTURE_HEAD
from .decoding_process import DecodingError, decoded_apart, undecodable


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
    found = json.loads(_decoded("info", Path(path)))
    width, height = found["size_wh"]
    return VideoInfo(found["frames"], found["fps"], (width, height))


def read_video_frame(path: Path, index: int) -> np.ndarray:
    """Frame ``index``, counted from 0, as ``(H, W, 3)`` uint8 RGB, identical to that of sequential decoding.

    Raises
    ------
    InputError
        No file, not a video, no such frame, or a frame that cannot be decoded (damaged or cut-off file).
    """
    return picture(_decoded("frame", Path(path), index))[1]


def picture(part: bytes) -> tuple[int, np.ndarray]:
    """Number and ``(H, W, 3)`` uint8 RGB of a frame, from the bytes of the decoder."""
    index, width, height = PICTURE_HEAD.unpack_from(part)
    pixels = np.frombuffer(part, np.uint8, 3 * width * height, PICTURE_HEAD.size)
    return index, pixels.reshape(height, width, 3)


def write_new(path: Path, data: bytes) -> None:
    """Write an image, whole or not at all, unless it is there already.

    Raises
    ------
    InputError
        The file exists with other content, which somebody may have made by hand.
    RunError
        The file cannot be written.
    """
    if path.exists():
        if path.read_bytes() == data:
            return
        raise InputError(
            f"{path}: expected no such file, or one with this frame, found another image; rename it, or remove it"
        )
    with writing(path):
        write_bytes_atomically(path, data)


def _decoded(task: str, path: Path, *arguments: int) -> bytes:
    """The answer of the decoder about a file."""
    parts = decoded_apart(task, path, *arguments)
    try:
        return next(parts)
    except DecodingError as error:
        raise undecodable(path, error) from None
    finally:
        parts.close()  # type: ignore[attr-defined]
