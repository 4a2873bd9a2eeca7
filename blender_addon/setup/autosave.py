"""What a case has and its file lacks is kept aside, whatever ends Blender, and offered when the case is opened again.

It lies beside the file as ``.case.unsaved.toml``; that of a case without a file in the extension's folder for the
user's files. There a line of text says which was the last one, for the next start.
"""

import datetime
import os
import secrets
import sys
import textwrap
from dataclasses import replace
from pathlib import Path

import bpy
from bpy.app.handlers import persistent
from bpy.props import StringProperty

from ..class_registration import Part, at_end, listening, prop, timers
from ..pipeline.case.case_file import read_case
from ..pipeline.case.case_history import with_replaced
from ..pipeline.case.case_writer import case_text, encoded
from ..pipeline.errors import InputError
from ..pipeline.files.content import write_bytes_atomically, write_files_atomically
from ..state import from_scene, pose, workbench
from ..state.camera_view import look_through_camera, show_shape
from ..state.known_case import part_from_case
from ..ui.operator import Messages, OperatorResult, Reporting, call
from ..ui.panel import CHARACTER_PX
from ..ui.question import DIALOG_PX
from .alignment_record import is_start, recorded_case
from .case_in_scene import lately_saved, load_into_scene, unsaved_parts

PERIOD_S = 2.0
"""So much work is lost at most."""
START_S = 1.0
"""After which the question is asked at the start: Blender has its window by then."""
SUFFIX = ".unsaved.toml"
LAST = "last.txt"

_session = secrets.token_hex(8)
"""In the name of the file for a case without one: several sessions may run."""

_written: dict[Path, str] = {}
"""The files that this session has written, or whose case it has taken over, with their texts."""

_failed: set[str] = set()
"""What has been reported already."""

_has_asked = False
"""Whether the question of the start has been asked."""


def aside(case_path: Path) -> Path:
    """The file in which a case is kept aside: hidden, since commands want their folders to themselves."""
    return case_path.with_name(f".{case_path.stem}{SUFFIX}")


def _case_path(kept: Path) -> Path:
    """The inverse of :func:`aside`."""
    return kept.with_name(kept.name.removeprefix(".").removesuffix(SUFFIX) + ".toml")


def keep_aside(scene: bpy.types.Scene) -> None:
    """Keep the scene's case aside if its file lacks something, or else nothing.

    Raises
    ------
    OSError
        The file cannot be written.
    """
    if pose.previewed:
        return  # not of the case yet
    path = path_of(scene)
    try:
        parts = unsaved_parts(scene, lately_saved)
        if not parts or (parts == ("pose",) and is_start(scene)):
            forget(scene)
            return
        text = case_text(path, recorded_case(scene, path))
        data = encoded(path, text)
    except InputError:
        return  # the sidebar says what is wrong
    if _written.get(path) == text and path.exists():
        return
    if path not in _written and path.exists():
        _keep_in_history(scene, path)
    write_bytes_atomically(path, data)
    write_bytes_atomically(own_folder("unsaved") / LAST, os.fsencode(path))
    _written[path] = text


def forget(scene: bpy.types.Scene) -> None:
    """Keep nothing aside of the scene's case: it is saved, or the user discards it."""
    for path in {path_of(scene), _nameless()} & _written.keys():
        path.unlink(missing_ok=True)
        del _written[path]


def path_of(scene: bpy.types.Scene) -> Path:
    """Where the scene's case is kept aside."""
    known = scene.oneframe.case_path
    return aside(from_scene.absolute_path(known)) if known else _nameless()


def _nameless() -> Path:
    return own_folder("unsaved") / f"{_session}{SUFFIX}"


def _keep_in_history(scene: bpy.types.Scene, path: Path) -> None:
    """A pose that was offered, and neither restored nor discarded, before another one is kept aside."""
    case_path = from_scene.absolute_path(scene.oneframe.case_path)
    try:
        history = with_replaced(case_path, read_case(path, posed=False), from_scene.case(scene, case_path))
    except InputError:
        return
    write_files_atomically(history)


def left_behind() -> Path | None:
    """What an earlier session has left, the last one."""
    folder = own_folder("unsaved")
    nameless = sorted(folder.glob(f"*{SUFFIX}"), key=lambda path: path.stat().st_mtime, reverse=True)
    last = [Path(os.fsdecode((folder / LAST).read_bytes()))] if (folder / LAST).exists() else []
    return next((path for path in (*last, *nameless) if path.exists() and path not in _written), None)


