"""Base classes of the add-on's operators: an error becomes one message in the status bar and changes nothing."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any, Literal

import bpy

from ..pipeline.errors import InputError, RunError
from ..state import from_scene

Messages = Iterable[str] | None
"""Messages for the status bar."""

OperatorResult = set[Literal["RUNNING_MODAL", "CANCELLED", "FINISHED", "PASS_THROUGH", "INTERFACE"]]
"""What Blender expects an operator's callbacks to return: one of these, in a set."""


class Reporting(bpy.types.Operator):
    """Mixin: ``execute`` calls ``run`` and reports the messages it returns, or the error that the user can fix."""

    def run(self, context: bpy.types.Context) -> Messages:
        """Do the work and return messages to report. Implementations raise InputError before they change anything."""
        raise NotImplementedError

    def execute(self, context: bpy.types.Context) -> OperatorResult:
        """Called by Blender."""
        try:
            messages = self.run(context)
        except (InputError, RunError) as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        except OSError as error:
            # a full disk, a folder that does not exist or may not be written to
            self.report({"ERROR"}, f"{error.filename or self.bl_label}: {error.strerror or error}")
            return {"CANCELLED"}
        for message in messages or ():
            self.report({"INFO"}, message)
        redraw(context)
        return {"FINISHED"}


class ReportingFile(Reporting):
    """Mixin for operators with a file dialog."""

    def chosen_file(self) -> Path:
        """The file chosen in the dialog.

        Raises
        ------
        InputError
            No file was chosen, or a folder.
        """
        filepath: str = self.filepath  # type: ignore[attr-defined]  # from ImportHelper or ExportHelper
        path = Path(bpy.path.abspath(filepath))
        if not path.name or path.is_dir():
            raise InputError(f"expected a file, found {filepath or 'none'}; choose a file or type its name")
        return path


class NeedsAlignment(bpy.types.Operator):
    """Mixin: available once camera and surface are set up; until then the button's tooltip says what is missing."""

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Called by Blender."""
        if from_scene.is_set_up(context.scene):
            return True
        cls.poll_message_set("Set up a frame, a camera and a surface first")
        return False


def call(name: str, **settings: object) -> None:
    """Run another operator of the add-on, without its dialog; ``name`` is its ``bl_idname`` without the prefix.

    Raises
    ------
    InputError
        It has reported an error.
    """
    operators: Any = getattr(bpy.ops, "oneframe")  # noqa: B009  # Blender's type stubs do not know the add-on's
    try:
        getattr(operators, name)("EXEC_DEFAULT", **settings)
    except RuntimeError as error:  # how Blender passes on the report of a cancelled operator
        raise InputError(str(error).removeprefix("Error: ").strip()) from None


def redraw(context: bpy.types.Context) -> None:
    """Redraw all 3D views."""
    for window in context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                area.tag_redraw()
