"""Register further frames to a case, and write their poses, a sheet of the frames, and of a video a film."""

import re
from collections.abc import Callable, Sequence
from dataclasses import astuple, dataclass, replace
from itertools import count as counted
from pathlib import Path

import cv2
import numpy as np

from ...case.case_history import history_path
from ...case.case_writer import relative_name
from ...case.loaded_case import LoadedCase
from ...case.posed_frame import UnreadFrame
from ...errors import InputError
from ...files.content import write_bytes_atomically
from ...files.outputs import check_own_folder, made_folder, writing
from ...images.contact_sheet import contact_sheet
from ...images.legend import put_border
from ...images.overlay import draw_overlay
from ...images.pixel_values import to_uint8
from ...images.png import encode_png
from ...projection.overlay_scene import OverlayScene
from ...registration.colour_sources import Candidates, chosen_sources
from ...registration.register import RegisteredFrame, judged_together
from ...registration.report import (
    COLOURS,
    ESTIMATES,
    POSES,
    FrameEvidence,
    RegistrationEvidence,
    frame_evidence,
    pose_entry,
    write_poses,
)
from ...registration.verdict import ACCEPTED, FilmAgreement
from ...video.film_reader import WIDEST, Film
from ..alignment.overlay_film import FrameMark, OverlayFilm
from ..alignment.overlay_picture import overlay_scene
from ..case.load_case import DISTORTION
from ..render.lettering import text_mask
from .register_frames import FRAME_NAMES, CaseRegistrar, FurtherFrame, frame_files

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
    """What was found.

    Attributes
    ----------
    evidence
        Of each frame.
    sources
        The frames to colour the surface with.
    """

    evidence: RegistrationEvidence
    sources: tuple[UnreadFrame, ...] = ()


