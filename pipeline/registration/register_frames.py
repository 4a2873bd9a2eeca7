"""Register the frames of a folder or a video to a case, one after the other."""

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from ..alignment.pose_uncertainty import PoseUncertainty
from ..camera.distortion import distorted_pixels
from ..camera.pinhole import PinholeCamera
from ..case.frame import PosedFrame, UnreadFrame
from ..case.loaded_case import LoadedCase
from ..colour.reference_view import ReferenceView, reference_view
from ..errors import InputError
from ..files.content import content_named
from ..files.outputs import write_output
from ..images.image_reader import read_image
from ..images.pixel_values import to_uint8
from ..images.png import encode_png
from ..transforms import inverse_rigid
from ..video.film_reader import Film
from ..video.frame_mask import Resampler
from ..video.frame_measures import denoised
from . import surface_check
from .colour_sources import Candidate, Candidates, evenly
from .known_views import grey_codes
from .register import RegisteredFrame, Registrar, judged_together, zoom_of
from .source_correction import doubt_of_source, with_case
from .surface_check import SurfaceCheck
from .verdict import ACCEPTED, REFUSED, FilmAgreement, FilmChange, Verdict

LONGER_SIDE_PX = 640
"""Frames are registered at this size: larger ones take longer and end no nearer, as the surface's own error limits."""

FRAME = "frame_{:06d}.png"
"""Name of a frame that is written; :func:`.content_named` then."""
FRAME_NAMES = r"frame_\d+-[0-9a-f]{8}\.png"
"""Regular expression of these."""
IMAGES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp")


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
        ``(H, W, 3)`` uint8 undistorted, at the size of registration; ``(H, W)`` bool.
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


Guess = Callable[[np.ndarray, PinholeCamera], Iterable[np.ndarray]]
"""Gives first poses ``cam_from_model`` of an undistorted image ``(H, W, 3)`` uint8, the likeliest first, as needed."""


