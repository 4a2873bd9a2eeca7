"""Further frames as they are registered: of a folder of images or of a video, small and without distortion."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from ..camera.distortion import Distortion, distorted_pixels
from ..camera.intrinsics_file import CameraFile, read_camera
from ..camera.pinhole import PinholeCamera
from ..case.case_file import Case
from ..case.frame import PosedFrame
from ..errors import InputError, printable
from ..files.content import read_content
from ..files.keys import check_keys, described, file_and_place
from ..images.image_check import check_image
from ..images.image_reader import read_image
from ..images.pixel_values import to_uint8
from ..poses.pose_file import listed_poses
from ..poses.pose_tables import NO_SCALE, POSE_KEY
from ..video.film_reader import Film
from ..video.frame_mask import Resampler

LONGER_SIDE_PX = 640
"""Frames are registered at this size: larger ones take longer and end no nearer, as the surface's own error limits."""
IMAGES = (".png", ".jpg", ".jpeg", ".jpe", ".jfif", ".tif", ".tiff", ".bmp", ".webp", ".heic", ".avif", ".jp2", ".gif")
"""Endings of images in a folder; what is no PNG or JPEG among them is refused with its name, not passed over."""


LISTS, CAMERA = (".json", ".txt"), "camera"
"""Endings of lists of photographs, and the key of an entry for the file of its camera, with # which of that file."""
ENTRY = (
    POSE_KEY, CAMERA, NO_SCALE, "frame", "state", "probability", "reason", "changed", "covariance_mm_rad",
    "by_zoom_mm_rad", "pivot_mesh_mm", "radius_mm",
)  # fmt: skip
"""All keys of an entry beside its image, also of a list that :mod:`.pose_list` writes."""


@dataclass(frozen=True)
class ListedImage:
    """An image of a folder or of a list of photographs.

    Attributes
    ----------
    path
        Its file.
    camera_file, camera
        Where its own camera stands, relative as its entry has it, and what that is; empty, ``None``: the case's.
    """

    path: Path
    camera_file: Path = Path()
    camera: CameraFile | None = None

    @classmethod
    def of_entry(cls, entry: Any, where: str, folder: Path) -> "ListedImage":
        """The image of a list's entry; ``where`` begins messages, ``folder`` is the list's."""
        check_keys(entry if isinstance(entry, dict) else {}, ("image",), ENTRY, f"{where}: ")
        image, named = entry["image"], entry.get(CAMERA, "")
        if not (isinstance(image, str) and image and isinstance(named, str)):
            found = f"found image = {described(image)}, {CAMERA} = {described(named)}"
            raise InputError(f"{where}: expected the name of an image, and of a {CAMERA}'s file if any, {found}")
        return cls(folder / image, folder / named, read_camera(folder / named)) if named else cls(folder / image)

    @property
    def size_wh(self) -> tuple[int, int]:
        """(width, height) in pixels, which its file states."""
        return check_image(read_content(self.path, "an image file", self.path.name), self.path.name)

    def lens(self, case: Case, size_wh: tuple[int, int]) -> tuple[PinholeCamera, Distortion | None]:
        """K and distortion for the image in its size; the case's if it has none of its own."""
        if self.camera is None:
            return case.camera.for_images(size_wh, self.path.name), case.distortion
        own = self.camera.camera(self.camera.size or size_wh)
        return own.for_images(size_wh, self.path.name), self.camera.distortion_for(own)


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

    @contextmanager
    def opened(self, frames: Path, every: int = 1) -> Iterator[OpenedFrames]:
        """Open a folder or a list of images, or a video, of which every n-th frame is read.

        A frame that cannot be read, and an image of other proportions than K's or a frame of another size than the
        film's first one, comes with its problem.
        """
        if (images := listed_images(frames)) is not None:
            if not images:
                raise InputError(f"{frames}: expected images (PNG or JPEG) or a video, found none")
            chosen = list(enumerate(images))[::every]
            yield OpenedFrames(len(chosen), (self.image(number, image) for number, image in chosen))
            return
        with Film(frames, every=every, width=self.camera.width) as film:
            self._case.camera.for_images(film.info.size_wh, frames.name)
            yield OpenedFrames(film.info.frames, self._of_film(film, every), film.info.cut_off)

    def _of_film(self, film: Film, every: int) -> Iterator[FurtherFrame]:
        due = 0
        for each in film:
            yield from (self._unusable("", number, film.problem(number)) for number in range(due, each.index, every))
            yield self._straight("", each.index, each.image, self.camera, self._case.distortion)
            due = each.index + every
        rest = range(due, film.info.frames * every, every)
        yield from (self._unusable("", number, film.problem(number)) for number in rest)

    def image(self, number: int, listed: ListedImage) -> FurtherFrame:
        """Read an image; one of another camera becomes what the case's camera would see from there."""
        name = listed.path.name
        try:
            image, valid = read_image(listed.path, name)
            camera, lens = listed.lens(self._case, (image.shape[1], image.shape[0]))
        except InputError as error:
            # the page goes to others: no folders of this machine
            reason = str(error).replace(printable(str(listed.path)), "it").removeprefix(f"{printable(name)}: ")
            return self._unusable(name, number, reason)
        # as fine as it will be
        camera = camera.within(max(round(max(camera.size_wh) * self.camera.fx / camera.fx), 1))
        small, shown = _reduced(image, valid, camera.size_wh)
        return self._straight(name, number, to_uint8(np.dstack([small, shown])), camera, lens)

    def _unusable(self, name: str, number: int, problem: str) -> FurtherFrame:
        grey = np.full((*self.camera.shape_hw, 3), 128, np.uint8)
        return FurtherFrame(name, number, grey, np.zeros(self.camera.shape_hw, bool), problem)

    def _straight(
        self, name: str, number: int, image: np.ndarray, camera: PinholeCamera, lens: Distortion | None
    ) -> FurtherFrame:
        """A frame by the case's camera of ``(H, W, 3 or 4)`` uint8 by another; the fourth is 255 where it is valid."""
        if image.shape[1::-1] != camera.size_wh:
            image = cv2.resize(image, camera.size_wh, interpolation=cv2.INTER_AREA)
        resampled, inside = _resampler(self.camera, camera, lens)
        image = image if resampled is None else resampled(image)
        return FurtherFrame(name, number, image[..., :3], inside & (image[..., 3:] == 255).all(axis=-1))