def register_case(
    loaded: LoadedCase,
    source: Path,
    out: Path,
    *,
    every: int = 1,
    colour_frames: int = 0,
    denoise: bool = False,
    progress: Callable[[int, int], None],
) -> Registration:
    """Register all frames of a folder or a video, and write the files into a folder.

    Parameters
    ----------
    loaded
        The case at its pose, with the structures to draw.
    source
        Folder of images, or a video.
    out
        Folder to write.
    every
        Take every n-th frame.
    colour_frames
        Choose so many accepted frames, at most, to colour the surface with.
    denoise
        Remove noise from these, see :mod:`oneframe.video.denoise`.
    progress
        Called with the number of finished steps and of all: a frame is one, and another one in the film.

    Raises
    ------
    InputError
        The case or the frames cannot be used, or none of them can be read.
    RunError
        A file cannot be written.
    """
    check_own_folder(out, NAMES, loaded.case.input_files() | frame_files(source))
    registrar = CaseRegistrar(loaded)
    scene, drawn = overlay_scene(loaded), _drawn_points(loaded)
    registered, images, tiles = list[RegisteredFrame](), list[str](), dict[int, np.ndarray]()
    evidence, candidates = list[FrameEvidence](), Candidates()
    agreement = FilmAgreement(registrar.camera, registrar.cam_from_model, registrar.pivot_model)
    surface, units = loaded.surface, loaded.case.mm_per_unit
    steps, spare, usable = 1 if source.is_dir() else 2, PICTURES, False
    with registrar.frames(source, every) as (count, frames):
        shown_every, kept_every = -(-count // SHEET_FRAMES), -(-count // PICTURES)
        for done, frame in enumerate(frames):
            found, usable = registrar.register(frame), usable or not frame.problem
            # as in a list of photographs: from the folder of the list
            images.append(relative_name(source / frame.name, out) if frame.name else "")
            registered.append(replace(found, fit=None))
            if found.fit is not None and found.verdict.state == ACCEPTED and not source.is_dir():
                agreement.add(frame.number, found.fit)
            if colour_frames:
                candidates.add(frame.number, frame.image, frame.valid, found)
            picture = None
            in_sheet = done % shown_every == 0
            changed = spare > 0 and (not evidence or evidence[-1].verdict.state != found.verdict.state)
            if in_sheet or changed or done % kept_every == 0:
                tile = _tile(frame, found, scene, registrar)
                picture = _webp(tile)
                tiles |= {done: tile} if in_sheet else {}
                spare -= changed
            points = drawn if len(drawn) or found.fit is None else found.fit.points_model
            evidence.append(frame_evidence(frame.name, frame.number, found, registrar.camera, points, picture))
            progress(done + 1, steps * count)
    if not registered:
        raise InputError(f"{source.name}: expected frames, cannot decode any; copy it again")
    if not usable:
        one = evidence[0]
        raise InputError(f"{one.name or source.name}: {one.verdict.reason}; nor can any other frame be used")
    registered = judged_together(registered)
    evidence = [each.judged(found) for each, found in zip(evidence, registered, strict=True)]
    change = agreement.change()
    since = np.inf if change is None else change.since
    accepted = {each.number for each in evidence if each.verdict.state == ACCEPTED and each.number < since}
    colouring = [each for each in candidates.frames if each.number in accepted]
    entries = [
        pose_entry(image, each.number, found, surface.mesh_from_model, units)
        for image, each, found in zip(images, evidence, registered, strict=True)
    ]
    if images[0] and loaded.case.distortion is not None:
        entries = [entry | {DISTORTION: astuple(loaded.case.distortion)} for entry in entries]
    made_folder(out / POSES)
    for name in (ESTIMATES, SHEET, FILM, PAGE):
        # what shows other poses
        with writing(out / name):
            (out / name).unlink(missing_ok=True)
    write_poses(out, entries, units)
    for done, tile in tiles.items():
        put_border(tile, COLOURS[evidence[done].verdict.state], "", text_mask)
    shown = [tile.astype(np.float32) / 255 for tile in tiles.values()]
    sheet = contact_sheet(shown, columns=COLUMNS, tile_width=TILE_PX)
    with writing(out / SHEET):
        write_bytes_atomically(out / SHEET, encode_png(to_uint8(sheet)))
    cut_off = ""
    if not source.is_dir():

        def drawn_film(share: float) -> None:
            progress(int((1 + share) * count), 2 * count)

        cut_off = _write_film(loaded, source, out / FILM, evidence, every, drawn_film)
    choice = chosen_sources(registrar.mesh, registrar.source, colouring, colour_frames) if colour_frames else None
    chosen = [] if choice is None else [each.candidate for each in choice.frames]
    sources = registrar.full_frames(source, out, chosen, surface.mesh_from_model, denoise=denoise)
    known = RegistrationEvidence(
        tuple(evidence),
        registrar.mesh,
        registrar.source,
        registrar.pivot_model,
        loaded.case.alignment or {},
        is_film=not source.is_dir(),
        change=change,
        colour=choice,
        cut_off=cut_off,
    )
    return Registration(known, sources)


def _drawn_points(loaded: LoadedCase) -> np.ndarray:
    """``(N, 3)`` some points of the structures, model frame."""
    meshes = (mesh.vertices for _, mesh in loaded.surface.structures)
    return np.concatenate([np.zeros((0, 3)), *(each[:: max(1, len(each) // STRUCTURE_POINTS)] for each in meshes)])


def _write_film(
    loaded: LoadedCase,
    source: Path,
    out: Path,
    evidence: Sequence[FrameEvidence],
    every: int,
    progress: Callable[[float], None],
) -> str:
    """The film with the overlay of each frame that has a pose, fainter where it is less sure; others are marked.

    Returns a sentence if the film is cut off, else an empty one.
    """
    with Film(source, every=every, width=WIDEST) as film:
        poses: list[np.ndarray | None] = [None] * (max(each.number for each in evidence) + 1)
        marks = dict[int, FrameMark]()
        for each in evidence:
            poses[each.number] = each.cam_from_model
            sure = each.verdict.state == ACCEPTED
            codes, words = (None, "") if sure else (COLOURS[each.verdict.state], each.words(each))
            marks[each.number] = FrameMark(each.opacity, codes, words)
        drawing, written = OverlayFilm(loaded, film, poses, explained=True, marks=marks), counted(1)
        drawing.write(out, lambda: progress(next(written) / drawing.count))
        return film.info.cut_off


def _webp(tile: np.ndarray) -> bytes:
    size_wh = PICTURE_PX, round(PICTURE_PX * tile.shape[0] / tile.shape[1])
    small = cv2.resize(tile, size_wh, interpolation=cv2.INTER_AREA)
    return cv2.imencode(".webp", small[..., ::-1], [cv2.IMWRITE_WEBP_QUALITY, WEBP])[1].tobytes()


def _tile(frame: FurtherFrame, found: RegisteredFrame, scene: OverlayScene, registrar: CaseRegistrar) -> np.ndarray:
    """``(h, w, 3)`` uint8: the frame with the overlay at its pose."""
    picture = frame.image.copy()
    if found.cam_from_model is not None:
        camera, pose = registrar.camera, found.cam_from_model
        picture = draw_overlay(picture, scene.surface_layer(camera, pose), scene.layers(camera, pose))
    return picture
