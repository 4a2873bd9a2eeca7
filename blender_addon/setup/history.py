"""The history of the scene's case: what somebody settles goes there by itself, whatever ends Blender, and comes back.

It lies beside the case, or beside the frame of a case that has no file yet: see :mod:`oneframe.case.case_history`.
While it has it all, Blender's question before it quits, which speaks of the .blend file, is left out. That is a
preference of the user's, which is as before as soon as anything else could be lost, and for the next session.
"""

import os
import sys
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from hashlib import sha256
from pathlib import Path

import bpy
from bpy.app.handlers import persistent
from bpy.props import IntProperty

from ..class_registration import at_end, listening, prop, ticking
from ..dataset import background_job
from ..pipeline.blender.colour.surface_colour import colour_record
from ..pipeline.case.case_changes import differing_fields
from ..pipeline.case.case_file import Case, read_case
from ..pipeline.case.case_history import EarlierCase, add_to_history, earlier_cases, history_path
from ..pipeline.case.case_writer import case_text
from ..pipeline.case.loaded_case import LoadedCase
from ..pipeline.errors import InputError
from ..state import frame_in_view, from_scene, pose, scene_files, workbench
from ..state.camera_view import look_through_camera, show_shape
from ..state.scene_files import Stamp, forget_stamps, known_stamp, remember, usual_folder
from ..ui.operator import Messages, Reporting
from .alignment_record import recorded_case
from .case_in_scene import load_into_scene
from .queued import queue_of

TICK_S = 0.4
"""What stays the same for so long is settled."""
SHOWN = 8
"""Entries that the panel lists."""

_kept: dict[Path, Case] = {}
"""Where a case lies -> what its history has of it, or what its file had when it was opened or saved."""
_moving: dict[Path, Case] = {}
"""The same -> what it was at the last look."""
_read: dict[Path, str] = {}
"""File of a case -> digest of what this session has read or written there."""
_failed: set[str] = set()
"""What has been reported already."""


def place_of(scene: bpy.types.Scene) -> Path | None:
    """The file of the scene's case; of one without, a name beside its frame. ``None`` if nothing lasts there."""
    settings = scene.oneframe
    if settings.case_path:
        return from_scene.absolute_path(settings.case_path)
    folder = usual_folder(scene)
    return folder / f"{Path(settings.frame_path).stem}.toml" if settings.frame_path and folder.name else None


def note(scene: bpy.types.Scene) -> None:
    """Take the scene as what its file has, which it was read from or written to."""
    path = place_of(scene)
    if path is None:
        return
    _moving.pop(path, None)
    _read[path] = _digest(path, from_scene.stamp(path)) if path.exists() else ""
    _remember_recent(scene, path)
    try:
        _kept[path] = recorded_case(scene, path)
    except InputError:
        _kept.pop(path, None)  # the sidebar says what is wrong


def keep(scene: bpy.types.Scene, *, settled: bool = True) -> None:
    """Put the scene's case into its history, unless that has it; if not ``settled``, once it no longer changes.

    Raises
    ------
    OSError
        The history cannot be written.
    """
    path = place_of(scene)
    if pose.previewed or path is None:
        return  # not of the case yet
    try:
        case = recorded_case(scene, path)
        if path in _kept and not _differs(_kept[path], case):
            return
        if not settled and (path not in _moving or _differs(_moving[path], case)):
            _moving[path] = case
            return
        add_to_history(path, case, case_text(path, case))
    except InputError:
        return  # the sidebar says what is wrong
    _kept[path] = case
    forget_stamps()


def is_kept(scene: bpy.types.Scene) -> bool:
    """Whether the history, or the file, has what the scene has now."""
    path = place_of(scene)
    try:
        return path is not None and path in _kept and not _differs(_kept[path], recorded_case(scene, path))
    except InputError:
        return False


def load(context: bpy.types.Context, path: Path) -> LoadedCase:
    """Load a case file into the workbench; what the present case has stays in its history."""
    flush()
    loaded = load_into_scene(context, read_case(path, posed=False))
    forget_stamps()
    note(context.scene)
    return loaded


def carry_over(before: Path, saved: Case) -> None:
    """Move the history of a case that had no file to the file that it was saved to, with the names of its files."""
    if before == saved.path or not history_path(before).exists():
        return
    for entry in reversed(earlier_cases(before)):
        named = replace(entry.case, image=saved.image, mesh=saved.mesh, structures=saved.structures)
        add_to_history(saved.path, named, case_text(saved.path, named))
    history_path(before).unlink()


def is_changed_elsewhere(scene: bpy.types.Scene) -> bool:
    """Whether another window or program has written the scene's case file since this one read or wrote it."""
    path = scene.oneframe.case_path
    if not path or (known := _read.get(place := from_scene.absolute_path(path))) is None:
        return False
    stamp = known_stamp(place)
    return stamp != (0, 0) and _digest(place, stamp) != known


