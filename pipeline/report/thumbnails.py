"""Small pictures for a page of limited size: WebP, as large and as good as the number of pictures allows.

A few of the pictures are encoded first, from the best :class:`Quality` down, until the mean size fits.
"""

import base64
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeVar

import cv2
import numpy as np

PAGE_BYTES = 16_500_000
"""Of all pictures of views in a page, as text: leaves room below 20 MB for script, surface, frame and tables."""
TEXT_PER_BYTE = 4 / 3
"""Of base64."""
PILOTS = 8
MARGIN = 0.92
"""Share of the size that the pilots may fill: others may be larger."""

Picture = TypeVar("Picture")


@dataclass(frozen=True)
class Quality:
    """How a picture is encoded.

    Attributes
    ----------
    width_px
        Greatest width; narrower pictures keep theirs.
    webp
        Quality of WebP, 1..100.
    layer_width_px
        Greatest width of masks and depth.
    """

    width_px: int
    webp: int
    layer_width_px: int


QUALITIES = (
    Quality(1280, 88, 640), Quality(960, 86, 640), Quality(800, 84, 480), Quality(640, 82, 400), Quality(560, 80, 320),
    Quality(480, 78, 320), Quality(480, 70, 240), Quality(400, 66, 240), Quality(400, 58, 200), Quality(360, 58, 200),
    Quality(320, 58, 200), Quality(280, 56, 160), Quality(240, 48, 128), Quality(200, 40, 96), Quality(160, 32, 80),
)  # fmt: skip
"""From the best to the smallest."""


def fitting_quality(
    encoded_size: Callable[[Picture, Quality], int], pictures: Sequence[Picture], *, most_bytes: int = PAGE_BYTES
) -> Quality:
    """The best quality with which all pictures are expected to fit, or the smallest.

    Parameters
    ----------
    encoded_size
        Size in bytes of a picture's encoding, 0 if it cannot be read.
    pictures
        All of them; evenly spaced ones are encoded.
    most_bytes
        As text, of all pictures together.
    """
    if not pictures:
        return QUALITIES[0]
    chosen = np.unique(np.linspace(0, len(pictures) - 1, PILOTS).round().astype(int))
    pilots = [pictures[place] for place in chosen]
    for quality in QUALITIES:
        mean = sum(encoded_size(picture, quality) for picture in pilots) / len(pilots)
        if mean * TEXT_PER_BYTE * len(pictures) <= MARGIN * most_bytes:
            return quality
    return QUALITIES[-1]


def smaller(quality: Quality) -> Quality | None:
    """The next quality down; ``None`` below the smallest."""
    place = QUALITIES.index(quality) + 1
    return QUALITIES[place] if place < len(QUALITIES) else None


def shrunk(image: np.ndarray, width_px: int) -> np.ndarray:
    """An ``(H, W, …)`` image of at most this width, averaged over areas."""
    height, width = image.shape[:2]
    if width <= width_px:
        return image
    return cv2.resize(image, (width_px, max(1, round(height * width_px / width))), interpolation=cv2.INTER_AREA)


def webp(image: np.ndarray, quality: int) -> bytes:
    """Encode an 8-bit image, ``(H, W)`` or with 3 or 4 channels in OpenCV's order (BGR); the fourth without loss."""
    done, data = cv2.imencode(".webp", image, [cv2.IMWRITE_WEBP_QUALITY, quality])
    if not done:
        raise ValueError(f"expected an image that WebP can hold, found {image.shape} {image.dtype}")
    return data.tobytes()


def data_uri(data: bytes, kind: str = "image/webp") -> str:
    """Bytes as the address of a picture."""
    return f"data:{kind};base64,{base64_text(data)}"


def sized_picture(image: np.ndarray, quality: int) -> dict[str, object]:
    """A picture for the page: its address, and its size, so that nothing moves when it appears."""
    return {"uri": data_uri(webp(image, quality)), "width": image.shape[1], "height": image.shape[0]}


def limited_picture(image: np.ndarray, most_bytes: int) -> dict[str, object]:
    """A :func:`sized_picture` as large as fits into this many bytes of text, or the smallest."""
    for quality in QUALITIES:
        picture = sized_picture(shrunk(image, quality.width_px), quality.webp)
        if len(str(picture["uri"])) <= most_bytes:
            break
    return picture


def base64_text(data: bytes) -> str:
    """Bytes as text."""
    return base64.b64encode(data).decode("ascii")
