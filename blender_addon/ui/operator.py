"""What all operators of the add-on share: errors become one sentence in Blender's status line, and nothing changes."""

from collections.abc import Iterable
from pathlib import Path
from typing import Literal

import bpy

from ..pipeline.errors import InputError, RunError
from ..state import from_scene

Messages = Iterable[str] | None
"""Sentences for the status line."""

OperatorResult = set[Literal["RUNNING_MODAL", "CANCELLED", "FINISHED", "PASS_THROUGH", "INTERFACE"]]
"""What Blender expects of an operator's callbacks: one of these, in a set."""


class Reporting(bpy.types.Operator):
    """Mixin: ``execute`` calls ``run``, tells what it returns, and reports what the user can mend."""

    def run(self, context: bpy.types.Context) -> Messages:
        """Do the work; the sentences returned are told. Raise InputError before anything has changed."""
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
        for sentence in messages or ():
            self.report({"INFO"}, sentence)
        redraw(context)
        return {"FINISHED"}


class ReportingFile(Reporting):
    """Mixin of operators with a file dialog."""

    def chosen_file(self) -> Path:
        """The file that was chosen.

        Raises
        ------
        InputError
            None, or a folder.
        """
        filepath: str = self.filepath  # type: ignore[attr-defined]  # from ImportHelper or ExportHelper
        path = Path(bpy.path.abspath(filepath))
        if not path.name or path.is_dir():
            raise InputError(f"expected a file, found {filepath or 'none'}; choose one, or give it a name")
        return path


class NeedsAlignment(bpy.types.Operator):
    """Mixin: available once camera and surface are set up; before that, the button's tooltip says what is missing."""

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Called by Blender."""
        if from_scene.is_set_up(context.scene):
            return True
        cls.poll_message_set("Set up a frame, a camera and a surface first")
        return False


def redraw(context: bpy.types.Context) -> None:
    """Have all 3D views drawn anew."""
    for window in context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                area.tag_redraw()
