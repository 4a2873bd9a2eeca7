"""What a file is by its first bytes: a container of video, or something that is not opened.

FFmpeg recognises a file by its content whatever its name is. Among what it knows are single images, and playlists,
which name other files. OpenCV passes no list of permitted formats on to it.
"""

from pathlib import Path

from ..errors import InputError
from ..files.content import read_beginning
from ..images.image_check import SIGNATURES

_LOOKED_AT = 1024

_SIGNATURES = (
    b"\x1a\x45\xdf\xa3",  # Matroska, WebM
    b"\x00\x00\x01",  # MPEG program and elementary streams
    b"\x00\x00\x00\x01",  # H.264, HEVC
    b"OggS",
    b"\x30\x26\xb2\x75\x8e\x66\xcf\x11",  # ASF, WMV
    b"FLV",
    b"\x06\x0e\x2b\x34",  # MXF
    b"\x1f\x07\x00",  # DV
)
_BOXES = (b"ftyp", b"moov", b"mdat", b"free", b"skip", b"wide", b"pnot")
"""The first box of MP4 and QuickTime."""

_IMAGE_BRANDS = (b"avif", b"avis", b"heic", b"heix", b"heim", b"heis", b"mif1", b"msf1")
_OTHER_IMAGES = (b"GIF8", b"\x00\x00\x00\x0cjP  ", b"\xff\x4f\xff\x51", b"P1", b"P2", b"P3", b"P4", b"P5", b"P6", b"P7")
_PACKETS = (188, 192, 204)
"""Distances of the sync bytes in MPEG transport streams."""


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
    if not _is_video(start):
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


def _is_video(start: bytes) -> bool:
    if start.startswith(_SIGNATURES) or start[4:8] in _BOXES:
        return True
    if start[:4] == b"RIFF":
        return start[8:12] == b"AVI "
    # a recording may begin within a packet
    return any(
        len(start) > begin + 2 * step and all(start[begin + number * step] == 0x47 for number in range(3))
        for step in _PACKETS
        for begin in range(step)
    )
