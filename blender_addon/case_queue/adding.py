"""Puts frames into a queue, all of them or none; the operator takes files, those for a film are in the room frames."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import bpy
from bpy.props import StringProperty
from bpy_extras.io_utils import ImportHelper

from ..class_registration import prop
from ..pipeline.case.case_file import Case, read_case
from ..pipeline.case.case_folder import CASE
from ..pipeline.case.case_queue import NewFrame, add_frames, cases_of_frames
from ..pipeline.errors import InputError
from ..pipeline.files.outputs import made_folder
from ..setup.operators import IMAGES
from ..state import from_scene
from ..state.scene_files import forget_stamps
from ..ui.operator import ChosenFiles, Messages, NeedsAlignment, OperatorResult, Reporting, call, open_beside
from . import queued


class ONEFRAME_OT_queue_frames(NeedsAlignment, Reporting, ChosenFiles, ImportHelper):
    """Put frames of this surface and K into a queue, a case each; the present case is one of them"""

    bl_label = "Add Frames"
    bl_options = {"REGISTER"}

    filter_glob: str = prop(StringProperty, default=IMAGES, options={"HIDDEN"})
    filepath: str = prop(StringProperty, subtype="FILE_PATH", options={"SKIP_SAVE", "HIDDEN"})

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> OperatorResult:
        open_beside(self, context.scene)
        return ImportHelper.invoke(self, context, event)

    def run(self, context: bpy.types.Context) -> Messages:
        images = self.chosen_files()
        if not images:
            raise InputError("expected frames, found none chosen; choose image files")
        return added_text(context.scene, add_to_queue(context.scene, [NewFrame(path) for path in images]))


def first_case(scene: bpy.types.Scene) -> Case:
    """The scene's case where it will be in the queue."""
    from_scene.check_mesh_unedited(scene)
    folder, path = queued.new_folder(scene), queued.present(scene)
    if path is None or path.parent.parent != folder:
        path = folder / Path(scene.oneframe.frame_path).stem / CASE
    return replace(from_scene.case(scene, path), path=path)


def add_to_queue(scene: bpy.types.Scene, frames: Sequence[NewFrame]) -> list[Path]:
    """Put frames into the scene's queue, which begins with the present case: see :func:`.add_frames`.

    Raises
    ------
    InputError, RunError
        As there, and nothing has changed then; or the present case cannot be saved.
    """
    first, folder = first_case(scene), queued.new_folder(scene)
    cases_of_frames(folder, first, frames)
    if first.path != queued.present(scene):
        call("save_case", filepath=str(made_folder(first.path)))
    # its files may be copies now
    added = add_frames(folder, read_case(first.path, posed=False), frames)
    forget_stamps()
    return added


def added_text(scene: bpy.types.Scene, added: Sequence[Path]) -> Messages:
    """What was added, in words."""
    names = ", ".join(path.parent.name for path in added[:3]) + (f" and {len(added) - 3} more" if added[3:] else "")
    return (f"in the queue {queued.new_folder(scene)}: {names}",)
