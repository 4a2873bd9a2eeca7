"""Register further frames to a case, and write their poses, a sheet of the frames, and of a video a film."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...case.loaded_case import LoadedCase
from ...case.posed_frame import UnreadFrame
from ...errors import InputError
from ...files.content import write_bytes_atomically
from ...files.outputs import check_own_folder, made_folder, writing
from ...images.contact_sheet import contact_sheet
from ...images.overlay import draw_overlay
from ...images.pixel_values import to_uint8
from ...images.png import encode_png
from ...projection.overlay_scene import OverlayScene
from ...registration.colour_sources import Candidate, chosen_sources, hidden_blocks, sharpness
from ...registration.pose_list import ESTIMATES, POSES, pose_entry, write_poses
from ...registration.register import RegisteredFrame
from ...registration.verdict import ACCEPTED, DOUBTFUL, REFUSED
from ...video.film_reader import Film
from ..alignment.overlay_film import WIDEST, OverlayFilm
from ..alignment.overlay_picture import overlay_scene
from .register_frames import CaseRegistrar, FurtherFrame

SHEET, FILM, CASE = "frames.png", "overlay.mp4", "case.toml"
NAMES = "|".join((POSES, ESTIMATES, SHEET, FILM, CASE, r"frame_\d+.png")).replace(".", r"\.")
"""Regular expression of the files that the folder may hold."""
SHEET_FRAMES, COLUMNS, TILE_PX = 24, 4, 320
BORDER_PX = 6
COLOURS = {ACCEPTED: (70, 180, 90), DOUBTFUL: (230, 180, 40), REFUSED: (210, 60, 50)}
"""State of a frame -> colour of its border, sRGB."""


@dataclass(frozen=True)
class Registration:
    """What was found.

    Attributes
    ----------
    counts
        State -> number of frames.
    reasons
        Of the frames that are not accepted, with their names or numbers.
    sources
        The frames to colour the surface with.
    """

    counts: dict[str, int]
    reasons: tuple[tuple[str, str], ...]
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
        Called with the number of finished frames and of all.

    Raises
    ------
    InputError
        The case or the frames cannot be used, or none of them can be read.
    RunError
        A file cannot be written.
    """
    check_own_folder(out, NAMES)
    registrar = CaseRegistrar(loaded)
    scene = overlay_scene(loaded)
    entries, tiles, poses, candidates = [], [], {}, []
    with registrar.frames(source, every) as (count, frames):
        shown_every = -(-count // SHEET_FRAMES)
        for done, frame in enumerate(frames):
            found = registrar.register(frame)
            surface, units = loaded.surface, loaded.case.mm_per_unit
            entries.append(pose_entry(frame.name, frame.number, found, surface.mesh_from_model, units))
            if found.fit is not None and found.verdict.state == ACCEPTED:
                pose = poses[frame.number] = found.fit.cam_from_model
                if colour_frames:
                    hidden = hidden_blocks(found.fit)
                    candidates.append(Candidate(frame.number, pose, sharpness(frame.image), hidden))
            if done % shown_every == 0:
                tiles.append(_tile(frame, found, scene, registrar))
            progress(done + 1, count)
    if not entries:
        raise InputError(f"{source.name}: expected frames, cannot decode any; copy it again")
    made_folder(out / POSES)
    write_poses(out, entries, loaded.case.mm_per_unit)
    sheet = contact_sheet(tiles, columns=COLUMNS, tile_width=TILE_PX)
    with writing(out / SHEET):
        write_bytes_atomically(out / SHEET, encode_png(to_uint8(sheet)))
    if not source.is_dir() and every == 1:
        with Film(source, width=WIDEST) as film:
            track = [poses.get(number) for number in range(film.info.frames)]
            OverlayFilm(loaded, film, track, explained=True).write(out / FILM, lambda: None)
    counts = {state: sum(entry["state"] == state for entry in entries) for state in COLOURS}
    reasons = tuple(
        (str(entry.get("image", f"frame {entry['frame']}")), f"{entry['state']}: {entry['reason']}")
        for entry in entries
        if entry["state"] != ACCEPTED
    )
    sources: tuple[UnreadFrame, ...] = ()
    if candidates:
        mesh, camera, first = registrar.mesh, registrar.camera, registrar.cam_from_model
        chosen = chosen_sources(mesh, camera, first, candidates, colour_frames)
        listed = {each.number: each for each in candidates if each.number in chosen}
        mesh_from_model = loaded.surface.mesh_from_model
        sources = tuple(registrar.full_frames(source, out, listed, mesh_from_model, denoise=denoise))
    return Registration(counts, reasons, sources)


def _tile(frame: FurtherFrame, found: RegisteredFrame, scene: OverlayScene, registrar: CaseRegistrar) -> np.ndarray:
    """``(h, w, 3)`` float32: the frame with the overlay at its pose, in a border of its state's colour."""
    picture = frame.image.copy()
    if found.cam_from_model is not None:
        camera, pose = registrar.camera, found.cam_from_model
        picture = draw_overlay(picture, scene.surface_layer(camera, pose), scene.layers(camera, pose))
    colour = COLOURS[found.verdict.state]
    for part in (np.s_[:BORDER_PX], np.s_[-BORDER_PX:], np.s_[:, :BORDER_PX], np.s_[:, -BORDER_PX:]):
        picture[part] = colour
    return picture.astype(np.float32) / 255