@lru_cache(maxsize=1)
def _resampler(
    to: PinholeCamera, camera: PinholeCamera, lens: Distortion | None
) -> tuple[Resampler | None, np.ndarray]:
    """From images of a camera and lens to a camera without lens in the same place, and which pixels it has seen."""
    grid = to.pixel_grid()
    pixels = camera.project(to.rays_cam(grid))
    if lens is None and camera.size_wh == to.size_wh and np.abs(pixels - grid).max() < 1e-3:
        return None, np.ones(to.shape_hw, bool)
    pixels = pixels if lens is None else distorted_pixels(camera, lens, pixels)
    return Resampler(pixels), ((pixels >= 0) & (pixels <= np.array(camera.size_wh) - 1)).all(axis=-1)


def frame_files(frames: Path) -> dict[str, Path]:
    """All that is read of a folder or a list of images, or of a video, by what it is."""
    if (images := listed_images(frames)) is None:
        return {"video": frames}
    # of a name that no file can have, none is there
    named = {f"image {each.path.name}": each.path for each in images if each.path.exists()}
    return {"folder or list of the frames": file_and_place(frames)[0]} | named


def listed_images(frames: Path) -> list[ListedImage] | None:
    """The images of a folder, or of a list or table of photographs; ``None`` of a video."""
    if frames.is_dir():
        # a Mac puts a hidden ._1.jpg beside each
        return [ListedImage(each) for each in sorted(frames.glob("[!.]*")) if each.suffix.lower() in IMAGES]
    path, _ = file_and_place(frames)
    if path.suffix.lower() not in LISTS:
        return None
    entries = enumerate(listed_poses(frames))
    return [ListedImage.of_entry(each, f"{path.name}: entry {number}", path.parent) for number, each in entries]


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
