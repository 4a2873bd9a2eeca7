"""What registration has found of a film's frames: kept beside the case that it began with, as a list of poses.

The file's name has a digest of all that the poses go by: the film, and the case's K, surface and pose. So they are
found again when the case is opened or its pose comes back, and never taken for those of another one.
"""

import os
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import astuple, dataclass, field
from functools import lru_cache
from hashlib import sha256
from pathlib import Path
from typing import NamedTuple

import bpy
import numpy as np

from ..class_registration import at_end, listening
from ..pipeline.camera.distortion import Distortion
from ..pipeline.camera.pinhole import PinholeCamera
from ..pipeline.case.case_file import MM_PER_UNIT, Case, read_case
from ..pipeline.case.pose_record import UNKNOWN, PoseRecord
from ..pipeline.errors import InputError
from ..pipeline.files.content import LARGEST_FILE, read_content
from ..pipeline.files.outputs import writing
from ..pipeline.files.tables import parsed_json
from ..pipeline.files.writing import write_bytes_atomically
from ..pipeline.registration.pose_list import encoded_list, pose_entry, registered_of, registration_record
from ..pipeline.registration.register import RegisteredFrame, Registrar, RegistrationRun, marked
from ..pipeline.registration.verdict import ACCEPTED, DOUBTFUL, REFUSED, FilmChange, Verdict
from ..setup.alignment_record import pose_record, tool_and_date
from ..setup.queued import present, queue_of
from ..state import frame_in_view, from_scene, scene_files
from ..state.frame_in_view import FrameInView
from ..state.scene_files import Stamp, forget_stamps, known_stamp, recent
from ..video import session, shown_frame
from ..video.session import FilmSession

WORDS = {ACCEPTED: "found", DOUBTFUL: "doubtful", REFUSED: "lost"}
WRITTEN_EVERY_S = 2.0
"""So much of a run is lost at most, if Blender is killed."""


class AlignedFrame(NamedTuple):
    """The aligned frame by which others are found: its name, the record of its pose, and surface and units."""

    name: str
    record: PoseRecord
    mesh_from_model: np.ndarray
    mm_per_unit: float


@dataclass
class FilmPoses:
    """The frames of a film that are registered so far.

    Attributes
    ----------
    reference
        By which they are.
    file
        Where they are kept; ``None`` before the case has a file, or where none can be written.
    frames
        Number in the film -> what was found, without the fit.
    change
        What the film no longer shows as the case's frame does.
    """

    reference: AlignedFrame
    file: Path | None
    frames: dict[int, RegisteredFrame] = field(default_factory=dict)
    change: FilmChange | None = None

    def register(self, registrar: Registrar, film: FilmSession, progress: Callable[[float], None]) -> None:
        """Register the scored frames that are not yet, or all again, in any thread; however it ends, they are kept."""
        numbers = {score.index for score in film.scores.frames}
        left = numbers - self.frames.keys() or numbers
        run, written_s = RegistrationRun(registrar, is_film=True), time.monotonic()
        try:
            with registrar.reader.opened(film.path) as opened:
                for frame in opened.frames:
                    if frame.number not in left:
                        continue
                    run.register(frame)
                    self.frames[frame.number] = run.alone[frame.number]
                    progress(len(run.alone) / len(left))
                    # a long list takes long to judge and to write
                    if (began_s := time.monotonic()) - written_s > WRITTEN_EVERY_S:
                        self.frames |= run.judged()
                        self.write()
                        written_s = time.monotonic() + 20 * (time.monotonic() - began_s)
            self.change = run.change()
        finally:
            self.frames |= marked(self.frames | run.judged(), self.change)
            self.write()

    def write(self) -> None:
        """Keep them in their file."""
        if self.file is None or not self.frames:
            return
        reference, frames = self.reference, sorted(self.frames.items())
        entries = [
            pose_entry("", number, each, reference.mesh_from_model, reference.mm_per_unit) for number, each in frames
        ]
        with writing(self.file):
            write_bytes_atomically(self.file, encoded_list(entries))

    def summary(self) -> str:
        """How many frames are found, doubtful and lost."""
        states = [each.verdict.state for each in [*self.frames.values()]]
        counts = ", ".join(f"{states.count(state)} {word}" for state, word in WORDS.items())
        return counts if self.change is None else f"{counts}; {self.change.words()}"


