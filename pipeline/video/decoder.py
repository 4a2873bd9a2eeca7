"""Frame-accurate decoding of single video frames, in the child process of the reader. Needs ``cv2``.

Frames are counted from 0 in display order. The frame count and the seeking of containers are unreliable, so neither is
trusted. Instead the timestamps of all packets are read, without decoding, which takes milliseconds. They give the
number of frames and the timestamp of the requested one. After a seek, frames are decoded up to exactly that timestamp.
Where timestamps are not unique, all frames are decoded and counted.

OpenCV converts all video to RGB with the matrix of BT.601, so colours of BT.709 video (most high definition) are off by
a few code values.

FFmpeg recognises a file by its content whatever its name is. Among what it knows are single images, and playlists,
which name other files. OpenCV passes no list of permitted formats on to it.
"""

import json
import struct
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np

from ..errors import InputError
from ..files.content import read_beginning
from ..images.image_check import SIGNATURES

PICTURE_HEAD = struct.Struct("<QII")
"""Number of a frame, width, height; then its pixels."""

_LEADS_S = (0.0, 2.0, 10.0, 60.0, float("inf"))
"""How long before the frame a seek aims, tried in turn; the last starts at the beginning without a seek."""

_LOOKED_AT = 1024

_IMAGE_BRANDS = (b"avif", b"avis", b"heic", b"heix", b"heim", b"heis", b"mif1", b"msf1")
_OTHER_IMAGES = (b"GIF8", b"\x00\x00\x00\x0cjP  ", b"\xff\x4f\xff\x51", b"P1", b"P2", b"P3", b"P4", b"P5", b"P6", b"P7")
_PLAYLISTS = (b"#EXTM3U", b"ffconcat", b"<?xml", b"<MPD", b"v=0")
"""They name other files."""


def info(path: Path) -> Iterator[bytes]:
    """Number of frames as counted, frames per second as the header states, (width, height) as displayed, as JSON.

    Raises
    ------
    InputError
        Not a video, or its first frame cannot be decoded.
    """
    frames = len(packet_times_ms(path))
    capture = open_video(path)
    height, width = decoded_frame(capture, path, 0).shape[:2]
    found = {"frames": frames, "fps": float(capture.get(cv2.CAP_PROP_FPS)), "size_wh": [width, height]}
    yield json.dumps(found).encode()


def frame(path: Path, index: int) -> Iterator[bytes]:
    """Frame ``index``: :data:`PICTURE_HEAD`, then ``(H, W, 3)`` uint8 RGB.

    Raises
    ------
    InputError
        Not a video, no such frame, or one that cannot be decoded.
    """
    yield picture_bytes(index, _frame(path, index))


def picture_bytes(index: int, image: np.ndarray) -> bytes:
    """A full frame and its number, as bytes."""
    return PICTURE_HEAD.pack(index, image.shape[1], image.shape[0]) + image.tobytes()


def _frame(path: Path, index: int) -> np.ndarray:
    timestamps_ms = packet_times_ms(path)
    count = len(timestamps_ms)
    if not 0 <= index < count:
        raise InputError(
            f"{path.name}: expected a frame from 0 to {count - 1}, found {index}; the file has {count} frames"
        )
    # packets come in decoding order
    timestamps_ms.sort()
    if all(one < other for one, other in pairwise(timestamps_ms)):
        for lead_s in _LEADS_S:
            capture = open_video(path)
            if _advanced_to(capture, timestamps_ms[index], lead_s):
                return decoded_frame(capture, path, index, grabbed=True)
    return _read_by_counting(path, index, count)


def open_video(path: Path) -> cv2.VideoCapture:
    """Open a video file, of the known containers only.

    Raises
    ------
    InputError
        It cannot be opened.
    """
    check_container(path)
    # every thread holds frames of its own
    capture = cv2.VideoCapture(str(path), cv2.CAP_FFMPEG, [cv2.CAP_PROP_N_THREADS, 1])
    if not capture.isOpened():
        raise unopened(path)
    # OpenCV 4.11 does not turn frames as the header says unless told to
    capture.set(cv2.CAP_PROP_ORIENTATION_AUTO, 1)
    return capture


def packet_times_ms(path: Path) -> list[float]:
    """Display timestamps of the video's packets in file order; one packet is one frame.

    Raises
    ------
    InputError
        Not a video, or one without frames.
    """
    capture = open_video(path)
    # raw packets, not decoded
    capture.set(cv2.CAP_PROP_FORMAT, -1)
    timestamps_ms = []
    while capture.grab():
        timestamps_ms.append(float(capture.get(cv2.CAP_PROP_POS_MSEC)))
    if not timestamps_ms:
        raise InputError(f"{path.name}: expected a video, found no frames in it; copy it again")
    return timestamps_ms


def _advanced_to(capture: cv2.VideoCapture, time_ms: float, lead_s: float) -> bool:
    """Seek, and decode up to the frame displayed at ``time_ms``; false if the seek ended after it."""
    start_ms = time_ms - lead_s * 1000
    if start_ms > 0:
        capture.set(cv2.CAP_PROP_POS_MSEC, start_ms)
    while capture.grab():
        now_ms = capture.get(cv2.CAP_PROP_POS_MSEC)
        if now_ms >= time_ms:
            return bool(now_ms == time_ms)
    return False


def _read_by_counting(path: Path, index: int, frames: int) -> np.ndarray:
    """Decode and count all frames; refuse if any is lost, since it may precede the requested one."""
    capture, image, count = open_video(path), None, 0
    while capture.grab():
        if count == index:
            image = decoded_frame(capture, path, index, grabbed=True)
        count += 1
    if image is None or count != frames:
        raise _undecodable_frame(path, index)
    return image


def decoded_frame(capture: cv2.VideoCapture, path: Path, index: int, *, grabbed: bool = False) -> np.ndarray:
    """The next frame, or the one just grabbed, ``(H, W, 3)`` uint8 RGB.

    Raises
    ------
    InputError
        It cannot be decoded.
    """
    ok, image = capture.retrieve() if grabbed else capture.read()
    if not ok or image is None or image.dtype != np.uint8 or image.ndim != 3:
        raise _undecodable_frame(path, index)
    return np.ascontiguousarray(image[..., ::-1])


def _undecodable_frame(path: Path, index: int) -> InputError:
    return InputError(
        f"{path.name}: cannot decode frame {index}; the file is damaged or cut off: copy it again, or use another frame"
    )


def check_container(path: Path) -> None:
    """Refuse what is no container of video, before anything decodes it.

    Raises
    ------
    InputError
        No such file, an empty one, an image, or a file of another kind.
    """
    start = read_beginning(path, "a video", _LOOKED_AT)
    if not start:
        raise InputError(f"{path.name}: expected a video, cannot open it, it is empty; copy it again")
    if _is_image(start):
        raise InputError(f"{path.name}: expected a video, found an image; name it as the frame of the case")
    if start.lstrip().startswith(_PLAYLISTS):
        raise unopened(path)


def unopened(path: Path) -> InputError:
    """The error for a file that is no video, or a damaged one."""
    return InputError(
        f"{path.name}: expected a video, cannot open it; it is cut off, without pictures, or in an unknown format: "
        "copy it again, or convert it to MP4 (H.264)"
    )


def _is_image(start: bytes) -> bool:
    if start.startswith((*SIGNATURES, *_OTHER_IMAGES)):
        return True
    return start[8:12] in _IMAGE_BRANDS if start[4:8] == b"ftyp" else start[:4] == b"RIFF" and start[8:12] == b"WEBP"
