"""Opens the container of a film, in the child process of the reader. Needs ``av`` (PyAV, which brings FFmpeg).

FFmpeg recognises a file by its content whatever its name is. Among what it knows are single images, and playlists,
which name other files: containers of films alone are permitted, and no way to any other file.
"""

import re
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import av
import av.logging
from av.container import Flags, InputContainer
from av.packet import Packet
from av.stream import Disposition
from av.video.frame import VideoFrame
from av.video.stream import VideoStream

from ..errors import InputError
from ..files.content import read_beginning
from ..images.image_check import LARGEST_FRAME, image_kind

_CONTAINERS = (
    "3g2,3gp,asf,av1,avi,dirac,dv,flv,gxf,h263,h264,hevc,ivf,m4v,matroska,mj2,mjpeg,mov,mp4,mpeg,mpegts,mpegvideo,mxf,nut,obu,ogg,"
    "rm,vc1,webm,wtv,yuv4mpegpipe"
)

_NO_FILM = Disposition.attached_pic | Disposition.timed_thumbnails | Disposition.still_image
"""Streams of pictures that no player shows as a film: a cover, above all."""

_HDR_TRANSFERS = (16, 18)
_WIDE_PRIMARIES = (9, 11, 12)
"""FFmpeg's AVCOL_TRC_SMPTE2084 (PQ) and AVCOL_TRC_ARIB_STD_B67 (HLG); its AVCOL_PRI_BT2020, and those of P3."""

_MOST_ERRORS = 100
"""Errors after which a damaged container is read no further."""

_LOOKED_AT = 1024


@contextmanager
def opened(path: Path) -> Iterator[tuple[InputContainer, VideoStream]]:
    """The container of a film, and in it the stream that a player shows."""
    _check_beginning(path)
    with open(path, "rb") as file:
        try:
            options = {"format_whitelist": _CONTAINERS, "protocol_whitelist": "file"}
            container = av.open(file, options=options, metadata_errors="replace")
        except av.FFmpegError:
            raise _unopened(path) from None
        with container:
            # times that FFmpeg makes up are no times
            container.flags &= ~Flags.gen_pts.value
            stream = _shown_stream(container, path)
            if stream.width * stream.height > LARGEST_FRAME:
                raise InputError(
                    f"{path.name}: expected frames of at most {LARGEST_FRAME / 1e6:.1f} million pixels, found "
                    f"{stream.width}x{stream.height}; scale the video down"
                )
            coded = stream.codec_context
            if coded.color_trc in _HDR_TRANSFERS or coded.color_primaries in _WIDE_PRIMARIES:
                raise InputError(
                    f"{path.name}: expected a film for screens of usual range, found HDR (HLG or PQ) "
                    "or wide colours (BT.2020, P3), which come out pale; record without HDR, or convert it to SDR"
                )
            # frames may change their size
            stream.codec_context.options = {"max_pixels": str(LARGEST_FRAME)}
            # every thread holds frames of its own
            stream.thread_type, stream.thread_count = "NONE", 1
            yield container, stream


def packets_of(container: InputContainer, stream: VideoStream) -> Iterator[Packet]:
    """Packets of a stream in the order of the file, of a damaged one those that can be read; the last one is empty."""
    for _ in range(_MOST_ERRORS):
        with suppress(av.FFmpegError):
            yield from container.demux(stream)
            return


def frames_of(container: InputContainer, stream: VideoStream) -> Iterator[tuple[int | None, VideoFrame | None]]:
    """Times and frames in display order; ``None`` for one that cannot be decoded or of which the decoder complains.

    So is what follows one of these up to the next key frame: FFmpeg makes it up from other pictures. Before the first
    key frame there are whole ones alone.
    """
    # some decoders, FFV1's with its checksums for one, tell damage in words alone
    av.logging.set_level(av.logging.ERROR)
    av.logging.set_skip_repeated(False)
    is_whole, has_begun, damaged = True, False, set[int | None]()
    for packet in packets_of(container, stream):
        frames: list[VideoFrame] | None = None
        with av.logging.Capture() as complaints, suppress(av.FFmpegError):
            frames = packet.decode()
        has_begun = has_begun or packet.is_keyframe
        if frames is None or complaints:
            is_whole = False
            damaged.add(packet.pts)
            if has_begun and not frames:
                yield packet.pts, None
        for frame in frames or ():
            is_whole = (is_whole or frame.key_frame) and not frame.is_corrupt and frame.pts not in damaged
            if is_whole or has_begun:
                yield frame.pts, frame if is_whole else None


def _shown_stream(container: InputContainer, path: Path) -> VideoStream:
    """The default one, and of several the largest, as FFmpeg's own program chooses."""
    streams = [stream for stream in container.streams.video if not stream.disposition & _NO_FILM]
    if not streams:
        raise _unopened(path)
    known = [stream for stream in streams if stream.codec_context is not None]
    if not known:
        raise InputError(
            f"{path.name}: expected a video in a codec that FFmpeg decodes, found {_codec_of(container)}; convert it "
            f"to MP4 (H.264) with the program of the recorder or the camera"
        )
    return max(known, key=lambda each: (bool(each.disposition & Disposition.default), each.width * each.height))


def _codec_of(container: InputContainer) -> str:
    """What FFmpeg says of a codec that it cannot decode, such as ``unknown (XYZ9 / 0x395A5958)``."""
    level = av.logging.get_level()
    av.logging.set_level(av.logging.INFO)
    words = re.search(r"Video: ([^,]*)", container.dumps_format())
    av.logging.set_level(level)
    return words[1].replace("none", "unknown") if words else "unknown"


def _check_beginning(path: Path) -> None:
    start = read_beginning(path, "a video", _LOOKED_AT)
    if not start:
        raise InputError(f"{path.name}: expected a video, cannot open it, it is empty; copy it again")
    if kind := image_kind(start):
        raise InputError(
            f"{path.name}: expected a video, found an image ({kind}); put it into a folder, or name it as the frame of "
            "the case"
        )


def _unopened(path: Path) -> InputError:
    return InputError(
        f"{path.name}: expected a video, cannot open it; it is cut off, without pictures, or in an unknown format: "
        "copy it again, or convert it to MP4 (H.264)"
    )