_known: dict[tuple[str, bytes], FilmPoses] = {}
"""Digest, and mesh_from_model -> what is found in this session or read."""


class _Place(NamedTuple):
    """Where what is found by a frame at its pose is kept: its digest, and the file if its case has one."""

    digest: str
    file: Path | None


def of(scene: bpy.types.Scene) -> FilmPoses | None:
    """What is found in the scene's film from the present pose of the case's frame, or by another frame of its queue."""
    film = session.of(scene)
    if film is None:
        return None
    try:
        own, mesh_from_model = _own_place(scene, film), from_scene.mesh_from_model_of(from_scene.surface_of(scene))
        if poses := _poses_at(own, mesh_from_model, lambda: _own_reference(scene, mesh_from_model)):
            return poses
        cases = (_case_at(path, known_stamp(path)) for path in _other_cases(scene))
        others = (_found_by(case, film, _counts(scene), mesh_from_model) for case in cases if case is not None)
        return next(filter(None, others), None)
    except InputError:
        return None


def film_of_case(scene: bpy.types.Scene) -> Path | None:
    """The film of the case's frame, by its name: beside the frame or the case, in a folder above, or where it was."""
    video = from_scene.video(scene)
    if video is None:
        return None
    image, case = from_scene.absolute_path(scene.oneframe.frame_path), present(scene)
    folders = [image.parent, *([case.parent, *case.parents[1:3]] if case is not None else [])]
    places = (*(folder / video[0] for folder in folders), *(path for path in recent("films") if path.name == video[0]))
    return next((path for path in places if known_stamp(path) != (0, 0)), None)


def begun(scene: bpy.types.Scene, film: FilmSession) -> FilmPoses:
    """What is found from the present pose of the case's frame, to be continued."""
    place, mesh_from_model = _own_place(scene, film), from_scene.mesh_from_model_of(from_scene.surface_of(scene))
    poses = _poses_at(place, mesh_from_model, lambda: _own_reference(scene, mesh_from_model))
    if poses is None:
        poses = FilmPoses(_own_reference(scene, mesh_from_model), None)
        _known[place.digest, mesh_from_model.tobytes()] = poses
    poses.file = _writable(poses.file or place.file)
    return poses


def frame_at(scene: bpy.types.Scene, at: int) -> RegisteredFrame | None:
    """What is found in the frame at a position in the film's list of scores; ``None`` if it is not registered."""
    film, registered = session.of(scene), of(scene)
    return None if film is None or registered is None else registered.frames.get(film.scores.frames[at].index)


def record_of(scene: bpy.types.Scene, number: int) -> PoseRecord:
    """The record of the pose that is found in a frame of the scene's film; an empty one without one."""
    film, registered = session.of(scene), of(scene)
    frame = None if registered is None else registered.frames.get(number)
    if film is None or registered is None or frame is None:
        return UNKNOWN
    camera = from_scene.camera(scene).for_images(film.scores.info.size_wh, film.path.name)
    reference = registered.reference
    return registration_record(
        frame, camera, reference.mesh_from_model, reference.record, reference.name, *tool_and_date()
    )


def text_of(verdict: Verdict) -> str:
    """A state in words, with the probability that the pose is right."""
    # 0.997 is not 100 %
    sure = "" if verdict.state == REFUSED else f", {int(100 * verdict.probability)} % sure"
    return f"{WORDS[verdict.state]}{sure}"


def _poses_at(place: _Place, mesh_from_model: np.ndarray, reference: Callable[[], AlignedFrame]) -> FilmPoses | None:
    key = place.digest, mesh_from_model.tobytes()
    if key not in _known:
        if place.file is None or known_stamp(place.file) == (0, 0):
            return None
        frames, own = {}, reference()
        # what is not of this version, or damaged, is registered anew
        with suppress(InputError, KeyError, TypeError, ValueError):
            entries = parsed_json(read_content(place.file, "a list of poses", most=LARGEST_FILE), place.file.name)
            frames = registered_of(entries, mesh_from_model, own.mm_per_unit)
        _known[key] = FilmPoses(own, place.file, frames)
    return _known[key] if _known[key].frames else None


