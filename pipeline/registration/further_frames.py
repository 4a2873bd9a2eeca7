"""Further frames as they are registered: of a folder of images or of a video, small and without distortion."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from ..camera.distortion import distorted_pixels
from ..case.case_file import Case
from ..case.frame import PosedFrame
from ..errors import InputError
from ..images.image_reader import read_image
from ..images.pixel_values import to_uint8
from ..video.film_reader import Film
from ..video.frame_mask import Resampler

LONGER_SIDE_PX = 640
"""Frames are registered at this size: larger ones take longer and end no nearer, as the surface's own error limits."""
IMAGES = (".png", ".jpg", ".jpeg", ".jpe", ".jfif", ".tif", ".tiff", ".bmp", ".webp", ".heic", ".avif", ".jp2", ".gif")
"""Endings of images in a folder; what is no PNG or JPEG among them is refused with its name, not passed over."""


@dataclass(frozen=True)
class FurtherFrame:
    """A frame that is to be registered.

    Attributes
    ----------
    name
        That of its image; empty in a video.
    number
        Counted from 0, in the video or among the images.
    image, valid
        ``(H, W, 3)`` uint8 undistorted, at the size of registration; ``(H, W)`` bool: pixels that may be used.
    problem
        Why it cannot be used, in a short sentence without a name; empty if it can.
    """

    name: str
    number: int
    image: np.ndarray
    valid: np.ndarray
    problem: str = ""


@dataclass(frozen=True)
class OpenedFrames:
    """How many frames there are, the frames, and a sentence if the file of a video is cut off, else empty."""

    count: int
    frames: Iterator[FurtherFrame]
    cut_off: str = ""


class FrameReader:
    """Reads frames of a case's camera."""

    def __init__(self, case: Case) -> None:
        self._case, self.camera = case, case.camera.within(LONGER_SIDE_PX)
        self._straight: Resampler | None = None
        self._inside = np.ones(self.camera.shape_hw, bool)
        if case.distortion is not None:
            pixels = distorted_pixels(self.camera, case.distortion, self.camera.pixel_grid())
            self._straight = Resampler(pixels)
            self._inside = ((pixels >= 0) & (pixels <= np.array(self.camera.size_wh) - 1)).all(axis=-1)

    @contextmanager
    def opened(self, folder_or_video: Path, every: int = 1) -> Iterator[OpenedFrames]:
        """Open a folder of images or a video, of which every n-th frame is read.

        A frame that cannot be read, and an image of other proportions than K's or a frame of another size than the
        film's first one, comes with its problem.
        """
        if folder_or_video.is_dir():
            paths = image_paths(folder_or_video)
            if not paths:
                raise InputError(f"{folder_or_video}: expected images (PNG or JPEG) or a video, found none")
            chosen = list(enumerate(paths))[::every]
            yield OpenedFrames(len(chosen), (self.image(number, path) for number, path in chosen))
            return
        with Film(folder_or_video, every=every, width=self.camera.width) as film:
            self._case.camera.for_images(film.info.size_wh, folder_or_video.name)
            yield OpenedFrames(film.info.frames, self._of_film(film, every), film.info.cut_off)

    def _of_film(self, film: Film, every: int) -> Iterator[FurtherFrame]:
        due = 0
        for each in film:
            yield from (self._unusable("", number, film.problem(number)) for number in range(due, each.index, every))
            yield self._undistorted("", each.index, each.image)
            due = each.index + every
        rest = range(due, film.info.frames * every, every)
        yield from (self._unusable("", number, film.problem(number)) for number in rest)

    def image(self, number: int, path: Path) -> FurtherFrame:
        """Read an image."""
        try:
            image, valid = read_image(path, path.name)
            self._case.camera.for_images((image.shape[1], image.shape[0]), path.name)
        except InputError as error:
            return self._unusable(path.name, number, str(error).removeprefix(f"{path.name}: "))
        small, shown = _reduced(image, valid, self.camera.size_wh)
        frame = self._undistorted(path.name, number, to_uint8(small))
        return replace(frame, valid=frame.valid & shown)

    def _unusable(self, name: str, number: int, problem: str) -> FurtherFrame:
        grey = np.full((*self.camera.shape_hw, 3), 128, np.uint8)
        return FurtherFrame(name, number, grey, np.zeros(self.camera.shape_hw, bool), problem)

    def _undistorted(self, name: str, number: int, image: np.ndarray) -> FurtherFrame:
        if image.shape[1::-1] != self.camera.size_wh:
            image = cv2.resize(image, self.camera.size_wh, interpolation=cv2.INTER_AREA)
        if self._straight is not None:
            image = self._straight(image)
        return FurtherFrame(name, number, image, self._inside)


def frame_files(frames: Path) -> dict[str, Path]:
    """All that is read of a folder of images or a video, by what it is."""
    if not frames.is_dir():
        return {"video": frames}
    return {"folder of the frames": frames} | {f"image {path.name}": path for path in image_paths(frames)}


def image_paths(folder: Path) -> list[Path]:
    """The images of a folder by their names, without hidden ones such as ``._1.jpg``, which a Mac puts beside each."""
    return sorted(path for path in folder.iterdir() if path.suffix.lower() in IMAGES and not path.name.startswith("."))


def small_frame(frame: PosedFrame, longer_side_px: int = LONGER_SIDE_PX) -> PosedFrame:
    """A frame at the size at which frames are registered, or at another one."""
    camera = frame.camera.within(longer_side_px)
    image, valid = _reduced(frame.image, frame.valid, camera.size_wh)
    return replace(frame, image=image, valid=valid, camera=camera)


def _reduced(image: np.ndarray, valid: np.ndarray, size_wh: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """An image in another size, and which of its pixels are made of valid ones alone."""
    small, share = (
        cv2.resize(each, size_wh, interpolation=cv2.INTER_AREA) for each in (image, valid.astype(np.float32))
    )
    return small, share > 0.99


def evenly(things: Sequence, most: int) -> list:
    """At most so many of them, evenly chosen from the first to the last."""
    return [things[at] for at in sorted({round(at) for at in np.linspace(0, len(things) - 1, min(len(things), most))})]
