"""Register further frames to a case, and write their poses and a sheet of the frames; and draw the film of a video."""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import astuple, dataclass
from pathlib import Path

import cv2
import numpy as np

from ..case.case_history import history_path
from ..case.case_writer import relative_name
from ..case.frame import UnreadFrame
from ..case.loaded_case import LoadedCase, overlay_scene
from ..errors import InputError
from ..files.outputs import check_own_folder, write_output, writing
from ..images.contact_sheet import contact_sheet
from ..images.legend import Write, put_border
from ..images.overlay import draw_overlay
from ..images.pixel_values import to_uint8
from ..images.png import encode_png
from ..overlay.overlay_film import FrameMark, OverlayFilm
from ..video.film_reader import Film
from .colour_sources import Candidates, chosen_sources
from .pose_list import DISTORTION, ESTIMATES, POSES, pose_entry, write_poses
from .register import RegisteredFrame
from .register_frames import (
    FRAME_NAMES,
    CaseRegistrar,
    FurtherFrame,
    RegistrationRun,
    colouring_frames,
    frame_files,
    marked,
)
from .report import COLOURS, FrameEvidence, RegistrationEvidence, frame_evidence
from .verdict import ACCEPTED

SHEET, FILM, PAGE, CASE = "frames.png", "overlay.mp4", "registration.html", "case.toml"
HISTORY = history_path(Path(CASE)).name
NAMES = "|".join([*map(re.escape, (POSES, ESTIMATES, SHEET, FILM, PAGE, CASE, HISTORY)), FRAME_NAMES])
"""Regular expression of the files that the folder may hold."""
SHEET_FRAMES, COLUMNS, TILE_PX = 24, 4, 320
PICTURES, PICTURE_PX, WEBP = 240, 480, 75
"""How many frames have a picture as evidence, of all and where the state changes, and its width and quality."""
STRUCTURE_POINTS = 200


@dataclass(frozen=True)
class Registration:
    """What was found: the evidence of each frame, and the frames to colour the surface with."""

    evidence: RegistrationEvidence
    sources: tuple[UnreadFrame, ...] = ()


def register_case(
    registrar: CaseRegistrar,
    frames: Path,
    out: Path,
    *,
    every: int = 1,
    colour_frames: int = 0,
    denoise: bool = False,
    progress: Callable[[float], None],
) -> Registration:
    """Register all frames of a folder or a video, and write their poses and the sheet into a folder.

    Parameters
    ----------
    registrar
        Of the case at its pose, with the structures to draw.
    frames
        Folder of images, or a video.
    out
        Folder to write.
    every
        Take every n-th frame.
    colour_frames
        Choose so many accepted frames, at most, to colour the surface with.
    denoise
        Remove noise from these, see :func:`oneframe.video.frame_measures.denoised`.
    progress
        Called with the finished share, 0..1.

    Raises
    ------
    InputError
        The case or the frames cannot be used, or none of them can be read.
    RunError
        A file cannot be written.
    """
    loaded, is_film, candidates = registrar.loaded, not frames.is_dir(), Candidates()
    check_own_folder(out, NAMES, loaded.case.input_files() | frame_files(frames))
    run = RegistrationRun(registrar, candidates, is_film=is_film)
    evidence, drawn, usable = list[FrameEvidence](), _drawn_points(loaded), False
    with registrar.frames(frames, every) as opened:
        pictures = _Pictures(loaded, registrar, opened.count)
        for done, frame in enumerate(opened.frames):
            found, usable = run.register(frame), usable or not frame.problem
            points = drawn if len(drawn) or found.fit is None else found.fit.points_model
            picture = pictures.of(done, frame, found)
            evidence.append(frame_evidence(frame.name, frame.number, found, registrar.camera, points, picture))
            progress((done + 1) / opened.count)
    if not evidence:
        raise InputError(f"{frames.name}: expected frames, cannot decode any; copy it again")
    if not usable:
        one = evidence[0]
        raise InputError(f"{one.name or frames.name}: {one.verdict.reason}; nor can any other frame be used")
    change = run.change()
    judged = marked(run.judged(), change)
    evidence = [each.judged(judged[each.number]) for each in evidence]
    _write_lists(loaded, frames, out, evidence, judged)
    colouring = colouring_frames(candidates, judged)
    check = registrar.checked_surface(colouring)
    doubt = [] if check is None or not check.words else [check.picture(registrar.source.image)]
    write_output(out / SHEET, pictures.sheet(evidence, doubt))
    choice = chosen_sources(registrar.mesh, registrar.source, colouring, colour_frames) if colour_frames else None
    chosen = [] if choice is None else [each.candidate for each in choice.frames]
    known = RegistrationEvidence(
        tuple(evidence),
        registrar.source,
        loaded.case.alignment,
        is_film=is_film,
        change=change,
        colour=choice,
        cut_off=opened.cut_off,
        surface=check,
    )
    return Registration(
        known, registrar.full_frames(frames, out, chosen, loaded.surface.mesh_from_model, denoise=denoise)
    )


