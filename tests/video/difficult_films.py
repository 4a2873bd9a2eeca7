"""Films of all kinds, whose frames tell their numbers and colours."""

from collections.abc import Sequence
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
from av.stream import Disposition

FPS = 25
PATCHES = np.array(
    [(180, 40, 35), (230, 200, 160), (40, 80, 190), (50, 170, 60), (128, 128, 128), (220, 30, 90), (120, 20, 20)],
    np.uint8,
)  # fmt: skip


def numbered(number: int, size_wh: tuple[int, int] = (128, 96)) -> np.ndarray:
    """RGB: the number as eight black or white bars above, :data:`PATCHES` below."""
    width, height = size_wh
    image = np.empty((height, width, 3), np.uint8)
    for bit in range(8):
        image[: height // 2, bit * width // 8 : (bit + 1) * width // 8] = 230 if number >> bit & 1 else 20
    for at, colour in enumerate(PATCHES):
        image[height // 2 :, at * width // 7 : (at + 1) * width // 7] = colour
    return image


def number_of(image: np.ndarray) -> int:
    height, width = image.shape[:2]
    columns = [round((bit + 0.5) * width / 8) for bit in range(8)]
    return sum(int(image[height // 4, u].mean() > 125) << bit for bit, u in enumerate(columns))


def colours_of(image: np.ndarray) -> np.ndarray:
    """The patches' colours, ``(7, 3)``."""
    height, width = image.shape[:2]
    return np.array([image[3 * height // 4, round((at + 0.5) * width / 7)] for at in range(7)]).astype(int)


def write_frames(
    path: Path,
    count: int,
    codec: str = "libx264",
    size_wh: tuple[int, int] = (128, 96),
    *,
    pixels: str = "yuv420p",
    matrix: int = 2,
    colour_range: int = 1,
    **options: str,
) -> Path:
    """Encode numbered frames; ``matrix`` and ``colour_range`` are stated as FFmpeg numbers them.

    A film that states no matrix (2) is written by that of BT.709 from 1280x577 px on, else by that of BT.601.
    """
    with av.open(str(path), "w") as out:
        stream = out.add_stream(codec, FPS, options=options)
        stream.width, stream.height, stream.pix_fmt = *size_wh, pixels
        stream.colorspace, stream.color_range = matrix, colour_range
        used = {2: 1 if size_wh[0] >= 1280 or size_wh[1] > 576 else 5, 6: 5}.get(matrix, matrix)
        for number in range(count):
            frame = av.VideoFrame.from_ndarray(numbered(number, size_wh))
            how = av.video.reformatter.Interpolation.BILINEAR | 0x40000
            frame = frame.reformat(format=pixels, dst_colorspace=used, dst_color_range=colour_range, interpolation=how)
            frame.pts, frame.time_base = number, Fraction(1, FPS)
            if matrix in (2, 6):
                frame.colorspace = matrix
            out.mux(stream.encode(frame))
        out.mux(stream.encode())
    return path


def write_images(path: Path, images: Sequence[np.ndarray], *, uneven: bool = False) -> Path:
    """Encode RGB images of one size, nearly without loss; at increasing gaps if they are ``uneven``."""
    with av.open(str(path), "w") as out:
        stream = out.add_stream("libx264", FPS, options={"qp": "4", "g": "1"})
        stream.height, stream.width = images[0].shape[:2]
        stream.pix_fmt = "yuv420p"
        for number, image in enumerate(images):
            frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(image))
            frame.pts, frame.time_base = number + uneven * (number // 3 + number**2 // 20), Fraction(1, FPS)
            out.mux(stream.encode(frame))
        out.mux(stream.encode())
    return path


def copied(
    path: Path,
    sources: Sequence[Path],
    *,
    from_s: float = 0.0,
    turn: dict | None = None,
    cover: bool = False,
    **options,
) -> Path:
    """The packets of films as streams of one file; those from before ``from_s`` get a time below 0.

    The first stream is turned, or a cover.
    """
    films = [av.open(str(source)) for source in sources]
    with av.open(str(path), "w", options={"avoid_negative_ts": "disabled", **options}) as out:
        streams = [out.add_stream_from_template(film.streams[0]) for film in films]
        if cover:
            streams[0].disposition = Disposition.attached_pic
        if turn:
            streams[0].set_display_rotation(**turn)
        for film, stream in zip(films, streams, strict=True):
            shift = round(from_s / film.streams[0].time_base)
            for packet in film.demux(film.streams[0]):
                if packet.dts is not None:
                    packet.pts, packet.dts, packet.stream = packet.pts - shift, packet.dts - shift, stream
                    out.mux(packet)
    for film in films:
        film.close()
    return path