def _other_cases(scene: bpy.types.Scene) -> list[Path]:
    """The cases of other frames in the queue: a file of the scene's own frame may have another pose than the scene."""
    path, image = present(scene), os.path.realpath(from_scene.absolute_path(scene.oneframe.frame_path))
    others = [(entry.path, entry.image) for entry in queue_of(scene) if entry.path != path]
    return [other for other, shown in others if shown is not None and os.path.realpath(shown) != image]


def _found_by(case: Case, film: FilmSession, counts: tuple[int, int], mesh_from_model: np.ndarray) -> FilmPoses | None:
    digest = _digest(film, counts, case.camera, case.distortion, case.cam_from_mesh)
    reference = AlignedFrame(case.image.name, case.alignment, mesh_from_model, case.mm_per_unit)
    return _poses_at(_Place(digest, _file_of(case.path, film, digest)), mesh_from_model, lambda: reference)


def _digest(
    film: FilmSession, counts: tuple[int, int], camera: PinholeCamera, lens: Distortion | None, pose: np.ndarray
) -> str:
    parts = film.digest, counts, astuple(camera), None if lens is None else astuple(lens), pose.tolist()
    return sha256(repr(parts).encode()).hexdigest()[:8]


def _counts(scene: bpy.types.Scene) -> tuple[int, int]:
    surface = from_scene.surface_of(scene)
    return len(surface.data.vertices), len(surface.data.polygons)


def _own_place(scene: bpy.types.Scene, film: FilmSession) -> _Place:
    camera, lens, pose = from_scene.camera(scene), from_scene.distortion(scene), from_scene.cam_from_mesh(scene)
    digest = _digest(film, _counts(scene), camera, lens, pose)
    if not scene.oneframe.case_path:
        return _Place(digest, None)
    return _Place(digest, _file_of(from_scene.absolute_path(scene.oneframe.case_path), film, digest))


def _file_of(case: Path, film: FilmSession, digest: str) -> Path:
    return case.with_name(f"{film.path.stem}_poses-{digest}.json")


def _writable(file: Path | None) -> Path | None:
    return file if file is not None and os.access(file.parent, os.W_OK) else None


def _own_reference(scene: bpy.types.Scene, mesh_from_model: np.ndarray) -> AlignedFrame:
    name, units = bpy.path.basename(scene.oneframe.frame_path), MM_PER_UNIT[scene.oneframe.units]
    return AlignedFrame(name, pose_record(scene), mesh_from_model, units)


@lru_cache(maxsize=1000)
def _case_at(path: Path, _stamp: Stamp) -> Case | None:
    """A case of the queue that has a pose."""
    try:
        return read_case(path)
    except InputError:
        return None


def _keep(scene: bpy.types.Scene) -> None:
    """Keep what is found beside the file that the case was saved to."""
    film = session.of(scene)
    if film is None:
        return
    place, mesh_from_model = _own_place(scene, film), from_scene.mesh_from_model_of(from_scene.surface_of(scene))
    poses, file = _known.get((place.digest, mesh_from_model.tobytes())), _writable(place.file)
    if poses is None or file is None:
        return
    # cases of a queue share them
    if poses.file is None or poses.file.parent.parent != file.parent.parent:
        poses.file = file
        poses.write()
        forget_stamps()


def _seen(scene: bpy.types.Scene) -> FrameInView | None:
    film = session.of(scene)
    # until the case has a frame, it is the film's
    if film is None or not shown_frame.is_shown(scene) or not scene.oneframe.frame_path:
        return None
    if from_scene.video(scene) == (film.path.name, film.score.index):
        return None
    name, frame = f"frame {film.score.index} of {film.path.name}", frame_at(scene, film.shown)
    if frame is None:
        return FrameInView(name, "not registered", None)
    return FrameInView(name, text_of(frame.verdict), frame.cam_from_model)


PARTS = (
    listening(frame_in_view.lookups, _seen),
    listening(scene_files.saved, _keep),
    at_end(_known.clear, _case_at.cache_clear),
)