def listed(scene: bpy.types.Scene) -> Sequence[EarlierCase]:
    """The latest entries of the history of the scene's case, for drawing; the latest first."""
    path = place_of(scene)
    return () if path is None else _listed(path, known_stamp(history_path(path)))


def later_text(scene: bpy.types.Scene) -> str:
    """What the history has and neither scene nor file, in a sentence; empty if that is nothing."""
    path = place_of(scene)
    entries = listed(scene)
    if not entries or path is None or path not in _kept or not _differs(entries[0].case, _kept[path]):
        return ""
    if known_stamp(path)[0] > known_stamp(history_path(path))[0]:
        return ""
    return f"In the history, and not in the file: {entries[0].text}"


def _remember_recent(scene: bpy.types.Scene, path: Path) -> None:
    try:
        # of a queue the latest frame alone
        remember("cases", path, [entry.path for entry in queue_of(scene)])
    except OSError as error:
        _report_once(f"the list of recent cases cannot be written: {error}")


def _report_once(text: str) -> None:
    if text not in _failed:
        sys.stderr.write(f"OneFrame: {text}{os.linesep}")
        _failed.add(text)


def _differs(one: Case, other: Case) -> bool:
    return bool(differing_fields(one, other))


@lru_cache(maxsize=8)
def _listed(path: Path, stamp: Stamp) -> Sequence[EarlierCase]:
    return earlier_cases(path, SHOWN) if stamp != (0, 0) else ()


@lru_cache(maxsize=32)
def _digest(path: Path, _stamp: Stamp) -> str:
    return sha256(path.read_bytes()).hexdigest()


class ONEFRAME_OT_restore(Reporting):
    """Make the case what it was then; Save Case saves it. What it is now stays in the history"""

    bl_label = "Restore"

    number: int = prop(IntProperty, description="Counted from the latest one, 0", options={"SKIP_SAVE", "HIDDEN"})

    def run(self, context: bpy.types.Context) -> Messages:
        scene, entries = context.scene, listed(context.scene)
        if not 0 <= self.number < len(entries):
            raise InputError(f"expected an entry of the history below {len(entries)}, found {self.number}")
        keep(scene)
        entry, known = entries[self.number], scene.oneframe.case_path
        loaded = load_into_scene(context, _with_files_of(scene, entry.case))
        if not known:
            context.scene.oneframe.case_path = ""
        if (path := place_of(context.scene)) is not None:
            _kept[path] = recorded_case(context.scene, path)
        show_shape(context)
        look_through_camera(context)
        return *loaded.messages, f"as it was: {entry.text}"


def _with_files_of(scene: bpy.types.Scene, case: Case) -> Case:
    """The case, with the scene's frame and surface where its own ended with the session that they were made in."""
    files = scene_files.input_files(scene)
    image, mesh = (
        file if file.exists() else files.get(name, file)
        for file, name in ((case.image, "frame"), (case.mesh, "surface"))
    )
    return replace(case, image=image, mesh=mesh)


@persistent
def flush(*_arguments: object) -> None:
    """Keep what is there at once: Blender ends, or opens another file."""
    _keep_reported(settled=True)


def _keep_reported(*, settled: bool) -> None:
    scene = workbench.existing()
    if scene is None:
        return
    try:
        keep(scene, settled=settled)
    except OSError as error:
        _report_once(f"the history of the case cannot be written: {error}")


_left_out: list[bool] = []
"""What the preference was, while it is switched off."""


def is_needed() -> bool:
    """Whether something could be lost that is in no history: in other scenes, another file, colours, a run."""
    scene, windows = workbench.existing(), bpy.context.window_manager.windows
    job = background_job.current()
    if scene is None or bpy.data.filepath or (job is not None and job.running):
        return True
    if any(window.scene != scene for window in windows) or any(image.is_dirty for image in bpy.data.images):
        return True
    surface = from_scene.present_surface(scene)
    return surface is None or colour_record(surface) is not None or not is_kept(scene)


def _switch(*, off: bool) -> None:
    preferences = bpy.context.preferences
    if off == bool(_left_out):
        return
    was_changed = preferences.is_dirty
    if off:
        _left_out.append(preferences.view.use_save_prompt)
        preferences.view.use_save_prompt = False
    else:
        preferences.view.use_save_prompt = _left_out.pop()
    # it is for this session: what the user changes is saved by Blender as ever
    preferences.is_dirty = was_changed


def _tick() -> float:
    _keep_reported(settled=False)
    # with changes of the user's own, Blender saves the preferences when it quits
    _switch(off=not bpy.app.background and not bpy.context.preferences.is_dirty and not is_needed())
    return TICK_S


@persistent
def _ask_again(*_arguments: object) -> None:
    _switch(off=False)


PARTS = (
    at_end(_kept.clear, _moving.clear, _read.clear),
    listening(bpy.app.handlers.load_pre, flush),
    listening(frame_in_view.leaving, flush),
    at_end(flush),
    at_end(_ask_again),
    listening(bpy.app.handlers.load_pre, _ask_again),
    ticking(_tick, TICK_S),
)
