"""A video with the overlay of a case over each frame that has a pose; one frame is in memory at a time."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..camera.distortion import Distortion, distorted_pixels
from ..camera.pinhole import PinholeCamera
from ..case.loaded_case import LoadedCase, check_listed
from ..errors import InputError
from ..images.legend import Write, put_border
from ..poses.pose_file import read_frame_poses
from ..video.film_reader import WIDEST, Film, FilmFrame, FilmInfo
from .overlay_picture import OverlayPainter

PLAUSIBLE_FPS = 1.0, 240.0
DEFAULT_FPS = 25.0


@dataclass(frozen=True)
class FrameMark:
    """What a frame of a film says of its pose.

    Attributes
    ----------
    opacity
        That of the overlay, 0..1.
    codes
        sRGB of a border for a pose that is not sure; ``None`` for none.
    words
        In the border; of letters of a keyboard.
    """

    opacity: float = 1.0
    codes: tuple[int, int, int] | None = None
    words: str = ""


def output_rate(info: FilmInfo) -> tuple[float, int]:
    """Frames per second and number of the frames that are written: those of the film if they come at a steady rate."""
    fps = info.fps if PLAUSIBLE_FPS[0] <= info.fps <= PLAUSIBLE_FPS[1] else DEFAULT_FPS
    count = round(info.span_s * fps) + 1 if info.unique_times else info.frames
    # headers round the rate
    return fps, info.frames if abs(count - info.frames) <= 1 else count


@contextmanager
def opened_film(
    video: Path, poses: Path, loaded: LoadedCase
) -> Iterator[tuple[Film, list[np.ndarray | None], list[str]]]:
    """Start decoding a video and read a pose for each of its frames: ``cam_from_model`` (4x4, mm) or ``None``.

    Yields
    ------
    The film, the poses, and messages about both.
    """
    with Film(video, width=WIDEST) as film:
        found, messages = read_frame_poses(
            poses,
            film.info.frames,
            mesh_from_model=loaded.surface.mesh_from_model,
            mm_per_unit=loaded.case.mm_per_unit,
        )
        check_listed(loaded, found, poses.name)
        size_wh, camera = film.info.size_wh, loaded.frame.camera.for_images(film.info.size_wh, video.name)
        if camera.size_wh != loaded.frame.camera.size_wh:
            width, height = loaded.frame.camera.size_wh
            messages.append(f"{video.name}: {size_wh[0]}x{size_wh[1]} px, the K of {width}x{height} is scaled to it")
        messages += [f"{video.name}: {note}" for note in film.info.notes]
        yield film, found, messages


class OverlayFilm:
    """Draws a film.

    ``counts`` has what the pictures show that were drawn so far: frames with an overlay, without one for lack of a pose
    or of surface in view, pictures that stand in for frames that cannot be decoded or come late, and frames that are
    left out because they come too soon after another one.
    """

    def __init__(
        self,
        loaded: LoadedCase,
        film: Film,
        poses: Sequence[np.ndarray | None],
        write: Write | None,
        *,
        marks: Mapping[int, FrameMark] | None = None,
    ) -> None:
        """Prepare the film of a case; see :func:`opened_film`.

        ``write`` draws the letters of legend and scale bar, ``None`` for neither; ``marks`` has those of the frames
        that are marked, by their numbers, whose words need it too.
        """
        self._film, self._poses, self._write, self._marks = film, poses, write, marks or {}
        camera = loaded.frame.camera.for_images(film.info.size_wh, film.path.name)
        self._painter = OverlayPainter(loaded, camera, write)
        self._straight = _resampler(camera, loaded.case.distortion)
        self.counts = dict.fromkeys(("drawn", "without_pose", "out_of_view", "repeated", "left_out"), 0)
        self.fps, self.count = output_rate(film.info)
        self.pixel_aspect = film.info.pixel_aspect

    def pictures(self, progress: Callable[[], None]) -> Iterator[np.ndarray]:
        """The :attr:`count` pictures of the film, :attr:`fps` a second; ``progress`` is called for each."""
        for picture in self._steady():
            progress()
            yield picture

    def lines(self) -> list[str]:
        """What the pictures show."""
        counts, lines = self.counts, [f"{self.count} frames, {self.counts['drawn']} with overlay"]
        if counts["without_pose"]:
            lines[0] += f", {counts['without_pose']} without pose"
        if counts["out_of_view"]:
            lines[0] += f", {counts['out_of_view']} whose pose does not show the surface"
        if counts["repeated"]:
            lines.append(f"{counts['repeated']} pictures are repeated: frames that cannot be decoded or come late")
        if counts["left_out"]:
            lines.append(f"{counts['left_out']} frames are left out: they come too soon after another one")
        return lines

    def _steady(self) -> Iterator[np.ndarray]:
        """The pictures at a steady rate."""
        picture, sent, first_s = None, 0, 0.0
        for frame in self._film:
            if picture is None:
                first_s = frame.time_s if frame.index == 0 else frame.time_s - frame.index / self.fps
            due = min(self._due(frame, first_s), self.count - 1)
            if picture is not None and due < sent:
                self.counts["left_out"] += 1
                continue
            before, picture = picture, self._drawn(frame)
            for _ in range(due - sent):
                self.counts["repeated"] += 1
                yield picture if before is None else before
            yield picture
            sent = due + 1
        if picture is None:
            raise InputError(f"{self._film.path.name}: expected a video, cannot decode any frame of it; copy it again")
        for _ in range(self.count - sent):
            self.counts["repeated"] += 1
            yield picture

    def _due(self, frame: FilmFrame, first_s: float) -> int:
        """Number of the picture that shows a frame."""
        if not self._film.info.unique_times or self.count == self._film.info.frames:
            return frame.index
        return max(round((frame.time_s - first_s) * self.fps), 0)

    def _drawn(self, frame: FilmFrame) -> np.ndarray:
        image = self._straight(frame.image)
        pose, mark = self._poses[frame.index], self._marks.get(frame.index, FrameMark())
        if pose is None:
            self.counts["without_pose"] += 1
        else:
            strength = None if mark.opacity == 1 else np.full(image.shape[:2], mark.opacity, np.float32)
            painted = self._painter.paint(image, pose, clear=strength, sure=mark.codes is None)
            self.counts["drawn" if painted.shows_surface else "out_of_view"] += 1
            image = painted.image
        if mark.codes is not None:
            image = image.copy()
            put_border(image, mark.codes, mark.words, self._write)
        return image


def _resampler(camera: PinholeCamera, distortion: Distortion | None) -> Callable[[np.ndarray], np.ndarray]:
    if distortion is None:
        return lambda image: image
    from ..video.frame_mask import Resampler

    return Resampler(distorted_pixels(camera, distortion, camera.pixel_grid()))
