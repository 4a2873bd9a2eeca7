"""Register further frames to a case, and write what comes of it into a folder; and draw the film of a video."""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from ..case.case_history import history_path
from ..case.case_writer import relative_name
from ..case.frame import UnreadFrame
from ..case.loaded_case import LoadedCase, overlay_scene
from ..case.pose_record import PoseRecord
from ..errors import InputError
from ..files.content import content_named
from ..files.outputs import write_output, writing
from ..images.legend import Write
from ..images.overlay import draw_overlay
from ..images.png import encode_png
from ..overlay.overlay_film import FrameMark, OverlayFilm
from ..transforms import inverse_rigid
from ..video.film_reader import Film
from .colouring_frames import colouring_frames
from .further_frames import CAMERA, ListedImage, listed_images
from .pose_list import POSES, encoded_list, pose_entry
from .register import RegisteredFrame, Registrar, RegistrationRun, accepted_poses, marked
from .verdict import ACCEPTED, COLOURS, DOUBTFUL, REFUSED, WITHIN_PX, FilmChange, Verdict

FILM, PAGE, CASE = "overlay.mp4", "registration.html", "case.toml"
FRAME = "frame_{:06d}.png"
"""Name of a film's frame that is written; :func:`.content_named` then."""
HISTORY = history_path(Path(CASE)).name
FILES = (POSES, FILM, PAGE, CASE)
NAMES = "|".join([*map(re.escape, (*FILES, HISTORY)), r"frame_\d+-[0-9a-f]{8}\.png"])
"""Regular expression of the files that the folder may hold."""
PICTURES, PICTURE_PX, WEBP = 240, 480, 75
"""How many frames have a picture as evidence, of all and where the state changes, and its width and quality."""
STRUCTURE_POINTS = 200
OPACITY = {ACCEPTED: (0.5, 1.0), DOUBTFUL: (0.2, 0.4), REFUSED: (0.0, 0.0)}
"""Least and greatest opacity of an overlay."""


@dataclass(frozen=True)
class FrameEvidence:
    """What is known of a frame.

    Attributes
    ----------
    name, number
        That of an image's file, and counted from 0; a frame of a video has no name.
    registered
        Verdict, pose and its uncertainty.
    image_px
        Root mean square displacement of what is drawn, in the image that was registered; NaN without a pose.
    picture
        The frame with the overlay as WebP; ``None`` if none was kept.
    """

    name: str
    number: int
    registered: RegisteredFrame
    image_px: float = np.nan
    picture: bytes | None = None

    @property
    def verdict(self) -> Verdict:
        """State, probability and reason."""
        return self.registered.verdict

    @property
    def opacity(self) -> float:
        """The opacity of the overlay, 0..1: the less sure the fainter, none without a pose."""
        posed = self.registered.cam_from_model is not None
        sure = self.verdict.probability * (1 - 2 * self.image_px / WITHIN_PX) if posed else 0.0
        return float(np.clip(sure, *OPACITY[self.verdict.state]))

    @property
    def words(self) -> str:
        """State and reason."""
        return f"{self.name or f'frame {self.number}'}, {self.verdict.state}: {self.verdict.reason}"


@dataclass(frozen=True)
class RegistrationEvidence:
    """What was found in all frames.

    Attributes
    ----------
    frames
        In their order.
    image
        ``(H, W, 3)`` the case's frame as it was registered, 0..1.
    alignment
        The record of the case's pose.
    is_film
        Whether the frames follow each other.
    change
        What a film no longer shows as the case's frame does, if anything.
    cut_off
        A sentence if the film is cut off, else empty.
    colouring, colouring_lines
        The frames that colour the surface too, for the case; and sentences on their choice.
    """

    frames: tuple[FrameEvidence, ...]
    image: np.ndarray
    alignment: PoseRecord
    is_film: bool
    change: FilmChange | None = None
    cut_off: str = ""
    colouring: tuple[UnreadFrame, ...] = ()
    colouring_lines: tuple[str, ...] = ()

    @property
    def counts(self) -> dict[str, int]:
        """State -> number of frames."""
        states = [frame.verdict.state for frame in self.frames]
        return {state: states.count(state) for state in COLOURS}


