"""One frame of a video, exactly the one that was asked for. Needs ``cv2``.

Frames are counted from 0 in the order in which they are shown. A container's own count and its seeking are trusted in
neither: the packets' times are read without decoding them, which takes milliseconds, and say how many frames there are
and when the wanted one is shown; after a seek, decoding goes on until exactly that time. Where times cannot tell frames
apart, all frames are decoded and counted.

OpenCV converts all video to RGB with the matrix of BT.601, so that colours of a BT.709 video (most of high definition)
are a few codes off.
"""

from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np

from ..errors import InputError
from ..files.content import reading, write_bytes_atomically
from ..images.png import encode_png

_LEADS_S = (0.0, 2.0, 10.0, 60.0, float("inf"))
"""How much earlier than the frame a seek aims, one after the other; the last is no seek, but the beginning."""


@dataclass(frozen=True)
class VideoInfo:
    """Number of frames in the file, frames a second as it claims, (width, height) as shown."""

    frames: int
    fps: float
    size_wh: tuple[int, int]


def video_info(path: Path) -> VideoInfo:
    """What a video holds, counted, not as its header claims.

    Raises
    ------
    InputError
        No file, no video, or one of which not even the first frame can be decoded.
    """
    path = Path(path)
    frames = len(_times_ms(path))
    capture = _open(path)
    height, width = _decoded(capture, path, 0).shape[:2]
    return VideoInfo(frames, float(capture.get(cv2.CAP_PROP_FPS)), (width, height))


def read_video_frame(path: Path, index: int) -> np.ndarray:
    """Frame ``index``, counted from 0, as ``(H, W, 3)`` uint8 RGB; the same as decoding all frames before it gives.

    Raises
    ------
    InputError
        No file, no video, no such frame, or one that cannot be decoded because the file is damaged or cut off.
    """
    path = Path(path)
    times = _times_ms(path)
    if not 0 <= index < len(times):
        raise InputError(
            f"{path.name}: expected a frame from 0 to {len(times) - 1}, found {index}; the file has {len(times)} frames"
        )
    # packets come in the order of decoding
    times.sort()
    if all(one < other for one, other in pairwise(times)):
        for lead_s in _LEADS_S:
            capture = _open(path)
            if _advanced_to(capture, times[index], lead_s):
                return _decoded(capture, path, index, grabbed=True)
    return _counted(path, index, len(times))


def write_video_frame(path: Path, index: int, *, image: Path | None = None) -> Path:
    """Write frame ``index`` as PNG, beside the video as ``NAME_frame_000123.png`` unless ``image`` names another file.

    Returns
    -------
    The file of the image.

    Raises
    ------
    InputError
        As :func:`read_video_frame`; or the file is there already with another content, which may be somebody's work.
    OSError
        The file cannot be written.
    """
    path = Path(path)
    data = encode_png(read_video_frame(path, index))
    image = image or path.with_name(f"{path.stem}_frame_{index:06d}.png")
    if image.exists() and image.read_bytes() != data:
        raise InputError(
            f"{image}: expected no such file, or this very frame, found another image; "
            "use that one, rename it, or remove it"
        )
    write_bytes_atomically(image, data)
    return image


def _open(path: Path) -> cv2.VideoCapture:
    capture = cv2.VideoCapture(str(path), cv2.CAP_FFMPEG)
    if not capture.isOpened():
        raise InputError(
            f"{path.name}: expected a video, cannot open it; it is cut off or of a kind that is not known: "
            "copy it again, or convert it to MP4 (H.264)"
        )
    return capture


def _times_ms(path: Path) -> list[float]:
    """When each packet of the video is shown, in the order of the file: one packet is one frame."""
    # too long to be read whole, and OpenCV does not say why it cannot open a file
    with reading(path, "a video"), open(path, "rb") as file:
        file.read(1)
    capture = _open(path)
    # packets as they are
    capture.set(cv2.CAP_PROP_FORMAT, -1)
    times = []
    while capture.grab():
        times.append(float(capture.get(cv2.CAP_PROP_POS_MSEC)))
    if not times:
        raise InputError(f"{path.name}: expected a video, found no frames in it; copy it again")
    return times


def _advanced_to(capture: cv2.VideoCapture, time_ms: float, lead_s: float) -> bool:
    """Seek and decode until the frame that is shown at ``time_ms``; false if the seek ended behind it."""
    start_ms = time_ms - lead_s * 1000
    if start_ms > 0:
        capture.set(cv2.CAP_PROP_POS_MSEC, start_ms)
    while capture.grab():
        now_ms = capture.get(cv2.CAP_PROP_POS_MSEC)
        if now_ms >= time_ms:
            return bool(now_ms == time_ms)
    return False


def _counted(path: Path, index: int, frames: int) -> np.ndarray:
    """Decode all frames, and refuse if some are lost, since nobody knows whether before or behind the wanted one."""
    capture, image, count = _open(path), None, 0
    while capture.grab():
        if count == index:
            image = _decoded(capture, path, index, grabbed=True)
        count += 1
    if image is None or count != frames:
        raise _undecodable(path, index)
    return image


def _decoded(capture: cv2.VideoCapture, path: Path, index: int, *, grabbed: bool = False) -> np.ndarray:
    ok, image = capture.retrieve() if grabbed else capture.read()
    if not ok or image is None or image.dtype != np.uint8 or image.ndim != 3:
        raise _undecodable(path, index)
    return np.ascontiguousarray(image[..., ::-1])


def _undecodable(path: Path, index: int) -> InputError:
    return InputError(
        f"{path.name}: cannot decode frame {index}; the file is damaged or cut off: copy it again, or take another one"
    )
