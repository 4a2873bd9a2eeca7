"""Base classes of the add-on's operators: an error becomes one message in the status bar and changes nothing."""

import os
import textwrap
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, Literal

import bpy
from bpy.props import CollectionProperty, StringProperty
from bpy_extras.io_utils import ImportHelper

from ..class_registration import prop
from ..pipeline.errors import InputError, RunError
from ..state import from_scene
from ..state.events import redraw
from ..state.scene_files import usual_folder
from .panel import CHARACTER_PX

MARGIN_CHARACTERS, MOST_CHARACTERS = 20, 90
"""Of a line in a popup: what stays free of the window's width, and the longest one."""

Messages = Iterable[str] | None
"""Messages for the status bar."""

OperatorResult = set[Literal["RUNNING_MODAL", "CANCELLED", "FINISHED", "PASS_THROUGH", "INTERFACE"]]
"""What Blender expects an operator's callbacks to return: one of these, in a set."""

Needs = tuple[Callable[[bpy.types.Context], object], str]
"""Whether something is there, and what a tooltip says while it is not."""


class Available(bpy.types.Operator):
    """Mixin: available while there is what it and its mixins need; else the button's tooltip says what is missing."""

    needs: Needs
    """What it needs besides; what its mixins need comes first."""

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        for kind in reversed(cls.__mro__):
            is_there, missing = vars(kind).get("needs", (bool, ""))
            if not is_there(context):
                cls.poll_message_set(missing)
                return False
        return True


def report_error(operator: bpy.types.Operator, message: str) -> None:
    """Report an error in lines that fit into the window: Blender opens a popup for it, which breaks none."""
    window = bpy.context.window
    if not bpy.app.background and window is not None:
        most = int(window.width / bpy.context.preferences.system.ui_scale / CHARACTER_PX)
        # the status bar shows all of it in one line
        message = " \n".join(textwrap.wrap(message, max(20, min(most - MARGIN_CHARACTERS, MOST_CHARACTERS))))
    operator.report({"ERROR"}, message)


class Reporting(Available):
    """Mixin: ``execute`` calls ``run`` and reports the messages it returns, or the error that the user can fix."""

    bl_options = {"REGISTER", "UNDO"}

    def run(self, context: bpy.types.Context) -> Messages:
        """Do the work and return messages to report. Implementations raise InputError before they change anything."""
        raise NotImplementedError

    def worded(self, message: str) -> str:
        """An error of the pipeline in the words of the window."""
        return message

    def execute(self, context: bpy.types.Context) -> OperatorResult:
        return self.reported(context, lambda: self.run(context))

    def reported(self, context: bpy.types.Context, call: Callable[[], Messages]) -> OperatorResult:
        """Report the messages of ``call``, or its error."""
        try:
            messages = call()
        except (InputError, RunError) as error:
            report_error(self, self.worded(str(error)))
            return {"CANCELLED"}
        except OSError as error:
            # a full disk, a folder that does not exist or may not be written to
            report_error(self, f"{error.filename or self.bl_label}: {error.strerror or error}")
            return {"CANCELLED"}
        for message in messages or ():
            self.report({"INFO"}, message)
        redraw()
        return {"FINISHED"}


class ReportingFile(Reporting):
    """Mixin for operators with a file dialog."""

    def chosen_file(self) -> Path:
        """The file chosen in the dialog."""
        filepath: str = self.filepath  # type: ignore[attr-defined]  # from ImportHelper or ExportHelper
        path = Path(bpy.path.abspath(filepath))
        if not path.name or path.is_dir():
            raise InputError(f"expected a file, found {filepath or 'none'}; choose a file or type its name")
        return path


class OpensFile(ReportingFile, ImportHelper):
    """Mixin for operators that read a file: their dialog begins beside the case or its frame, once there is one."""

    filepath: str = prop(StringProperty, subtype="FILE_PATH", options={"SKIP_SAVE", "HIDDEN"})

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> OperatorResult:
        if self.filepath:
            return self.execute(context)  # dropped, or chosen from a list
        open_beside(self, context.scene)
        return ImportHelper.invoke(self, context, event)


def open_beside(operator: bpy.types.Operator, scene: bpy.types.Scene) -> None:
    """Let the file dialog of an operator begin in the folder of the scene's files, unless a file is given."""
    folder = usual_folder(scene)
    if not operator.filepath and folder.name:  # type: ignore[attr-defined]  # from ImportHelper
        operator.filepath = f"{folder}{os.sep}"  # type: ignore[attr-defined]


class ChosenFiles(bpy.types.Operator):
    """Mixin for operators that take several files at once: chosen in a dialog, or dropped."""

    directory: str = prop(StringProperty, subtype="DIR_PATH", options={"HIDDEN", "SKIP_SAVE"})
    files: "bpy.types.bpy_prop_collection_idprop[bpy.types.OperatorFileListElement]" = prop(
        CollectionProperty, type=bpy.types.OperatorFileListElement, options={"HIDDEN", "SKIP_SAVE"}
    )

    def chosen_files(self) -> list[Path]:
        """All of them; none if the operator was called without."""
        folder = Path(bpy.path.abspath(self.directory))
        return [folder / entry.name for entry in self.files if entry.name]


class NeedsAlignment(Available):
    """Mixin: available once camera and surface are set up."""

    needs: Needs = (lambda context: from_scene.is_set_up(context.scene), "Set up a frame, a camera and a surface first")


def call(name: str, context: str = "EXEC_DEFAULT", *, undo: bool = False, **settings: object) -> None:
    """Run another operator of the add-on; ``name`` is its ``bl_idname`` without the prefix.

    Parameters
    ----------
    name, settings
        The operator and its properties.
    context
        As in ``bpy.ops``: without the operator's dialog, or ``"INVOKE_DEFAULT"``.
    undo
        Whether it is an undo step of its own, if it is one by itself.
    """
    operators: Any = getattr(bpy.ops, "oneframe")  # noqa: B009  # Blender's type stubs do not know the add-on's
    try:
        getattr(operators, name)(context, undo, **settings)
    except RuntimeError as error:  # how Blender passes on the report of a cancelled operator
        raise InputError(str(error).removeprefix("Error: ").strip()) from None