def register_case(
    registrar: Registrar,
    frames: Path,
    out: Path,
    *,
    every: int = 1,
    colour_frames: int = 0,
    progress: Callable[[float], None],
) -> RegistrationEvidence:
    """Register all frames of a folder, a list or a video, and write their poses into a folder.

    Parameters
    ----------
    registrar
        Of the case at its pose, with the structures to draw.
    frames
        Folder or list of images, or a video.
    out
        Folder to write.
    every
        Take every n-th frame.
    colour_frames
        Choose so many accepted frames, at most, to colour the surface with.
    progress
        Called with the finished share, 0..1.
    """
    loaded, images = registrar.loaded, listed_images(frames)
    is_film = images is None
    run, names, usable = RegistrationRun(registrar, is_film=is_film), dict[int, str](), False
    drawing, pictures, state, spare = _Drawing(registrar), dict[int, bytes](), "", PICTURES
    with registrar.reader.opened(frames, every) as opened:
        step = -(-opened.count // PICTURES)
        for frame in opened.frames:
            registered, usable = run.register(frame), usable or not frame.problem
            changed = spare > 0 and registered.verdict.state != state
            state, spare = registered.verdict.state, spare - changed
            if changed or len(names) % step == 0:
                pictures[frame.number] = drawing.picture(frame.image, registered.cam_from_model)
            names[frame.number] = frame.name
            progress(len(names) / opened.count)
    if not names:
        raise InputError(f"{frames.name}: expected frames, cannot decode any; copy it again")
    if not usable:
        number, name = next(iter(names.items()))
        reason = run.alone[number].verdict.reason
        raise InputError(f"{name or frames.name}: {reason}; nor can any other frame be used")
    change = run.change()
    judged = marked(run.judged(), change)
    evidence = tuple(
        FrameEvidence(name, number, judged[number], drawing.displaced_px(judged[number]), pictures.get(number))
        for number, name in names.items()
    )
    _write_lists(loaded, images, out, evidence)
    poses, chosen, lines = accepted_poses(judged), list[int](), list[str]()
    if colour_frames:
        candidates = [(each, poses[each.number]) for each in run.accepted(judged)]
        chosen, lines = colouring_frames(registrar.mesh, registrar.case_view, candidates, colour_frames)
    colouring = _unread_frames(loaded, images or frames, out, {number: poses[number] for number in chosen})
    return RegistrationEvidence(
        evidence, registrar.case_view.image, loaded.case.alignment, is_film, change, opened.cut_off,
        colouring, tuple(lines),
    )  # fmt: skip


def marked_film(loaded: LoadedCase, film: Film, evidence: Sequence[FrameEvidence], write: Write) -> OverlayFilm:
    """The film with the overlay of each frame that has a pose, fainter where it is less sure; others are marked."""
    poses: list[np.ndarray | None] = [None] * (max(each.number for each in evidence) + 1)
    marks = dict[int, FrameMark]()
    for each in evidence:
        poses[each.number] = each.registered.cam_from_model
        sure = each.verdict.state == ACCEPTED
        codes, words = (None, "") if sure else (COLOURS[each.verdict.state], each.words)
        marks[each.number] = FrameMark(each.opacity, codes, words)
    return OverlayFilm(loaded, film, poses, write, marks=marks)


def _write_lists(
    loaded: LoadedCase, images: Sequence[ListedImage] | None, out: Path, evidence: Sequence[FrameEvidence]
) -> None:
    """Write the lists of poses, after removing what shows other ones."""
    surface, mm_per_unit, entries = loaded.surface, loaded.case.mm_per_unit, []
    for each in evidence:
        # as in a list of photographs: from the folder of the list
        listed = images[each.number] if images else None
        image = relative_name(listed.path, out) if listed else ""
        entry = pose_entry(image, each.number, each.registered, surface.mesh_from_model, mm_per_unit)
        own = {CAMERA: relative_name(listed.camera_file, out)} if listed and listed.camera else {}
        entries.append(entry | own)
    for name in (FILM, PAGE):
        with writing(out / name):
            (out / name).unlink(missing_ok=True)
    write_output(out / POSES, encoded_list(entries))


def _unread_frames(
    loaded: LoadedCase, frames: Sequence[ListedImage] | Path, out: Path, poses: Mapping[int, np.ndarray]
) -> tuple[UnreadFrame, ...]:
    """Registered frames at full size, for a case: images where they are, those of a film written into a folder."""
    case, mesh_from_model = loaded.case, loaded.surface.mesh_from_model
    listed = {} if isinstance(frames, Path) else dict(enumerate(frames))
    if poses and isinstance(frames, Path):
        with Film(frames, width=case.camera.width) as film:
            for each in film:
                if each.index in poses:
                    data = encode_png(each.image)
                    # a case may name another film's frame of this number
                    listed[each.index] = ListedImage(content_named(out / FRAME.format(each.index), data))
                    write_output(listed[each.index].path, data)
    found = ((listed[number], pose @ inverse_rigid(mesh_from_model)) for number, pose in poses.items())
    return tuple(UnreadFrame(each.path, *each.lens(case, each.size_wh), pose) for each, pose in found)


class _Drawing:
    """Draws frames with the overlay at their poses, and says how sure the place of what is drawn is."""

    def __init__(self, registrar: Registrar) -> None:
        self._scene, self._camera = overlay_scene(registrar.loaded), registrar.camera
        meshes = [mesh.vertices for _, mesh in registrar.loaded.surface.structures]
        some = [each[:: max(1, len(each) // STRUCTURE_POINTS)] for each in meshes]
        self._drawn_points = np.concatenate(some) if some else None

    def displaced_px(self, registered: RegisteredFrame) -> float:
        """The standard deviation of the place of structures, or of the surface where there are none, px."""
        pose, uncertainty = registered.cam_from_model, registered.uncertainty
        if pose is None or uncertainty is None:
            return np.nan
        points = uncertainty.points_around if self._drawn_points is None else self._drawn_points
        return uncertainty.root_mean_square_px(points, self._camera, pose)

    def picture(self, image: np.ndarray, pose: np.ndarray | None) -> bytes:
        """A frame ``(H, W, 3)`` uint8 as WebP."""
        if pose is not None:
            surface = self._scene.surface_layer(self._camera, pose)
            image = draw_overlay(image.copy(), surface, self._scene.layers(self._camera, pose))
        size_wh = PICTURE_PX, round(PICTURE_PX * image.shape[0] / image.shape[1])
        small = cv2.resize(image, size_wh, interpolation=cv2.INTER_AREA)
        return cv2.imencode(".webp", small[..., ::-1], [cv2.IMWRITE_WEBP_QUALITY, WEBP])[1].tobytes()
