"""Small pictures for a page of limited size: WebP, as large and as good as the number of pictures allows.

A few of the pictures are encoded first, from the best :class:`Quality` down, until the mean size fits.
"""

import base64
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import repeat
from typing import TypeVar

import cv2
import numpy as np

from ..progress import Progress

PAGE_BYTES = 16_500_000
"""Room for all pictures of views in a page, as text: leaves room below 20 MB for script, surface, frame and tables."""
TEXT_PER_BYTE = 4 / 3
"""Growth of what is written as base64."""
PILOTS = 8
MARGIN = 0.92
"""Share of the size that the pilots may fill: others may be larger."""

THREADS = 4
"""OpenCV decodes and encodes without Python's lock; each thread holds one picture."""

Picture = TypeVar("Picture")
Encoded = TypeVar("Encoded")


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


def fitted(
    pictures: Sequence[Picture],
    encoded: Callable[[Picture, Quality], Encoded],
    text_size: Callable[[Encoded], float],
    *,
    most_bytes: int,
    progress: Callable[[int], Progress],
) -> list[Encoded]:
    """All pictures with the best quality with which they fit, or the smallest.

    Parameters
    ----------
    pictures
        All of them, in their order; a few threads encode them, and no more wait than these take.
    encoded, text_size
        Encodes one; size of the result in bytes of text.
    most_bytes
        Of all together.
    progress
        Shows how many of so many are done.
    """
    chosen = np.unique(np.linspace(0, len(pictures) - 1, min(PILOTS, len(pictures))).round().astype(int))
    with ThreadPoolExecutor(THREADS) as pool:
        for quality in QUALITIES:
            mean = np.mean([text_size(encoded(pictures[place], quality)) for place in chosen]) if len(chosen) else 0.0
            if mean * len(pictures) > MARGIN * most_bytes and quality is not QUALITIES[-1]:
                continue
            found: list[Encoded] = []
            with progress(len(pictures)) as shown:
                for start in range(0, len(pictures), 2 * THREADS):
                    for one in pool.map(encoded, pictures[start : start + 2 * THREADS], repeat(quality)):
                        found.append(one)
                        shown.advance()
            # the pilots may have been easier than the rest
            if sum(map(text_size, found)) <= most_bytes:
                break
    return found


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


def sized_picture(image: np.ndarray, quality: int) -> dict[str, object]:
    """A picture for the page: its address, and its size, so that nothing moves when it appears."""
    return {
        "uri": f"data:image/webp;base64,{base64_text(webp(image, quality))}",
        "width": image.shape[1],
        "height": image.shape[0],
    }


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
