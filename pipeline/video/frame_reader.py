"""Single frames of a video, by number from 0 in display order: a frame is a film of one."""

from pathlib import Path

import numpy as np

from ..errors import InputError
from ..files.content import write_bytes_atomically
from ..files.outputs import writing
from .decoding_process import DecodingError, undecodable
from .film_reader import WIDEST, Film, FilmInfo


def video_info(path: Path) -> FilmInfo:
    """What is known of a film before its frames.

    Raises
    ------
    InputError
        As :class:`.Film`.
    """
    with Film(path) as film:
        return film.info


def read_video_frame(path: Path, index: int) -> np.ndarray:
    """Frame ``index``, counted from 0, as ``(H, W, 3)`` uint8 RGB, identical to that of sequential decoding.

    Raises
    ------
    InputError
        No file, not a video, no such frame, or a frame that cannot be decoded (damaged or cut-off file).
    """
    with Film(path, numbers=(index, index + 1), width=WIDEST) as film:
        for frame in film:
            return frame.image
    raise undecodable(film.path, DecodingError("its decoder crashes"))


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
