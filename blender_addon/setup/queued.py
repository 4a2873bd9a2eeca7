"""The queue that the scene's case is in: its cases with their states, as their files have them."""

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import bpy

from ..class_registration import at_end
from ..pipeline.case.case_file import read_case
from ..pipeline.case.case_folder import CASE
from ..pipeline.case.case_queue import queued_cases, state_of
from ..pipeline.errors import InputError
from ..state import from_scene
from ..state.scene_files import Stamp, known_stamp, usual_folder

FOLDER = "queue"
"""Of a queue that is begun, beside the present case."""


@dataclass(frozen=True)
class Queued:
    """A case of the queue: its file, those of its frame and surface, where the frame is from, and its state.

    Without files it is unreadable.
    """

    path: Path
    image: Path | None = None
    mesh: Path | None = None
    video: tuple[str, int] | None = None
    state: str = "unreadable"


def present(scene: bpy.types.Scene) -> Path | None:
    """The file of the scene's case."""
    known = scene.oneframe.case_path
    return from_scene.absolute_path(known) if known else None


def queue_of(scene: bpy.types.Scene) -> tuple[Queued, ...]:
    """The cases beside the scene's that have its surface, by name; none if it is the only one."""
    path = present(scene)
    if path is None or path.name != CASE:
        return ()
    folder = path.parent.parent
    entries = [_read(each, known_stamp(each)) for each in _cases(folder, known_stamp(folder))]
    mesh = next((entry.mesh for entry in entries if entry.path == path), None)
    found = tuple(entry for entry in entries if entry.mesh in (mesh, None))
    return found if mesh is not None and sum(entry.mesh == mesh for entry in found) > 1 else ()


def new_folder(scene: bpy.types.Scene) -> Path:
    """Where a queue begins: the one that the case is in, or one beside the case."""
    entries = queue_of(scene)
    return entries[0].path.parent.parent if entries else usual_folder(scene) / FOLDER


def position(scene: bpy.types.Scene) -> int:
    """That of the scene's case in its queue."""
    paths = [entry.path for entry in queue_of(scene)]
    path = present(scene)
    if path not in paths:
        raise InputError("expected a case of a queue, found none; press Add Frames")
    return paths.index(path)


@lru_cache(maxsize=4)
def _cases(folder: Path, _stamp: Stamp) -> tuple[Path, ...]:
    return queued_cases(folder)


@lru_cache(maxsize=1000)
def _read(path: Path, _stamp: Stamp) -> Queued:
    try:
        case = read_case(path, posed=False)
    except InputError:
        return Queued(path)
    return Queued(path, case.image, case.mesh.resolve(), case.video, state_of(case))


PARTS = (at_end(_cases.cache_clear, _read.cache_clear),)