class CaseRegistrar:
    """Registers frames to a case."""

    def __init__(self, loaded: LoadedCase, guess: Guess | None = None) -> None:
        """Prepare a case at its pose; ``guess`` is asked before the features.

        Raises
        ------
        InputError
            The frame does not show the surface.
        """
        frame = loaded.frame
        small = small_frame(frame)
        self.camera = small.camera
        view = reference_view(replace(loaded, frames=(small,)))
        self.mesh, self.pivot_model, self.cam_from_model = view.mesh, view.pivot_model, frame.cam_from_model
        self.source = view.view
        self._registrar = Registrar(view.mesh, view.view, view.pivot_model)
        self.loaded, self._guess = loaded, guess
        self._case, self._own = loaded.case, _own_uncertainty(loaded, view)
        self._straight: Resampler | None = None
        self._inside = np.ones(self.camera.shape_hw, bool)
        if loaded.case.distortion is not None:
            pixels = distorted_pixels(self.camera, loaded.case.distortion, self.camera.pixel_grid())
            self._straight = Resampler(pixels)
            self._inside = ((pixels >= 0) & (pixels <= np.array(self.camera.size_wh) - 1)).all(axis=-1)
        self._before: tuple[np.ndarray, ...] = ()

    def register(self, frame: FurtherFrame, near: np.ndarray | None = None) -> RegisteredFrame:
        """Register the next frame, from a pose ``(4, 4)`` that may be near; that of a video from those before.

        What the surface and the case's own pose are off is included; whether the frame is zoomed, the others of its set
        tell: :func:`.judged_together`.

        Raises
        ------
        InputError
            The case's frame shows too little texture on the surface.
        """
        found = self.registered_alone(frame, near)
        if found.fit is None:
            return found
        found = replace(found, zoom=zoom_of(found.fit, self.pivot_model))
        return with_case(found, self._own, self.cam_from_model, self.camera)

    def registered_alone(self, frame: FurtherFrame, near: np.ndarray | None = None) -> RegisteredFrame:
        """Register a frame as if the case's pose and the focal length were certain."""
        if frame.problem:
            self._before = ()
            return RegisteredFrame(Verdict(REFUSED, 0.0, frame.problem))
        if near is None and not frame.name and self._before:
            # the camera goes on as it did
            near = self._before[-1] @ inverse_rigid(self._before[0]) @ self._before[-1]
        guesses = () if self._guess is None else self._guess(frame.image, self.camera)
        found = self._registrar.register(grey_codes(frame.image), frame.valid, near, guesses)
        pose = found.cam_from_model if found.verdict.state == ACCEPTED else None
        self._before = () if pose is None else (*self._before[-1:], pose)
        return found

    def checked_surface(self, candidates: Sequence[Candidate]) -> SurfaceCheck | None:
        """What accepted frames tell of the surface; ``None`` if they are too few, or too near to one another."""
        chosen = [candidates[at] for at in evenly(len(candidates), surface_check.MOST_FRAMES)]
        others = [
            PosedFrame(each.image.astype(np.float32) / 255, each.valid, self.camera, each.cam_from_model)
            for each in chosen
        ]
        source, *others = (small_frame(each, surface_check.LONGER_SIDE_PX) for each in (self.source, *others))
        return surface_check.check_surface(self.mesh, self.pivot_model, source, others)

    @contextmanager
    def frames(self, folder_or_video: Path, every: int = 1) -> Iterator[OpenedFrames]:
        """Open a folder of images or a video.

        A frame that cannot be read, and an image of other proportions than K's or a frame of another size than the
        film's first one, comes with its problem.

        Raises
        ------
        InputError
            No images, not a video, or one of other proportions than K's.
        """
        if folder_or_video.is_dir():
            paths = image_paths(folder_or_video)
            if not paths:
                raise InputError(f"{folder_or_video}: expected images ({', '.join(IMAGES)}) or a video, found none")
            chosen = list(enumerate(paths))[::every]
            yield OpenedFrames(len(chosen), (self._of_image(number, path) for number, path in chosen))
            return
        with Film(folder_or_video, every=every, width=self.camera.width) as film:
            self._case.camera.for_images(film.info.size_wh, folder_or_video.name)
            yield OpenedFrames(film.info.frames, self._of_film(film, every), film.info.cut_off)

    def full_frames(
        self,
        folder_or_video: Path,
        out: Path,
        chosen: Sequence[Candidate],
        mesh_from_model: np.ndarray,
        *,
        denoise: bool = False,
    ) -> tuple[UnreadFrame, ...]:
        """Write registered frames at full size into a folder, for a case, in their order.

        Raises
        ------
        RunError
            An image cannot be written.
        """
        poses, written = {each.number: each.cam_from_model for each in chosen}, dict[int, UnreadFrame]()
        for number, image, shown in self._full_images(folder_or_video, poses):
            size_wh = image.shape[1], image.shape[0]
            clean = denoised(image, shown)[0] if denoise else None
            image = image if clean is None else clean
            data = encode_png(np.dstack([image, np.where(shown, 255, 0).astype(np.uint8)]))
            # a case may name another film's frame of this number
            path = content_named(out / FRAME.format(number), data)
            write_output(path, data)
            own = self._case.camera.for_images(size_wh, folder_or_video.name)
            pose = poses[number] @ inverse_rigid(mesh_from_model)
            written[number] = UnreadFrame(path, own, self._case.distortion, pose)
        return tuple(written[number] for number in poses)

    def _full_images(self, frames: Path, numbers: Collection[int]) -> Iterator[tuple[int, np.ndarray, np.ndarray]]:
        if not numbers:
            return
        if frames.is_dir():
            paths = image_paths(frames)
            for number in sorted(numbers):
                image, valid = read_image(paths[number], paths[number].name)
                yield number, to_uint8(image), valid
            return
        with Film(frames, width=self._case.camera.width) as film:
            for each in film:
                if each.index in numbers:
                    yield each.index, each.image, np.ones(each.image.shape[:2], bool)

    def _of_film(self, film: Film, every: int) -> Iterator[FurtherFrame]:
        due = 0
        for each in film:
            yield from (self._unusable("", number, film.problem(number)) for number in range(due, each.index, every))
            yield self._undistorted("", each.index, each.image)
            due = each.index + every
        rest = range(due, film.info.frames * every, every)
        yield from (self._unusable("", number, film.problem(number)) for number in rest)

    def _of_image(self, number: int, path: Path) -> FurtherFrame:
        try:
            image, valid = read_image(path, path.name)
            self._case.camera.for_images((image.shape[1], image.shape[0]), path.name)
        except InputError as error:
            return self._unusable(path.name, number, str(error).removeprefix(f"{path.name}: "))
        small = cv2.resize(image, self.camera.size_wh, interpolation=cv2.INTER_AREA)
        frame = self._undistorted(path.name, number, to_uint8(small))
        shown = cv2.resize(valid.astype(np.float32), self.camera.size_wh, interpolation=cv2.INTER_AREA) > 0.99
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


