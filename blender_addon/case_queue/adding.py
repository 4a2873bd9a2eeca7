"""Operators that put frames into a queue: files, and those of the film. All of them are put in, or nothing changes."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import bpy
from bpy.props import BoolProperty, StringProperty
from bpy_extras.io_utils import ImportHelper

from ..class_registration import class_registration, prop
from ..pipeline.case.case_file import Case, read_case
from ..pipeline.case.case_folder import CASE
from ..pipeline.case.case_queue import NewFrame, add_frames, cases_of_frames
from ..pipeline.errors import InputError
from ..pipeline.files.outputs import made_folder
from ..pipeline.video.frame_folder import write_frame
from ..setup.frame import IMAGES
from ..state import from_scene
from ..state.scene_files import forget_stamps
from ..ui.background_operator import InBackground, Work
from ..ui.operator import ChosenFiles, Messages, NeedsAlignment, OperatorResult, Reporting, available, call, open_beside
from ..video import session
from ..video.operators import NeedsFilm
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


class ONEFRAME_OT_queue_video_frames(InBackground, NeedsFilm):
    """Put the video's frame in view into the queue, or its best frames"""

    bl_label = "Add Video Frame"
    bl_options = {"REGISTER"}
    doing = "Taking the frames"

    best: bool = prop(BoolProperty, "Best", "The best frames instead of the one in view", options={"SKIP_SAVE"})

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        is_set_up = available(cls, from_scene.is_set_up(context.scene), "Set up a frame, a camera and a surface first")
        return is_set_up and super().poll(context)

    def work(self, context: bpy.types.Context) -> Work:
        scene, film = context.scene, session.scored(context.scene)
        folder = queued.new_folder(scene)
        like = first_case(scene)
        like.camera.for_images(film.scores.info.size_wh, film.path.name)
        known = {like.video, *(entry.video for entry in queued.queue_of(scene))}
        wanted = film.best if self.best else (film.shown,)
        chosen = [film.scores.frames[at] for at in wanted]
        chosen = [score for score in chosen if (film.path.name, score.index) not in known]
        if not chosen:
            raise InputError(f"{film.path.name}: expected a frame that has no case yet, found none; choose another one")
        self._written: list[Path] = []

        def take(progress: Callable[[float], None]) -> list[NewFrame]:
            made_folder(folder / "frame")
            before, taken = set(folder.iterdir()), []
            with _all_or_none(self._written):
                for number, score in enumerate(chosen):
                    progress(number / len(chosen))
                    image = write_frame(film.path, folder, film.scores, score)
                    self._written += [image] if image not in before else []
                    taken.append(NewFrame(image, (film.path.name, score.index)))
            return taken

        return take

    def finish(self, context: bpy.types.Context, result: Any) -> Messages:
        with _all_or_none(self._written):
            return added_text(context.scene, add_to_queue(context.scene, result))


def first_case(scene: bpy.types.Scene) -> Case:
    """The scene's case where it will be in the queue.

    Raises
    ------
    InputError
        It is not complete, or its surface was edited.
    """
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


@contextmanager
def _all_or_none(written: Sequence[Path]) -> Iterator[None]:
    """Remove new pictures again if not all of what they are for succeeds, or the user stops it."""
    try:
        yield
    except Exception:
        for path in written:
            path.unlink(missing_ok=True)
        raise


register, unregister = class_registration(__name__)
