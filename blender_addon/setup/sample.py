"""The sample case, one click away: a copy of the one in the extension, which the user may change."""

import shutil
from pathlib import Path

import bpy

from ..class_registration import class_registration
from ..pipeline.errors import InputError
from ..ui.operator import Asking, OperatorResult, call
from .unsaved import ANSWER, QUESTION, unsaved_text

SHIPPED = Path(__file__).resolve().parents[1] / "sample"
"""In the built extension; a checkout has none."""


class ONEFRAME_OT_open_sample(Asking, bpy.types.Operator):
    """Open the sample case: a drilled temporal bone with its frame, K and structures"""

    bl_idname = "oneframe.open_sample"
    bl_label = "Open Sample Case"
    bl_options = {"REGISTER", "UNDO"}

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> OperatorResult:
        question = unsaved_text(context.scene)
        return self.ask(context, QUESTION, question, ANSWER) if question else self.execute(context)

    def run(self, context: bpy.types.Context) -> None:
        call("open_case", filepath=str(copied_sample(_own_folder()) / "case.toml"))


def copied_sample(folder: Path) -> Path:
    """Copy the sample into a folder, unless it is there; files that exist stay as the user left them.

    Raises
    ------
    InputError
        This copy of the add-on comes without the sample.
    """
    if not SHIPPED.is_dir():
        raise InputError(
            f"{SHIPPED}: expected the sample case of the built extension, found none; "
            "make it with `oneframe sample`, and open its case.toml"
        )
    for source in sorted(SHIPPED.rglob("*")):
        target = folder / source.relative_to(SHIPPED)
        if source.is_dir():
            target.mkdir(parents=True, exist_ok=True)
        elif not target.exists():
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(source, target)
    return folder


def _own_folder() -> Path:
    """The extension's folder for the user's files; in a checkout, one that lasts for this session."""
    package = __package__.rpartition(".")[0] if __package__ else ""
    try:
        return Path(bpy.utils.extension_path_user(package, path="sample", create=True))
    except ValueError:  # not an extension
        return Path(bpy.app.tempdir) / "oneframe_sample"


register, unregister = class_registration((ONEFRAME_OT_open_sample,))