def marked_film(loaded: LoadedCase, film: Film, evidence: Sequence[FrameEvidence], write: Write) -> OverlayFilm:
    """The film with the overlay of each frame that has a pose, fainter where it is less sure; others are marked."""
    poses: list[np.ndarray | None] = [None] * (max(each.number for each in evidence) + 1)
    marks = dict[int, FrameMark]()
    for each in evidence:
        poses[each.number] = each.cam_from_model
        sure = each.verdict.state == ACCEPTED
        codes, words = (None, "") if sure else (COLOURS[each.verdict.state], each.words(each))
        marks[each.number] = FrameMark(each.opacity, codes, words)
    return OverlayFilm(loaded, film, poses, write, marks=marks)


def _drawn_points(loaded: LoadedCase) -> np.ndarray:
    """``(N, 3)`` some points of the structures, model frame."""
    meshes = (mesh.vertices for _, mesh in loaded.surface.structures)
    return np.concatenate([np.zeros((0, 3)), *(each[:: max(1, len(each) // STRUCTURE_POINTS)] for each in meshes)])


def _write_lists(
    loaded: LoadedCase,
    frames: Path,
    out: Path,
    evidence: Sequence[FrameEvidence],
    judged: Mapping[int, RegisteredFrame],
) -> None:
    """Write the lists of poses, after removing what shows other ones."""
    entries = []
    for each in evidence:
        # as in a list of photographs: from the folder of the list
        image = relative_name(frames / each.name, out) if each.name else ""
        entries.append(
            pose_entry(image, each.number, judged[each.number], loaded.surface.mesh_from_model, loaded.case.mm_per_unit)
        )
    if frames.is_dir() and loaded.case.distortion is not None:
        entries = [entry | {DISTORTION: astuple(loaded.case.distortion)} for entry in entries]
    for name in (ESTIMATES, SHEET, FILM, PAGE):
        with writing(out / name):
            (out / name).unlink(missing_ok=True)
    write_poses(out, entries, loaded.case.mm_per_unit)


class _Pictures:
    """Draws pictures of frames as evidence, and a sheet of some of them."""

    def __init__(self, loaded: LoadedCase, registrar: CaseRegistrar, count: int) -> None:
        self._scene, self._camera = overlay_scene(loaded), registrar.camera
        self._sheet_every, self._every = -(-count // SHEET_FRAMES), -(-count // PICTURES)
        self._tiles, self._spare, self._state = dict[int, np.ndarray](), PICTURES, ""

    def of(self, place: int, frame: FurtherFrame, found: RegisteredFrame) -> bytes | None:
        """The frame at this place with the overlay at its pose, as WebP; ``None`` if none is kept."""
        in_sheet, changed = place % self._sheet_every == 0, self._spare > 0 and found.verdict.state != self._state
        self._state = found.verdict.state
        if not (in_sheet or changed or place % self._every == 0):
            return None
        self._spare -= changed
        tile, pose = frame.image.copy(), found.cam_from_model
        if pose is not None:
            surface = self._scene.surface_layer(self._camera, pose)
            tile = draw_overlay(tile, surface, self._scene.layers(self._camera, pose))
        if in_sheet:
            self._tiles[place] = tile
        size_wh = PICTURE_PX, round(PICTURE_PX * tile.shape[0] / tile.shape[1])
        small = cv2.resize(tile, size_wh, interpolation=cv2.INTER_AREA)
        return cv2.imencode(".webp", small[..., ::-1], [cv2.IMWRITE_WEBP_QUALITY, WEBP])[1].tobytes()

    def sheet(self, evidence: Sequence[FrameEvidence], further: Sequence[np.ndarray]) -> bytes:
        """The sheet as PNG, with the state of each frame as its border, and further ``(H, W, 3)`` tiles, 0..1."""
        for place, tile in self._tiles.items():
            put_border(tile, COLOURS[evidence[place].verdict.state])
        shown = [tile.astype(np.float32) / 255 for tile in self._tiles.values()]
        return encode_png(to_uint8(contact_sheet([*shown, *further], columns=COLUMNS, tile_width=TILE_PX)))