class _OfUnsaved(Reporting):
    """Mixin: about a case that was kept aside."""

    filepath: str = prop(StringProperty, subtype="FILE_PATH", options={"SKIP_SAVE", "HIDDEN"})


def offer(context: bpy.types.Context, path: Path) -> None:
    """Ask what becomes of what an earlier session has kept aside, if there is something and somebody to ask."""
    if bpy.app.background or path in _written or not path.exists():
        return
    with context.temp_override(window=context.window_manager.windows[0]):
        call("ask_unsaved", "INVOKE_DEFAULT", filepath=str(path))


class ONEFRAME_OT_ask_unsaved(_OfUnsaved):
    """Ask whether what was not saved when Blender ended is restored or discarded; Esc leaves the answer for later"""

    bl_label = "Not Saved When Blender Ended"
    bl_options = {"INTERNAL"}

    def run(self, context: bpy.types.Context) -> Messages:
        return ()  # without a pointer there is no answer

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> OperatorResult:
        return context.window_manager.invoke_popup(self, width=DIALOG_PX)

    def draw(self, context: bpy.types.Context) -> None:
        path = Path(self.filepath)
        known = _case_path(path)
        name = f"{known.parent.name}/{known.name}" if known.exists() else "A case that was never saved"
        when = datetime.datetime.fromtimestamp(path.stat().st_mtime).strftime("%d %b %H:%M")
        text = f"{name}: work of {when} that was not saved when Blender ended."
        column = self.layout.column(align=True)
        column.label(text=self.bl_label, icon="ERROR")
        for line in textwrap.wrap(text, int(DIALOG_PX / CHARACTER_PX) - 8):
            column.label(text=line)
        self.layout.separator()
        row = self.layout.row()
        row.operator("oneframe.restore_unsaved", text="Restore").filepath = self.filepath
        row.operator("oneframe.discard_unsaved", text="Discard").filepath = self.filepath


class ONEFRAME_OT_restore_unsaved(_OfUnsaved):
    """Open the case with what was not saved when Blender ended; Save Case then saves it"""

    bl_label = "Restore"
    bl_options = {"UNDO", "INTERNAL"}

    def run(self, context: bpy.types.Context) -> Messages:
        path = Path(self.filepath)
        case, is_nameless = read_case(path, posed=False), path.parent == own_folder("unsaved")
        if not is_nameless:
            case = replace(case, path=_case_path(path))
        loaded = load_into_scene(context, case)
        if is_nameless:
            part_from_case(context.scene)
            path = path.replace(_nameless())
        show_shape(context)
        look_through_camera(context)
        _written[path] = ""
        return *loaded.messages, f"restored from {path}"


class ONEFRAME_OT_discard_unsaved(_OfUnsaved):
    """Remove what was not saved"""

    bl_label = "Discard"
    bl_options = {"INTERNAL"}

    def run(self, context: bpy.types.Context) -> Messages:
        Path(self.filepath).unlink(missing_ok=True)
        return (f"{self.filepath} is removed",)


def own_folder(name: str) -> Path:
    """A folder of the extension for the user's files; in a checkout, one that lasts for this session."""
    package = __package__.rpartition(".")[0] if __package__ else ""
    try:
        return Path(bpy.utils.extension_path_user(package, path=name, create=True))
    except ValueError:  # not an extension
        folder = Path(bpy.app.tempdir) / f"oneframe_{name}"
        folder.mkdir(exist_ok=True)
        return folder


def _tick() -> float:
    global _has_asked
    if not _has_asked and (path := left_behind()) is not None:
        offer(bpy.context, path)
    _has_asked = True
    flush()
    return PERIOD_S


@persistent
def flush(*_arguments: object) -> None:
    """Keep the case aside at once: Blender ends, or opens another file."""
    scene = workbench.existing()
    if scene is None:
        return
    try:
        keep_aside(scene)
    except OSError as error:
        if str(error) not in _failed:
            sys.stderr.write(f"OneFrame: what is not saved cannot be kept aside: {error}\n")
            _failed.add(str(error))


PARTS = (
    at_end(_written.clear),
    listening(bpy.app.handlers.load_pre, flush),
    at_end(flush),
    timers(_tick),
    Part(lambda: bpy.app.timers.register(_tick, first_interval=START_S, persistent=True), lambda: None),
)
