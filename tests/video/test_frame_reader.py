"""Video frames: exactly the requested frame, however the container counts and seeks."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from oneframe.errors import InputError
from oneframe.video.film_reader import read_video_frame
from oneframe.video.frame_folder import write_new

pytestmark = pytest.mark.usefixtures("decoded_here")

FRAMES = 90
SIZE = (128, 96)
FORMATS = {"lossless.mkv": "FFV1", "a.avi": "MJPG", "a.mp4": "mp4v", "a.webm": "VP80", "a.mkv": "VP90", "a.mpg": "mpg2"}


def numbered(index: int) -> np.ndarray:
    """RGB with the index as eight black or white bars."""
    image = np.full((SIZE[1], SIZE[0], 3), 90, np.uint8)
    for bit in range(8):
        image[8:40, 4 + bit * 15 : 16 + bit * 15] = 230 if index >> bit & 1 else 20
    image[50:90, index : index + 20] = (220, 160, 30)
    return image


def number_of(image: np.ndarray) -> int:
    return sum(int(image[16:32, 7 + bit * 15 : 13 + bit * 15].mean() > 125) << bit for bit in range(8))


def write_video(path: Path, fourcc: str, fps: float = 29.97) -> Path:
    writer = cv2.VideoWriter(str(path), cv2.CAP_FFMPEG, cv2.VideoWriter_fourcc(*fourcc), fps, SIZE)
    if not writer.isOpened():
        pytest.skip(f"this OpenCV writes no {fourcc}")
    for index in range(FRAMES):
        writer.write(numbered(index)[..., ::-1])
    writer.release()
    return path


def with_uneven_times(source: Path, path: Path) -> Path:
    """The same packets with increasing gaps between their timestamps."""
    packets = cv2.VideoCapture(str(source), cv2.CAP_FFMPEG)
    fps, fourcc = packets.get(cv2.CAP_PROP_FPS), int(packets.get(cv2.CAP_PROP_FOURCC))
    packets.set(cv2.CAP_PROP_FORMAT, -1)
    settings = [cv2.VIDEOWRITER_PROP_RAW_VIDEO, 1]
    writer = cv2.VideoWriter(str(path), cv2.CAP_FFMPEG, fourcc, fps, SIZE, settings)
    while True:
        ok, packet = packets.read()
        if not ok:
            break
        shown = int(packets.get(cv2.CAP_PROP_PTS))
        writer.set(cv2.VIDEOWRITER_PROP_PTS, shown + shown // 3 + shown**2 // 20)
        writer.write(packet)
    writer.release()
    return path


def test_a_frame_out_of_range_is_refused(tmp_path):
    path = write_video(tmp_path / "a.mp4", "mp4v")
    for index in (-1, FRAMES):
        with pytest.raises(InputError, match=rf"a.mp4: expected a frame from 0 to 89, found {index}; the file has 90"):
            read_video_frame(path, index)


def test_a_frame_overwrites_no_other_image(tmp_path):
    image = tmp_path / "film_frame_000007.png"
    for _ in range(2):
        write_new(image, b"this frame")
    with pytest.raises(InputError, match="found another image; rename it"):
        write_new(image, b"another frame")
    assert image.read_bytes() == b"this frame"
