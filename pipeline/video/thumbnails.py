"""Small pictures of a film at regular distances: a fixed number at most, however long it is. Needs ``cv2``."""

from bisect import bisect_left

import cv2
import numpy as np

from .film_reader import FilmFrame

MOST = 200
"""Pictures that are kept."""

MOST_PIXELS = 320 * 180
"""Of one picture: all of them take 35 MB."""


class Thumbnails:
    """Keeps every so many of the frames that it is given; twice as many apart whenever there are too many."""

    def __init__(self) -> None:
        self._apart, self._given = 1, 0
        self._indices: list[int] = []
        self._images: list[np.ndarray] = []

    def __len__(self) -> int:
        return len(self._images)

    def add(self, frame: FilmFrame) -> None:
        """Take the next frame of the film."""
        number, self._given = self._given, self._given + 1
        if number % self._apart:
            return
        self._indices.append(frame.index)
        self._images.append(_small(frame.image))
        if len(self._images) > MOST:
            self._apart *= 2
            self._indices, self._images = self._indices[::2], self._images[::2]

    def nearest(self, index: int) -> tuple[int, np.ndarray]:
        """Number and picture, ``(h, w, 3)`` uint8 RGB, of the frame that is nearest to frame ``index``.

        Raises
        ------
        LookupError
            There are no pictures.
        """
        after = bisect_left(self._indices, index)
        near = range(max(after - 1, 0), min(after + 1, len(self._indices)))
        at = min(near, key=lambda number: abs(self._indices[number] - index), default=None)
        if at is None:
            raise LookupError("expected pictures of a film, found none")
        return self._indices[at], self._images[at]


def _small(image: np.ndarray) -> np.ndarray:
    height, width = image.shape[:2]
    scale = min(1.0, (MOST_PIXELS / (width * height)) ** 0.5)
    if scale == 1.0:
        return image.copy()
    size_wh = max(1, round(width * scale)), max(1, round(height * scale))
    return cv2.resize(image, size_wh, interpolation=cv2.INTER_AREA)