class RegistrationRun:
    """Registers frames one after the other, and keeps what each tells alone, and what all tell together.

    Attributes
    ----------
    alone
        Number of a frame -> what was found in it, without the fit.
    """

    def __init__(self, registrar: CaseRegistrar, candidates: Candidates, *, is_film: bool) -> None:
        """Begin without frames; ``candidates`` collect those that may check and colour the surface."""
        self._registrar, self._candidates, self._is_film = registrar, candidates, is_film
        self._agreement = FilmAgreement(registrar.camera, registrar.cam_from_model, registrar.pivot_model)
        self.alone = dict[int, RegisteredFrame]()

    def register(self, frame: FurtherFrame) -> RegisteredFrame:
        """Register the next frame, see :meth:`CaseRegistrar.register`."""
        found = self._registrar.register(frame)
        self._candidates.add(frame.number, frame.image, frame.valid, found)
        if self._is_film and found.fit is not None and found.verdict.state == ACCEPTED:
            self._agreement.add(frame.number, found.fit)
        self.alone[frame.number] = replace(found, fit=None)
        return found

    def judged(self) -> dict[int, RegisteredFrame]:
        """The frames, judged together."""
        return dict(zip(self.alone, judged_together(list(self.alone.values())), strict=True))

    def change(self) -> FilmChange | None:
        """What a film no longer shows as the case's frame does."""
        return self._agreement.change()


def marked(frames: Mapping[int, RegisteredFrame], change: FilmChange | None) -> dict[int, RegisteredFrame]:
    """The frames by their numbers, those marked that no longer show what the case's frame shows."""
    since = np.inf if change is None else change.since
    return {number: replace(each, changed=each.changed or number >= since) for number, each in frames.items()}


def colouring_frames(candidates: Candidates, judged: Mapping[int, RegisteredFrame]) -> list[Candidate]:
    """The candidates that are accepted, and show the surface as the case's frame does."""
    poses = accepted_poses(judged)
    return [each for each in candidates.frames if each.number in poses]


def accepted_poses(found: Mapping[int, RegisteredFrame]) -> dict[int, np.ndarray]:
    """The poses ``cam_from_model`` of accepted frames that show what the case's frame shows, by number."""
    return {
        number: each.cam_from_model
        for number, each in found.items()
        if each.verdict.state == ACCEPTED and each.cam_from_model is not None and not each.changed
    }


def doubt_of_case(loaded: LoadedCase) -> str:
    """A sentence if the case's own pose is too unsure for any frame to be accepted; empty otherwise."""
    surface, pose = loaded.surface, loaded.frame.cam_from_model
    own = PoseUncertainty.stated(loaded.case.alignment, surface.mesh.vertices, pose, surface.mesh_from_model)
    return "" if own is None else doubt_of_source(own, loaded.frame.camera.within(LONGER_SIDE_PX))


def _own_uncertainty(loaded: LoadedCase, view: ReferenceView) -> PoseUncertainty | None:
    """How sure the case's pose is, if the case states it, about the pivot: the middle of what the frame shows."""
    pose = loaded.frame.cam_from_model
    own = PoseUncertainty.stated(loaded.case.alignment, view.view.shown_points(), pose, loaded.surface.mesh_from_model)
    return None if own is None else own.about(view.pivot_model, pose)


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
    image = cv2.resize(frame.image, camera.size_wh, interpolation=cv2.INTER_AREA)
    valid = cv2.resize(frame.valid.astype(np.float32), camera.size_wh, interpolation=cv2.INTER_AREA) > 0.99
    return replace(frame, image=image, valid=valid, camera=camera)
